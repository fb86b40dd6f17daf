"""A search that begins with what was found in more frames."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis import search as rounds
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.fewer_frames import FoundBefore, known_again, pair_again
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.rules import RULES
from ropefit.diagnosis.search import Diagnosis, search
from ropefit.effects import PointMass, StiffSection, SupportPlane
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import Fit, fit
from tests.concealed import nominal_fit, recorded, rope

WEIGHT, SECTION, NEEDED = [0.002, 0.37], [2.0, 0.75, 0.2], 6.0
LEFT = np.array([0, 1, 2, 3, 5, 6, 8, 9, 10, 11])


@pytest.fixture(scope="module")
def changed() -> Data:
    """With a weight, and a stiffer stretch."""
    setup = StiffSection().apply(rope(288), np.array(SECTION))
    return recorded(PointMass().apply(setup, np.array(WEIGHT)), seed=1)


@pytest.fixture(scope="module")
def found(changed) -> Diagnosis:
    rules = replace(RULES, effects=("point_mass", "stiff_section"))
    return search(nominal_fit(changed), 0, lambda *_: None, rules)


def without_frames(found: Diagnosis, data: Data) -> Fit:
    """The model without effects, of the frames that are left."""
    was = found.nominal
    few = was.forward.of_setup(
        was.forward.base.frames(LEFT), was.point.solution.frames(LEFT), was.forward.terms
    )
    problem = replace(was.problem, data=data).frames(LEFT)
    return fit(few, problem, was.point.u)


def before(found: Diagnosis) -> FoundBefore:
    return FoundBefore(found.accepted, found.final, found.of_known, LEFT)


def test_two_that_were_found_are_found_again(found, changed):
    assert len(found.accepted) == 2
    again = pair_again(without_frames(found, changed), before(found), [], NEEDED, 10)
    assert again is not None
    whole, both = again
    assert len(whole.point.seen) == len(LEFT)
    for one in both:
        truth = {"point_mass": WEIGHT, "stiff_section": SECTION}[one.candidate.hypothesis.name]
        size, sd = one.candidate.values()[0], one.candidate.sd()[0]
        assert abs(size - truth[0]) < 3 * sd
        assert 1e-3 * truth[0] < sd < 0.2 * truth[0]


def test_what_the_frames_that_are_left_do_not_show_is_not(found):
    bare = without_frames(found, recorded(rope(288), seed=1))
    assert pair_again(bare, before(found), [], NEEDED, 10) is None


def test_nor_what_explains_no_more_than_one_effect(found, changed):
    current = without_frames(found, changed)
    for evidence, taken in ((1e4, False), (10.0, True)):
        single: Any = SimpleNamespace(evidence=evidence)
        again = pair_again(current, before(found), [single], NEEDED, 10)
        assert (again is not None) == taken


def test_one_effect_is_looked_for_anew_and_so_is_what_is_slow(found, changed):
    current = without_frames(found, changed)
    hypothesis = Hypothesis(SupportPlane(), NO_PLACE)
    slow: Any = SimpleNamespace(candidate=SimpleNamespace(hypothesis=hypothesis))
    for accepted in ([], found.accepted[:1], [found.accepted[0], slow]):
        assert (
            pair_again(current, replace(before(found), accepted=accepted), [], NEEDED, 10) is None
        )


def test_candidates_beside_the_rope_as_known_are_fitted_again(found, changed):
    mass = Hypothesis(PointMass(), np.array([WEIGHT[1:]]))
    one = fit_candidate(found.nominal, mass, np.array(WEIGHT))
    assert one is not None
    current = without_frames(found, changed)
    (again,) = known_again(current, replace(before(found), of_known=[one]))
    anew = fit_candidate(current, mass, np.array(WEIGHT))
    assert anew is not None
    assert len(again.fit.point.seen) == len(LEFT)
    assert (np.abs(again.values() - anew.values()) < 0.5 * anew.sd()).all()
    np.testing.assert_allclose(again.evidence, anew.evidence, rtol=0.01)


def test_a_search_without_frames_ends_with_what_was_found(found, changed, monkeypatch):
    def never(*_, **__):
        pytest.fail("pairs are compared anew")

    monkeypatch.setattr(rounds, "two_instead", never)
    rules = replace(RULES, effects=("point_mass", "stiff_section"))
    result = search(without_frames(found, changed), 0, lambda *_: None, rules, before(found))
    names = [[one.candidate.hypothesis.name for one in d.accepted] for d in (found, result)]
    assert sorted(names[0]) == sorted(names[1])
    assert result.verdict == "found"
