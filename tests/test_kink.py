"""A kink is a bend of some width: its angle is right within its interval."""

import numpy as np
import pytest

from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.effects import FreeCurvature, FreeKink
from ropefit.effects.kink import INEXACT, log_width
from ropefit.effects.place import around_point
from tests.concealed import recorded, rope, with_effect
from tests.test_clamped_end import compared


@pytest.mark.parametrize("width", [1e-5, 0.004, 0.021, 0.05])
@pytest.mark.parametrize("place", [0.4, 0.4031, 0.41, 0.4199])
def test_neither_place_nor_width_is_lost_between_nodes(place, width):
    arc = np.linspace(0, 1, 51)
    share = around_point(arc, *(np.float64(v) for v in (place, width)))
    arm = arc - place
    assert float(share.sum()) == pytest.approx(1)
    assert float((share * arm).sum()) == pytest.approx(0, abs=1e-12)
    assert float((share * arm**2).sum()) == pytest.approx(width**2 / 12, rel=0.01, abs=1e-12)


@pytest.mark.parametrize("place", [0.0, 0.003, 0.999, 1.0])
def test_a_bend_at_an_end_stays_on_the_rope(place):
    arc = np.linspace(0, 1, 51)
    share = around_point(arc, np.float64(place), np.float64(0.02))
    assert float(share.sum()) == pytest.approx(1)


@pytest.mark.parametrize(("angle", "width"), [(0.33, 0.006), (0.9, 0.006), (0.5, 0.02)])
def test_the_angle_is_within_its_interval(angle, width):
    """Of bends of a known width, made on twelve times as fine a rope."""
    made = with_effect(FreeCurvature(), [angle / width, 0.4137, width], segments=1728)
    nominal = compared(recorded(made, seed=105, sd=3e-4))
    setup = nominal.forward.base
    start = np.array([0.7 * angle, log_width(setup), 0.41])
    found = fit_candidate(nominal, Hypothesis(FreeKink(), NO_PLACE), start)
    assert found is not None
    value, sd = found.values()[0], found.sd()[0]
    assert sd < 0.03 * angle
    assert abs(value - angle) < 2 * np.hypot(sd, INEXACT * angle)


def test_the_width_is_told_where_the_data_tell_it():
    made = with_effect(FreeCurvature(), [0.6 / 0.025, 0.4137, 0.025], segments=1728)
    nominal = compared(recorded(made, seed=106, sd=2e-4))
    setup = rope(20)
    start = np.array([0.5, log_width(setup), 0.41])
    found = fit_candidate(nominal, Hypothesis(FreeKink(), NO_PLACE), start)
    assert found is not None
    assert np.exp(found.values()[1]) == pytest.approx(0.025, rel=0.2)
