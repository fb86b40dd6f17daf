"""A search that begins with what was found in more frames."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis.fewer_frames import FoundBefore, found_again
from ropefit.diagnosis.rules import RULES, Selection
from ropefit.diagnosis.search import Diagnosis, search
from ropefit.effects import PointMass, SupportPlane
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import Fit, fit
from tests.concealed import nominal_fit, recorded, rope, with_effect

MASS, PLACE, NEEDED = 0.002, 0.37, 6.0
LEFT = np.array([0, 1, 2, 3, 5, 6, 8, 9, 10, 11])


@pytest.fixture(scope="module")
def weighed() -> Data:
    return recorded(with_effect(PointMass(), [MASS, PLACE]), seed=1)


@pytest.fixture(scope="module")
def found(weighed) -> Diagnosis:
    rules = replace(RULES, effects=("point_mass", "stiff_section"))
    return search(nominal_fit(weighed), 0, lambda *_: None, rules)


def without_frames(found: Diagnosis, data: Data) -> Fit:
    """The model without effects, of the frames that are left."""
    was = found.nominal
    few = was.forward.of_setup(
        was.forward.base.frames(LEFT), was.point.solution.frames(LEFT), was.forward.terms
    )
    problem = replace(was.problem, data=data).frames(LEFT)
    return fit(few, problem, was.point.u)


def before(found: Diagnosis) -> FoundBefore:
    return FoundBefore(found.accepted, found.final, LEFT)


def test_what_was_found_is_found_again(found, weighed):
    again = found_again(without_frames(found, weighed), before(found), NEEDED, 10)
    assert again is not None
    whole, (one,) = again
    truth = np.array([MASS, PLACE])
    assert len(whole.point.seen) == len(LEFT)
    assert one.candidate.hypothesis.name == "point_mass"
    assert (np.abs(one.candidate.values() - truth) < 3 * one.candidate.sd()).all()
    assert 0.5 * found.accepted[0].evidence < one.evidence < 1.5 * found.accepted[0].evidence
    assert 0.01 * MASS < one.candidate.sd()[0] < 0.1 * MASS


def test_what_the_frames_that_are_left_do_not_show_is_not(found):
    bare = without_frames(found, recorded(rope(288), seed=1))
    assert found_again(bare, before(found), NEEDED, 10) is None


def test_nothing_is_taken_over_of_slow_fits_nor_of_none(found, weighed):
    current = without_frames(found, weighed)
    hypothesis = SimpleNamespace(effect=SupportPlane())
    slow: Any = SimpleNamespace(candidate=SimpleNamespace(hypothesis=hypothesis))
    for accepted in ([slow], [*found.accepted, slow], []):
        assert found_again(current, replace(before(found), accepted=accepted), NEEDED, 10) is None


class Counted(Selection):
    """How often candidates are fitted."""

    def __init__(self) -> None:
        self.rounds = 0

    def candidates(self, *arguments, **named):
        self.rounds += 1
        return super().candidates(*arguments, **named)


@pytest.mark.parametrize(("again", "rounds"), [(True, 0), (False, 1)])
def test_a_search_begins_with_what_was_found(found, weighed, again, rounds):
    selection = Counted()
    rules = replace(
        RULES, effects=("point_mass", "stiff_section"), selection=selection, most_effects=1
    )
    current = without_frames(found, weighed)
    result = search(current, 0, lambda *_: None, rules, before(found) if again else None)
    assert [one.candidate.hypothesis.name for one in result.accepted] == ["point_mass"]
    assert (result.verdict, selection.rounds) == ("found", rounds)
