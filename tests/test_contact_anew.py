"""Fits beside contact: they keep the equilibrium that they are in, take a part of a step on which
contact would be lost, and are begun anew where something is still missing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis import contact_anew as module
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.beginning import JUMPED
from ropefit.diagnosis.candidate import compared
from ropefit.diagnosis.contact_anew import contact_anew
from ropefit.diagnosis.full_scan import MARGIN, Scan
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.rules import RULES
from ropefit.effects import Obstacle, PointMass
from ropefit.inference.known import Known
from ropefit.inference.least_squares import fit
from ropefit.inference.objective import Objective
from ropefit.runs.journal import Journal, keeping
from tests.concealed import bar_under, nominal_fit, recorded, rope


class Watched:
    """A model that tells from which point it went on."""

    instantaneous = True

    def __init__(self) -> None:
        self.last: float | None = None
        self.begun: list[float | None] = []

    def at(self, u: np.ndarray) -> Any:
        self.begun.append(self.last)
        self.last = float(u[0])
        return SimpleNamespace(u=u)

    def remember(self, point: Any) -> None:
        self.last = float(point.u[0])

    def kept(self, point: Any) -> dict[str, np.ndarray]:
        return {}

    def restored(self, u: np.ndarray, arrays: Any) -> Any:
        self.last = float(u[0])
        return SimpleNamespace(u=u)


def steps(model: Watched, *values: float) -> None:
    """Evaluate one after the other; those below zero make nothing better."""
    known = Known(model, np.zeros(1))  # type: ignore[arg-type]
    known.begin()
    for value in values:
        point = known.at(np.array([value]))
        if value > 0:
            known.improved(point)


def test_every_step_of_a_fit_begins_in_its_best_state():
    model = Watched()
    steps(model, 1.0, -2.0, -3.0, 4.0, -5.0, 4.0)
    # of the last, which is the best so far, the equilibrium is known
    assert model.begun == [None, 0.0, 1.0, 1.0, 1.0, 4.0]


def test_a_fit_that_goes_on_after_it_was_cut_off_does_so_too():
    kept: list[Any] = []
    with keeping(Journal(save=kept.append)):
        steps(Watched(), 1.0, -2.0)
    model = Watched()
    with keeping(Journal(entries=kept[-1], save=lambda _: None)):
        steps(model, -3.0)
    assert model.begun == [1.0]


class Cliff(Objective):
    """Residuals u - 1 and a slight one of the other value; beyond u = 0.7 contact is lost."""

    def __init__(self) -> None:
        self.forward: Any = SimpleNamespace(bounds=lambda: (np.full(2, -9.0), np.full(2, 9.0)))
        self.trace, self.latest = [], np.empty(0)

    def rows(self, u: np.ndarray) -> np.ndarray:
        lost = 100.0 if u[0] > 0.7 else 0.0
        self.latest = np.array([10 * (u[0] - 1), 0.1 * u[1], lost])
        return self.latest

    def slopes(self, u: np.ndarray) -> np.ndarray:
        return np.array([[10.0, 0.0], [0.0, 0.1], [0.0, 0.0]])


def test_a_part_of_a_step_is_taken_where_the_whole_loses_contact():
    further = Cliff()._by_shorter_step(np.zeros(2))
    assert further is not None
    assert further[0] == pytest.approx(0.5, abs=0.01)
    assert Cliff()._by_shorter_step(np.array([0.69, 0.0])) is None  # every part of it does
    assert Cliff()._by_shorter_step(np.array([0.95, 0.0])) is None  # hardly anything to gain


class CutOff(Cliff):
    """The same, whose trust region stays at the edge after one evaluation."""

    touches, rubs = True, False

    def __init__(self) -> None:
        super().__init__()
        self.forward.with_unit_directions = lambda u: u

    def rows(self, u: np.ndarray) -> np.ndarray:
        out = super().rows(u)
        self.trace.append(float(out @ out))
        return out

    def at(self, u: np.ndarray) -> Any:
        return SimpleNamespace(u=u), None, None

    def _by_trust_region(self, u: np.ndarray, evaluations: int, tolerance: float) -> Any:
        assert evaluations > 0
        self.rows(u)
        return u, np.array([0.5 * self.trace[-1], 0, 1])


def test_a_fit_ends_with_a_part_of_a_step_where_that_takes_the_last_evaluation():
    objective = CutOff()
    found, point = objective.minimum(np.array([0.62, 0.0]), 5, 1e-4)
    assert len(objective.trace) == 5
    assert found["u"][0] == pytest.approx(0.658, abs=1e-3)
    assert point.u is found["u"]  # type: ignore[attr-defined]
    assert found["summary"][:2] == pytest.approx([0.5 * objective.trace[-1], 0])


@pytest.fixture(scope="module")
def bar() -> Any:
    """A rope on a bar, with the fit of that bar, cut off after a few steps from beside it."""
    free = rope(288)
    true = bar_under(free)
    nominal = nominal_fit(recorded(Obstacle().apply(free, true), seed=6))
    hypothesis, start = Hypothesis(Obstacle(), NO_PLACE), true.copy()
    start[0] += 0.004
    term = hypothesis.term(nominal.forward.base, start)
    model = nominal.forward.with_terms([*nominal.forward.terms, term], nominal.point.solution)
    begin = np.concatenate([nominal.point.u, np.zeros(term.size)])
    poor = fit(model, nominal.problem, begin, evaluations=2)
    accepted = Accepted(compared(hypothesis, term, nominal, poor), [], 50.0, 0.0)
    return poor, accepted, true


def test_contact_is_fitted_anew_in_a_better_minimum(bar):
    poor, accepted, true = bar
    anew = contact_anew(poor, [accepted], 6.0)
    assert anew is not None
    better, (now,) = anew
    assert better.cost < min(1.15 * len(better.z), poor.cost - 12.0)
    assert now.evidence == pytest.approx(50.0 + 0.5 * (poor.cost - better.cost))
    term = accepted.candidate.term
    values = term.value(better.point.u[-term.size :])
    assert values[[0, 2, 3]] == pytest.approx(true[[0, 2, 3]], abs=0.005)
    assert contact_anew(better, [now], 6.0) is None  # there is none that is better still


def test_a_start_from_which_the_rope_jumps_is_not_fitted(bar, monkeypatch):
    poor, accepted, _ = bar
    highest = []

    def tried(*_, **options):
        highest.append(options.get("highest"))

    monkeypatch.setattr(module, "attempted", tried)
    assert contact_anew(poor, [accepted], 6.0) is None
    assert highest == [None] + 10 * [JUMPED * poor.cost]  # continued; either way of five values


def test_what_touches_nothing_is_not_fitted_anew(bar):
    poor, _, _ = bar
    mass = Hypothesis(PointMass(), NO_PLACE)
    other: Any = SimpleNamespace(candidate=SimpleNamespace(hypothesis=mass, term=None))
    assert contact_anew(poor, [other], 6.0) is None
    assert contact_anew(poor, [], 6.0) is None


def test_contact_is_not_tried_where_nothing_could_gain_enough(bar):
    poor, _, _ = bar
    scan = Scan(poor, list)
    scan.__dict__["latent"] = SimpleNamespace(evidence=1e3)
    scan.__dict__["scores"] = [SimpleNamespace(log_factor=1e3)]
    most = 0.5 * (float(poor.z @ poor.z) - len(poor.z)) + MARGIN
    assert scan.contact(RULES, most - 1.0)
    assert scan.contact(RULES, most + 1.0) == []
