"""Two weights on one rope: found together, where each alone is somewhere else."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.full_scan import sensitivities
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.pairs import accepted_pair, as_points, best_pair, fitted_pair
from ropefit.effects import MassSection, PointMass, Tether
from tests.concealed import recorded, rope, with_effect
from tests.test_calm import fitted

WEIGHTS = ((0.003, 0.31), (0.004, 0.66))


def carrying(effect, values, seed):
    """The nominal fit to a rope with an effect of each of some values."""
    setup = rope(288)
    for one in values:
        setup = effect.apply(setup, np.array(one))
    return fitted(recorded(setup, seed=seed))


@pytest.fixture(scope="module")
def two():
    return carrying(PointMass(), WEIGHTS, 103)


def sections(nominal, *starts):
    """The fit with sections, one after the other, and these as accepted."""
    out, current = [], nominal
    for start in starts:
        found = fit_candidate(current, Hypothesis(MassSection(), NO_PLACE), np.array(start))
        assert found is not None
        out.append(Accepted(found, [], found.evidence, 0.0))
        current = found.fit
    return current, out


def test_two_weights_are_found_together(two):
    """Not two tethers, which contain them; and that each could be a section is told."""
    known = sensitivities(two, [], ("point_mass", "kink", "tether"))
    found = best_pair(two, known, None, 6.0)
    assert found is not None
    for (candidate, without), weight in zip(found[0], WEIGHTS, strict=True):
        assert candidate.hypothesis.name == "point_mass"
        low, high = candidate.interval(3.0)
        assert (low <= weight).all()
        assert (weight <= high).all()
        assert candidate.values()[0] == pytest.approx(weight[0], rel=0.15)
        assert candidate.values()[1] == pytest.approx(weight[1], abs=0.02)
        assert candidate.evidence > 20
        assert without.cost > found[1].cost + 40
    named, whole = accepted_pair(found, 50)
    assert whole is found[1]
    for one in named:
        assert one.candidate.hypothesis.name == "point_mass"
        assert [c.hypothesis.name for c in one.equivalent] == ["mass_section"]


def test_of_two_tethers_one_may_be_the_weight_that_it_contains():
    """The fit that goes on has the terms of both that are accepted."""
    setup = PointMass().apply(rope(288), np.array([0.004, 0.66]))
    held = np.array([0.05, 0.0, 0.02, 0.01, 0.31])
    nominal = fitted(recorded(Tether().apply(setup, held), seed=104))
    found = best_pair(nominal, sensitivities(nominal, [], ("tether",)), None, 6.0)
    assert found is not None
    named, whole = accepted_pair(found, 50)
    assert [one.candidate.hypothesis.name for one in named] == ["tether", "point_mass"]
    assert whole is named[1].candidate.fit
    assert {id(one.candidate.term) for one in named} <= {id(t) for t in whole.forward.terms}
    assert named[1].candidate.values() == pytest.approx([0.004, 0.66], rel=0.1)


def test_of_two_tethers_one_may_be_a_heavy_stretch():
    """A stretch explains far more than the weight that the tether contains: that is no tie."""
    heavy, held = [0.006, 0.66, 0.2], [0.05, 0.0, 0.02, 0.01, 0.31]
    setup = MassSection().apply(rope(288), np.array(heavy))
    setup = Tether().apply(setup, np.array(held))
    nominal = fitted(recorded(setup, seed=105))
    found = best_pair(nominal, sensitivities(nominal, [], ("tether",)), None, 6.0)
    assert found is not None
    named, whole = accepted_pair(found, 50)
    by_name = {one.candidate.hypothesis.name: one.candidate for one in named}
    assert not any(one.equivalent for one in named)
    assert by_name.keys() == {"tether", "mass_section"}
    assert whole is by_name["mass_section"].fit
    assert by_name["mass_section"].values()[:2] == pytest.approx(heavy[:2], rel=0.1)
    low, high = by_name["mass_section"].interval(3.0)
    assert (low <= heavy).all()
    assert (heavy <= high).all()


def test_two_overlapping_sections_are_two_weights(two):
    """A heavy one with a light one inside weighs at its edges: neither is a weight by itself."""
    current, accepted = sections(two, (0.012, 0.48, 0.5), (-0.006, 0.48, 0.3))
    both, named = as_points(current, accepted, 6.0)
    assert [one.candidate.hypothesis.name for one in named] == ["point_mass", "point_mass"]
    assert all({c.hypothesis.name for c in one.equivalent} == {"mass_section"} for one in named)
    found = np.array([one.candidate.values() for one in named])
    np.testing.assert_allclose(found, WEIGHTS, rtol=0.1)
    assert both is named[1].candidate.fit


def test_two_wide_sections_stay_sections():
    truth = ((0.006, 0.25, 0.3), (0.008, 0.72, 0.3))
    nominal = carrying(MassSection(), truth, 109)
    starts = [(Hypothesis(MassSection(), NO_PLACE), np.array(one)) for one in truth]
    found = fitted_pair(nominal, starts, 6.0)
    assert found is not None
    accepted = [Accepted(one, [], one.evidence, 0.0) for one, _ in found[0]]
    assert as_points(found[1], accepted, 6.0) == (found[1], accepted)


def test_one_weight_is_no_pair():
    nominal = fitted(recorded(with_effect(PointMass(), [0.004, 0.5]), seed=104))
    known = sensitivities(nominal, [], ("point_mass",))
    assert best_pair(nominal, known, None, 6.0) is None
    assert np.isfinite(nominal.cost)
