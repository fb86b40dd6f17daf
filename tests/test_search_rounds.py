"""What one round of the search hands to the next."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.mixed_pairs import beside_contact
from ropefit.diagnosis.rules import RULES, Selection
from ropefit.diagnosis.search import search
from ropefit.effects import Obstacle, PointMass, StiffSection, SupportPlane
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
