"""Two effects of different kinds that a search one after the other misses."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis import explored_pairs, mixed_pairs, search
from ropefit.diagnosis.accepted import CLOSE_EVIDENCE, Accepted
from ropefit.diagnosis.candidate import cost_for, fit_candidate
from ropefit.diagnosis.explored_pairs import ENOUGH, EVALUATIONS, LOOK, explored
from ropefit.diagnosis.few_frames import FAR_BEHIND
from ropefit.diagnosis.fits import silent
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.mixed_pairs import _best_on_few_frames, two_instead
from ropefit.diagnosis.rules import RULES
from ropefit.diagnosis.unexplained import leaves_something
from ropefit.effects import PointMass, StiffSection, Tether
from ropefit.inference.least_squares import attempted
from tests.concealed import recorded, rope
from tests.test_calm import fitted

MASS, STIFF = (0.003, 0.72), (1.0, 0.35, 0.2)
NAMES = ("point_mass", "stiff_section", "tether")


@pytest.fixture(scope="module")
def both():
    """The nominal fit to a rope with a weight and a stiff section."""
    setup = rope(288)
    for effect, values in ((PointMass(), MASS), (StiffSection(), STIFF)):
        setup = effect.apply(setup, np.array(values))
    return fitted(recorded(setup, seed=107))


def one_after_the_other(nominal, *starts):
    current, accepted = nominal, []
    for effect, start in starts:
        found = fit_candidate(current, Hypothesis(effect, NO_PLACE), np.array(start))
        assert found is not None
        accepted.append(Accepted(found, [], found.evidence, 0.0))
        current = found.fit
    return current, accepted


def test_two_kinds_take_the_place_of_what_stood_for_both(both):
    current, wrong = one_after_the_other(both, (Tether(), [0.01, 0.0, 0.0, 0.0, 0.45]))
    found, accepted = two_instead(current, wrong, 6.0, replace(RULES, effects=NAMES))
    values = {a.candidate.hypothesis.name: a.candidate.values() for a in accepted}
    assert set(values) == {"point_mass", "stiff_section"}
    assert values["point_mass"] == pytest.approx(MASS, rel=0.15)
    assert values["stiff_section"][1] == pytest.approx(STIFF[1], abs=0.03)
    assert found.cost < current.cost - 20


def test_what_is_right_stays(both):
    right = one_after_the_other(both, (StiffSection(), STIFF), (PointMass(), MASS))
    assert two_instead(*right, 6.0, replace(RULES, effects=NAMES)) == right
    clean = fitted(recorded(rope(288), seed=108))
    assert two_instead(clean, [], 6.0, replace(RULES, effects=NAMES)) == (clean, [])


def test_what_stands_for_another_gives_way_beside_what_is_right(both):
    """A tether in place of the stiff stretch leaves something; beside the weight the scan shows
    what is there."""
    weight = (Hypothesis(PointMass(), NO_PLACE), np.array(MASS))
    wrong = (Hypothesis(Tether(), NO_PLACE), np.array([0.01, 0.0, 0.0, 0.0, 0.35]))
    best, *_ = _best_on_few_frames(both, [(0.0, weight, wrong)], NAMES, 0.0)
    places = {hypothesis.name: values[-2:] for hypothesis, values in best}
    assert set(places) & {"point_mass", "tether"}  # a tether may pull as a weight does
    assert places["stiff_section"] == pytest.approx(STIFF[1:], abs=0.05)


def test_two_of_a_kind_that_leave_nothing_are_compared_with_two_of_different_kinds(monkeypatch):
    """Two opposite forces bend a rope nearly as it bends where it is soft, and noise hides what
    they leave."""
    setup = rope(144)
    for weight in ((0.003, 0.25), (0.003, 0.75)):
        setup = PointMass().apply(setup, np.array(weight))
    nominal, compared = fitted(recorded(setup, seed=103)), []

    def instead(current, accepted, *_, **__):
        compared.append([one.candidate.hypothesis.name for one in accepted])
        return current, accepted

    monkeypatch.setattr(search, "two_instead", instead)
    names = ("point_mass", "mass_section", "kink")
    found = search.search(nominal, 0, silent, replace(RULES, effects=names))
    assert len(found.accepted) == 2
    assert not leaves_something(found.final)
    assert compared == [["point_mass", "point_mass"]]


def test_a_pair_whose_fits_end_alike_is_not_begun_again(both, monkeypatch):
    weight = (Hypothesis(PointMass(), NO_PLACE), np.array(MASS))
    stiff = (Hypothesis(StiffSection(), NO_PLACE), np.array(STIFF))
    pairs, ended = [(0.0, weight, stiff)] * (ENOUGH + 2), defaultdict(list)
    assert len(explored(both, pairs, ended, 2)) == 1  # it leaves no more than noise
    monkeypatch.setattr(explored_pairs, "leaves_something", lambda *_: True)
    ended.clear()
    assert len(explored(both, pairs, ended, 2)) == ENOUGH
    assert not explored(both, pairs[:1], ended, 2)


def test_a_pair_is_begun_again_where_none_of_its_fits_has_ended(both, monkeypatch):
    weight = (Hypothesis(PointMass(), NO_PLACE), np.array(MASS))
    stiff = (Hypothesis(StiffSection(), NO_PLACE), np.array(STIFF))
    elsewhere = (weight[0], np.array([MASS[0], MASS[1] - 0.3]))
    ended, begun = defaultdict(list), []
    explored(both, [(0.0, weight, stiff)] * ENOUGH, ended, 2)

    def noted(few, starts):
        begun.append(starts[0])

    monkeypatch.setattr(explored_pairs, "settled_start", noted)
    explored(both, [(0.0, weight, stiff), (0.0, elsewhere, stiff)], ended, 2)
    assert begun == [elsewhere]


def test_a_pair_must_come_near_to_those_that_go_on(both, monkeypatch):
    """The pair that comes closest soon is fitted first, and the others are stopped without prospect
    of being nearly as good as the one of a rank."""
    weight = (Hypothesis(PointMass(), NO_PLACE), np.array(MASS))
    stiff = (Hypothesis(StiffSection(), NO_PLACE), np.array(STIFF))
    wrong = (Hypothesis(Tether(), NO_PLACE), np.array([0.01, 0.0, 0.0, 0.0, 0.35]))
    pairs, needed = [(9.0, weight, wrong), (1.0, weight, stiff)], []

    def noted(*args, **kwargs):
        if "needed" in kwargs:  # of those that are fitted further
            needed.append(kwargs["needed"])
        return attempted(*args, **kwargs)

    monkeypatch.setattr(explored_pairs, "attempted", noted)
    (best,) = explored(both, pairs, defaultdict(list), 0)
    assert best.starts[1][0].name == "stiff_section"
    assert needed == [np.inf, pytest.approx(best.fit.cost + 2 * FAR_BEHIND)]
    needed.clear()
    explored(both, pairs, defaultdict(list), 1)  # the best leaves noise
    assert needed[1] < np.inf
    needed.clear()
    monkeypatch.setattr(explored_pairs, "leaves_something", lambda *_: True)
    explored(both, pairs, defaultdict(list), 1)  # both go on
    assert needed == [np.inf, np.inf]


def test_only_pairs_that_come_closest_soon_are_fitted_further(both, monkeypatch):
    weight = (Hypothesis(PointMass(), NO_PLACE), np.array(MASS))
    stiff = (Hypothesis(StiffSection(), NO_PLACE), np.array(STIFF))
    wrong = (Hypothesis(Tether(), NO_PLACE), np.array([0.01, 0.0, 0.0, 0.0, 0.35]))
    evaluations = []

    def noted(*args, **kwargs):
        evaluations.append(args[3])
        return attempted(*args, **kwargs)

    monkeypatch.setattr(explored_pairs, "attempted", noted)
    monkeypatch.setattr(explored_pairs, "MOST_CONTINUED", 1)
    pairs = [(9.0, weight, wrong), (5.0, wrong, stiff), (1.0, weight, stiff)]
    (best,) = explored(both, pairs, defaultdict(list), 1)
    assert {h.name for h, _ in best.starts} == {"point_mass", "stiff_section"}
    assert evaluations == [LOOK, LOOK, LOOK, EVALUATIONS - LOOK]


def test_what_explains_as_much_as_the_best_is_not_stopped(both):
    """What is missed by far is so alike in all frames: what explains all of it leaves noise, and
    what explains little leaves the like, which scales its evidence down."""
    assert both.spread > 100
    weight = Hypothesis(PointMass(), NO_PLACE), np.array(MASS)
    stiff = Hypothesis(StiffSection(), NO_PLACE), np.array(STIFF)
    (pair,) = explored(both, [(0.0, weight, stiff)], defaultdict(list), 0)
    assert pair.fit.cost < cost_for(both, CLOSE_EVIDENCE * pair.evidence)
    little = 0.9 * both.cost
    assert little > cost_for(both, 0.5 * (both.cost - little))
    clean = fitted(recorded(rope(288), seed=108))
    assert cost_for(clean, 5.0) == pytest.approx(clean.cost - 10.0, rel=1e-3)
    noise = len(clean.z)
    near_noise = replace(clean, cost=1.5 * noise, spread=30.0)
    assert noise < cost_for(near_noise, 0.1 * noise) < 1.5 * noise  # not below what noise leaves


def test_without_prospect_of_what_counts_no_pair_goes_on(both, monkeypatch):
    """Nor is anything looked for beside one of two that explain too little."""
    weight = (Hypothesis(PointMass(), NO_PLACE), np.array(MASS))
    wrong = (Hypothesis(Tether(), NO_PLACE), np.array([0.01, 0.0, 0.0, 0.0, 0.35]))
    stiff = (Hypothesis(StiffSection(), NO_PLACE), np.array(STIFF))
    beside = []
    monkeypatch.setattr(mixed_pairs, "_with_another", lambda pair, *_: beside.append(pair) or [])
    pairs = [(1.0, weight, wrong)]
    assert _best_on_few_frames(both, pairs, NAMES, 10.0)
    assert beside
    beside.clear()
    (right,) = explored(both, [(0.0, weight, stiff)], defaultdict(list), 0)
    assert not _best_on_few_frames(both, pairs, NAMES, right.evidence)
    assert not beside
    assert _best_on_few_frames(both, [(0.0, weight, stiff)], NAMES, 0.9 * right.evidence)
