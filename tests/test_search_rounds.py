"""What one round of the search hands to the next."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ropefit.diagnosis import reassessment
from ropefit.diagnosis import search as rounds
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.mixed_pairs import beside_contact
from ropefit.diagnosis.rules import RULES, Selection
from ropefit.diagnosis.search import ENDED, search
from ropefit.effects import Obstacle, PointMass, StiffSection, SupportPlane, Tether
from ropefit.inference.least_squares import fit
from ropefit.inference.problem import POTENTIALS_COST, Work
from tests.concealed import nominal_fit, recorded, with_effect


class RestartedOnce(Selection):
    """A model that is restarted by the first leader, about which nothing is then proposed."""

    def __init__(self) -> None:
        self.rounds, self.restarts = 0, 0

    def candidates(self, *arguments, **named):
        self.rounds += 1
        return [] if self.rounds == 2 else super().candidates(*arguments, **named)

    def restarted(self, current, best, share):
        self.restarts += 1
        return current if self.restarts == 1 else None


def test_what_restarts_the_model_is_compared_with_it_again():
    setup = with_effect(PointMass(), [0.002, 0.37])
    rules = replace(RULES, effects=("point_mass", "stiff_section"), selection=RestartedOnce())
    found = search(nominal_fit(recorded(setup, seed=1)), 0, lambda *_: None, rules)
    assert [one.candidate.hypothesis.name for one in found.accepted] == ["point_mass"]
    assert rules.selection.restarts > 1  # type: ignore[attr-defined]


def single(effect, evidence):
    hypothesis, values = Hypothesis(effect, NO_PLACE), np.array([evidence])
    return SimpleNamespace(hypothesis=hypothesis, evidence=evidence, values=lambda: values)


def test_what_explained_most_alone_is_tried_beside_contact():
    singles = [
        single(Obstacle(), 30.0), single(StiffSection(), 20.0), single(PointMass(), 10.0),
        single(PointMass(), 5.0), single(StiffSection(), -1.0),
    ]  # fmt: skip
    touched = [SimpleNamespace(candidate=single(SupportPlane(), 30.0))]
    starts = beside_contact(touched, singles)  # type: ignore[arg-type]
    assert [(h.name, v.tolist()) for ((h, v),) in starts] == [
        ("stiff_section", [20.0]), ("point_mass", [10.0]),
    ]  # fmt: skip
    weighed = [SimpleNamespace(candidate=single(PointMass(), 30.0))]
    assert beside_contact(weighed, singles) == []  # type: ignore[arg-type]
    assert beside_contact([], singles) == []  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("significant", "costs_more", "left"),
    [(True, 1.0, 2), (False, 1.0, 1), (False, 20.0, 2), (False, None, 2)],
)
def test_an_effect_that_the_last_fit_leaves_insignificant_is_dropped(
    monkeypatch, significant, costs_more, left
):
    """Unless its evidence says that it is there all the same, or the model without it has none."""
    current = SimpleNamespace(cost=100.0)
    other = None if costs_more is None else SimpleNamespace(cost=100.0 + costs_more)
    first, second = (
        Accepted(Candidate(*[None] * 5), [], 10.0, 0.0)
        for _ in range(2)  # type: ignore
    )
    weak = {id(first): significant, id(second): True}
    marks = iter([weak[id(one)] for one in (first, second)])
    monkeypatch.setattr(reassessment, "significant", lambda candidate: next(marks))
    monkeypatch.setattr(reassessment, "_needed", lambda *_: False)
    monkeypatch.setattr(reassessment, "without_effects", lambda *_: other)
    monkeypatch.setattr(reassessment, "comparable", lambda *_: True)
    monkeypatch.setattr(reassessment, "last_fit", lambda fit: fit)
    fitted, kept = reassessment.without_insignificant(current, [first, second], 6.0)  # type: ignore
    assert len(kept) == left
    assert kept[-1] is second
    assert fitted is (current if left == 2 else other)


@pytest.mark.parametrize(
    ("left", "first", "singles", "compared", "with_all"),
    [
        (True, "same", 1, 0, True),  # no pair was better than it by itself
        (True, "other", 1, 1, True),
        (True, None, 1, 1, True),
        (False, "same", 1, 1, False),  # with those that tie, but not beside single ones
        (False, "same", 0, 1, True),  # there is none
    ],
)
def test_pairs_are_not_compared_again_beside_what_was_better_by_itself(
    monkeypatch, left, first, singles, compared, with_all
):
    at_rest = SimpleNamespace(
        forward=SimpleNamespace(instantaneous=True), problem=SimpleNamespace(work=Work())
    )
    one, two = (
        SimpleNamespace(candidate=SimpleNamespace(hypothesis=Hypothesis(e, NO_PLACE)))
        for e in (PointMass(), StiffSection())
    )
    calls = []

    def pairs(current, accepted, *_):
        calls.append(accepted)
        return current, accepted

    monkeypatch.setattr(rounds, "reassessed", lambda current, accepted, *_: (current, accepted))
    monkeypatch.setattr(rounds, "as_points", lambda current, accepted, _: (current, accepted))
    monkeypatch.setattr(rounds, "may_lack_more", lambda _: left)
    monkeypatch.setattr(rounds, "two_instead", pairs)
    alone = {"same": one, "other": two, None: None}[first]
    accepted = [one, two]
    found = rounds._weighed_again(at_rest, accepted, 6.0, 10, RULES, [one] * singles, alone)  # type: ignore
    assert found == (at_rest, accepted, accepted if with_all else None)
    assert len(calls) == compared


def test_evaluations_of_all_fits_to_some_data_are_counted():
    nominal = nominal_fit(recorded(with_effect(PointMass(), [0.002, 0.37]), seed=1))
    problem, first = nominal.problem, nominal.evaluations
    assert problem.work.evaluations == first
    few = problem.frames(np.arange(6)).under(problem.noise)
    setup = nominal.forward.base.frames(np.arange(6))
    model = type(nominal.forward)(setup, nominal.forward.terms)
    again = fit(model, few, nominal.point.u, evaluations=3)
    assert problem.work.evaluations == first + again.evaluations
    thread = Tether().apply(setup, np.array([0.05, 0.0, 0.0, -0.003, 0.6]))
    held = fit(type(nominal.forward)(thread, nominal.forward.terms), few, evaluations=3)
    total = first + again.evaluations + POTENTIALS_COST * held.evaluations
    assert problem.work.evaluations == total


@pytest.fixture(scope="module")
def with_two():
    setup = StiffSection().apply(with_effect(PointMass(), [0.03, 0.37]), np.array([0.5, 0.7, 0.2]))
    return recorded(setup, seed=5)


@pytest.mark.parametrize(
    ("most", "effects", "verdict"), [(1, 0, "unknown"), (90, 2, "unknown"), (np.inf, 2, "found")]
)
def test_after_the_evaluations_that_it_may_take_a_search_ends(with_two, most, effects, verdict):
    """What was accepted by then stays, and is not called found."""
    names = ("point_mass", "stiff_section")
    rules = replace(RULES, effects=names, most_evaluations=most)
    found = search(nominal_fit(with_two), 0, lambda *_: None, rules)
    assert len(found.accepted) == effects
    assert found.verdict == verdict
    assert len(found.final.forward.terms) == len(found.nominal.forward.terms) + effects
    said = ENDED.split("{}")[0]
    assert any(reason.startswith(said) for reason in found.refused) is (verdict == "unknown")


def test_no_fit_begins_after_the_evaluations_that_may_be_taken():
    nominal = nominal_fit(recorded(with_effect(PointMass(), [0.002, 0.37]), seed=1))
    work, taken = nominal.problem.work, nominal.problem.work.evaluations
    with work.limited(taken + 1):
        again = fit(nominal.forward, nominal.problem, nominal.point.u, evaluations=3)
        fit(nominal.forward, nominal.problem, nominal.point.u, evaluations=3)
        pytest.fail("a fit began")
    assert work.exhausted
    assert work.evaluations == taken + again.evaluations
    fit(nominal.forward, nominal.problem, nominal.point.u, evaluations=3)  # without a limit again
    with work.limited(work.evaluations + 1):
        fit(nominal.forward, nominal.problem, nominal.point.u, evaluations=3)
    assert not work.exhausted
