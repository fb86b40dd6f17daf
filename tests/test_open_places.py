"""What a weight is where else it may be, if its place is open."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.adapters.diagnosis_content import _stretch, holding_both, sizes_of
from ropefit.diagnosis import open_places
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import columns_of, fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.open_places import _elsewhere, half_interval, held_places
from ropefit.effects import MassSection, PointMass
from tests.concealed import nominal_fit, recorded, rope

MASS, PLACE, LENGTH = 0.004, 0.37, 1.0
STRETCH = (0.0004, 0.22, 0.16)  # kg, m, m


@pytest.fixture(scope="module")
def weighted():
    """A weight on a rope between two hands, as fitted."""
    setup = PointMass().apply(rope(144), np.array([MASS, PLACE]))
    nominal = nominal_fit(recorded(setup, seed=3), 72)
    found = fit_candidate(nominal, Hypothesis(PointMass(), NO_PLACE), np.array([MASS, PLACE]))
    assert found is not None
    return Accepted(found, [], found.evidence, 0.0)


def as_if(fitted, column, sd):
    """Return a fit as if one of its values had another standard error, alone."""
    widened = replace(fitted)
    covariance = fitted.covariance.copy()
    times = np.ones(len(covariance))
    times[column] = sd / np.sqrt(covariance[column, column])
    widened.__dict__["covariance"] = times[:, None] * covariance * times
    return widened


def test_a_place_that_is_known_is_not_held_elsewhere(weighted):
    assert held_places(weighted.candidate.fit, [weighted]) == []


def test_where_the_place_is_open_the_size_is_fitted_at_both_ends_of_its_interval(
    weighted, monkeypatch
):
    candidate = weighted.candidate
    final, term = candidate.fit, candidate.term
    place = columns_of(final, term)[-1]
    far = 0.12 * LENGTH / 1.96
    wide = as_if(final, place, far / term.scale[-1])
    # Significantly worse there, as the data do tell this place.
    assert held_places(wide, [weighted]) == []
    monkeypatch.setattr(open_places, "NO_WORSE", np.inf)
    low, high = held_places(wide, [weighted])
    middle = candidate.values()[-1]
    for held, end in ((low, middle - 0.12 * LENGTH), (high, middle + 0.12 * LENGTH)):
        there = held.of(candidate)
        assert there.values()[-1] == pytest.approx(end, abs=1e-4)
        assert there.sd()[-1] < 1e-4 * LENGTH
        assert held.fit.cost > final.cost
        # Of all else the best values there, not those of the last fit.
        slope = held.fit.jacobian.T @ held.fit.z - held.fit.prior.information @ held.fit.point.u
        free = np.delete(np.arange(len(slope)), place)
        scale = np.sqrt((held.fit.jacobian**2).sum(axis=0) + np.diag(held.fit.prior.information))
        assert np.abs(slope[free] / scale[free]).max() < 0.05 * np.sqrt(held.fit.cost)
    sizes = sizes_of(candidate, candidate.values(), candidate.sd())
    both = holding_both(sizes, low.of(candidate))
    assert both["mass"].ci95 != sizes["mass"].ci95


def test_an_effect_is_not_held_where_it_would_be_implausibly_large(weighted, monkeypatch):
    candidate = weighted.candidate
    place = columns_of(candidate.fit, candidate.term)[-1]
    wide = as_if(candidate.fit, place, 0.12 * LENGTH / 1.96 / candidate.term.scale[-1])
    monkeypatch.setattr(open_places, "NO_WORSE", np.inf)
    assert held_places(wide, [weighted])
    monkeypatch.setattr(PointMass, "implausible", 1e-3 * candidate.usual_sizes().max())
    assert held_places(wide, [weighted]) == []


def test_the_place_of_a_point_holds_also_what_it_is_beside_other_effects():
    def at(place: float, sd: float) -> Any:
        return SimpleNamespace(
            hypothesis=SimpleNamespace(effect=PointMass()),
            values=lambda: np.array([MASS, place]),
            sd=lambda: np.array([1e-4, sd]),
        )

    layout: Any = SimpleNamespace(first=0.1, length=LENGTH)
    alone = _stretch(at(0.5, 0.01), {}, [], layout)
    assert alone == pytest.approx((0.1 + 0.5 - 0.0196, 0.1 + 0.5 + 0.0196), abs=1e-5)
    both = _stretch(at(0.5, 0.01), {}, [at(0.6, 0.02)], layout)
    assert both == pytest.approx((alone[0], 0.1 + 0.6 + 0.0392), abs=1e-5)


@pytest.fixture(scope="module")
def heavier():
    """A light stretch next to an end, of whose width its recording tells little, as fitted from one
    that reaches the end."""
    setup = MassSection().apply(rope(144), np.array(STRETCH))
    nominal = nominal_fit(recorded(setup, seed=5), 72)
    start = np.array([1.5 * STRETCH[0], 0.14, 0.34])
    found = fit_candidate(nominal, Hypothesis(MassSection(), NO_PLACE), start)
    assert found is not None
    return Accepted(found, [], found.evidence, 0.0)


def test_a_stretch_that_reaches_an_end_is_also_fitted_narrower(heavier):
    candidate = heavier.candidate
    mass, centre, width = candidate.values()
    assert centre - width / 2 < 0.03 * LENGTH
    (held,) = held_places(candidate.fit, [heavier])
    there = held.of(candidate)
    seen = centre + width / 2 - max(centre - width / 2, 0.0)
    assert there.values()[2] in (
        pytest.approx(0.5 * seen, rel=1e-3), pytest.approx(0.75 * seen, rel=1e-3)
    )  # fmt: skip
    assert there.values()[0] < mass  # nearer the middle as little does as much
    sizes = sizes_of(candidate, candidate.values(), candidate.sd())
    both = holding_both(sizes, there)["mass"].ci95
    assert both[0] < STRETCH[0] < both[1]


@pytest.mark.parametrize(
    ("centre", "width", "sd", "wanted"),
    [
        (0.5, 0.3, 0.03, []),  # it is known
        (0.5, 0.3, 0.1, [(0.5, 0.104), (0.5, 0.496)]),
        (0.5, 0.3, 0.5, [(0.5, 0.01), (0.5, 0.8)]),  # no narrower than may be, and half the length
        (0.5, 1.0, 0.1, []),  # all of the rope
        (0.95, 0.3, 0.01, [(0.9, 0.1)]),  # of it 0.2 m are on the rope
    ],
)
def test_which_widths_of_a_stretch_are_tried(centre, width, sd, wanted):
    now: Any = SimpleNamespace(
        hypothesis=SimpleNamespace(effect=MassSection()),
        term=SimpleNamespace(lower=np.array([0.0, 0.0, 0.01]), upper=np.array([9.0, 1.0, 2.0])),
        values=lambda: np.array([0.001, centre, width]),
        sd=lambda: np.array([1e-4, 0.01, sd]),
    )
    ends = [end for _, end in _elsewhere(now, LENGTH)]
    assert ends == [pytest.approx(end, abs=1e-3) for end in wanted]


def test_half_an_interval_is_no_shorter_and_no_longer_than_can_be_told():
    assert half_interval(0.0, 2.0) == pytest.approx(0.01)
    assert half_interval(0.05, 2.0) == pytest.approx(0.098, abs=1e-3)
    assert half_interval(np.inf, 2.0) == 1.0
