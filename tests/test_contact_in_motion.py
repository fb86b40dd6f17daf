"""Planes and bars as hypotheses of a rope in motion: proposed from where data stop, and fitted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis.candidate import Candidate, fit_candidate
from ropefit.diagnosis.proposals import Start, proposals
from ropefit.effects import Effect, Obstacle, SupportPlane
from ropefit.effects.place import middle_of
from ropefit.effects.stopped import bars_below
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.rod.fields import BAR, PLANE
from tests.test_diagnosis_of_motion import FREE, driven, model, recorded

HEIGHT = -0.325  # m against the middle of the ends: the rope would swing 3 cm below it
BARRED = [0.0, 0.0, -0.41, 0.08]


def left(effect: Effect | None, values: list[float]) -> Fit:
    """The nominal fit to a recording of a rope that touches something, or nothing."""
    lines, data = recorded(effect, values, seed=5)
    problem = FitProblem(data, Noise(marker=3e-4), 12)
    return fit(model(driven(24), lines, FREE), problem, None, 8)


def proposed(current: Fit, name: str) -> list[Start]:
    return [p[0] for p in proposals(current, slow=True) if p[0][0].name == name]


def fitted(current: Fit, start: Start) -> Candidate:
    found = fit_candidate(current, *start)
    assert found is not None
    return found


def test_bodies_of_a_setup():
    setup = SupportPlane().apply(driven(24), np.array([HEIGHT, 0.1, 0.0]))
    setup = Obstacle().apply(setup, np.array([*BARRED, 0.3]))
    bodies = setup.bodies
    assert bodies is not None
    assert bodies[:, 7].tolist() == [PLANE, BAR]
    assert np.linalg.norm(bodies[:, 3:6], axis=-1) == pytest.approx(np.ones(2))
    assert float(bodies[1, 6]) == BARRED[3]
    assert not setup.potentials


def test_a_table_under_a_swinging_rope():
    current = left(SupportPlane(), [HEIGHT, 0.0, 0.0])
    (start,) = proposed(current, "support_plane")
    assert start[1][0] == pytest.approx(HEIGHT, abs=0.002)
    found = fitted(current, start)
    assert found.evidence > 100
    assert (found.gains > 0).all()
    assert found.values()[0] == pytest.approx(HEIGHT, abs=0.003)
    assert found.values()[1:] == pytest.approx([0.0, 0.0], abs=0.03)


def test_a_thick_bar_under_a_swinging_rope():
    current = left(Obstacle(), [*BARRED, 0.0])
    found = max(
        (fitted(current, start) for start in proposed(current, "obstacle")),
        key=lambda c: c.evidence,
    )
    assert found.evidence > 300
    (flat,) = proposed(current, "support_plane")
    assert fitted(current, flat).evidence < 0.5 * found.evidence
    top = found.values()[2] + found.values()[3]
    assert top == pytest.approx(BARRED[2] + BARRED[3], abs=0.005)


def test_nothing_is_proposed_where_nothing_is_touched():
    current = left(None, [])
    assert not proposed(current, "support_plane")
    assert not proposed(current, "obstacle")


def test_a_bar_that_is_entered_deeply_is_proposed_though_it_removes_little():
    """After it was touched the rope is elsewhere, on either side of where the fitted one is."""
    moves = np.zeros((60, 3))
    places = np.stack([np.linspace(-0.4, 0.4, 60), np.zeros(60), np.full(60, -0.4)], axis=1)
    for lifted in (0.004, 0.03):
        moves[25:35, 2] = lifted
        moves[:, 1] = 3 * lifted * np.sign(np.arange(60) - 30)
        misfit: Any = SimpleNamespace(
            frame=np.zeros(60, int), places=places, moves=moves, setup=driven(24)
        )
        origin = middle_of(misfit.setup)
        misfit.places = places + origin
        found = bars_below(misfit, np.array([0.0, 1.0, 0.0]))
        assert bool(found) == (lifted > 0.02)
