"""A pair that is as good as the one accepted is a tie of it."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.tied_pairs import with_ties
from ropefit.effects import ClampedEnd, DistributedLoad, PointForce, PointMass
from ropefit.inference.least_squares import Fit
from tests.concealed import recorded, rope
from tests.test_calm import fitted

HELD, MASS = (0.002, 0.6, 0.5, -0.6), (0.003, 0.6)  # N m/rad and a direction; kg, m
CLAMP, WEIGHT = Hypothesis(ClampedEnd(0), NO_PLACE), Hypothesis(PointMass(), NO_PLACE)


@pytest.fixture(scope="module")
def told() -> tuple[Fit, list[Accepted]]:
    """A rope with a weight, whose end holds its direction a little: a force next to that end."""
    setup = rope(288)
    for effect, values in ((PointMass(), MASS), (ClampedEnd(0), HELD)):
        setup = effect.apply(setup, np.array(values))
    current, accepted = fitted(recorded(setup, seed=11)), []
    force = Hypothesis(PointForce(), NO_PLACE)
    for hypothesis, start in ((WEIGHT, MASS), (force, (0.05, 0.04, -0.05, 0.015))):
        found = fit_candidate(current, hypothesis, np.array(start))
        assert found is not None
        accepted.append(Accepted(found, [], found.evidence, 0.0))
        current = found.fit
    return current, accepted


def test_an_end_that_holds_the_rope_takes_the_place_of_a_force_next_to_it(told):
    current, accepted = told
    pairs = [[(CLAMP, np.array(HELD)), (WEIGHT, np.array(MASS))]]
    found, now = with_ties(current, accepted, pairs, 10)
    weight, clamp = now
    assert weight is accepted[0]
    assert [clamp.candidate.hypothesis.name, *(c.hypothesis.name for c in clamp.equivalent)] == [
        "clamped_end", "point_force",
    ]  # fmt: skip
    assert found is clamp.candidate.fit
    assert found.cost == pytest.approx(current.cost, abs=3.0)
    assert clamp.candidate.values()[0] == pytest.approx(HELD[0], rel=0.2)


def test_what_is_worse_or_beside_neither_changes_nothing(told):
    current, accepted = told
    load = (Hypothesis(DistributedLoad(), NO_PLACE), np.array([0.0, 0.02, 0.0]))
    for pairs in (
        [],
        [[load, (WEIGHT, np.array(MASS))]],  # far worse in the place of the force
        [[load, (CLAMP, np.array(HELD))]],  # beside neither of the two
    ):
        found, now = with_ties(current, accepted, pairs, 10)
        assert found is current
        assert now is accepted
    assert with_ties(current, accepted[:1], [], 10) == (current, accepted[:1])
