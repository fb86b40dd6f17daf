"""Dahl's friction: closed form along a line, its potential, what the solver takes of it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ropefit.effects import GradualFriction
from ropefit.rod.dahl import strained
from ropefit.solvers.equilibrium.solve import solve
from tests.test_exporters import dahl_moments
from tests.test_memory import check_derivatives, settled, there_and_back

REACH = 1.3


@pytest.fixture(scope="module")
def drawn():
    """Strains no larger than the range, and moves from far below to far above it."""
    rng = np.random.default_rng(0)
    strain, move = rng.normal(size=(2, 300, 2))
    strain *= REACH * rng.uniform(0, 1, (300, 1)) / np.linalg.norm(strain, axis=1)[:, None]
    return strain, move * 10 ** rng.uniform(-4, 1, (300, 1))


def potential(strain: np.ndarray, move: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(move, axis=-1)
    gone = -np.expm1(-size / REACH)
    return REACH * gone * (strain * move).sum(-1) / size + REACH * (size - REACH * gone)


def differences(f, at: np.ndarray) -> np.ndarray:
    step = 1e-5 * np.linalg.norm(at, axis=1, keepdims=True)
    sides = [(f(at + step * a) - f(at - step * a)).T / (2 * step[:, 0]) for a in np.eye(2)]
    return np.moveaxis(np.array(sides), 0, -1)


def test_the_strain_is_the_slope_of_a_potential(drawn):
    strain, move = drawn
    found = strained(strain, move, np.full(300, REACH))
    slope = differences(lambda d: potential(strain, d), move)
    np.testing.assert_allclose(found.strain, slope, atol=1e-6)
    rows = differences(lambda d: strained(strain, d, np.full(300, REACH)).strain, move)
    np.testing.assert_allclose(found.by_move, rows.transpose(1, 0, 2), atol=1e-6)
    rows = differences(lambda e: strained(e, move, np.full(300, REACH)).strain, strain)
    np.testing.assert_allclose(found.by_strain, rows.transpose(1, 0, 2), atol=1e-6)
    ends = [strained(strain, move, np.full(300, REACH + h)).strain for h in (-1e-6, 1e-6)]
    np.testing.assert_allclose(found.by_range, (ends[1] - ends[0]) / 2e-6, atol=1e-6)
    # No softer than that beside any rope, nor is the friction larger.
    assert np.linalg.eigvalsh(found.by_move).min() > -0.003
    assert np.linalg.norm(found.strain, axis=1).max() < 1.015 * REACH


@pytest.mark.parametrize("steps", [1, 12])
def test_along_a_line_it_is_dahls_from_the_first_way_on(steps):
    corners = np.array([0.0, 2.0, -1.0, 0.5, 0.4, 4.0])
    path = np.concatenate([np.linspace(a, b, steps + 1)[1:] for a, b in pairwise(corners)])
    way, e, found = np.array([0.6, 0.8]), np.zeros(2), []
    for a, b in pairwise(np.r_[0.0, path]):
        e = strained(e, (b - a) * way, np.array(REACH)).strain
        found.append(e)
    wanted = dahl_moments(np.r_[0.0, path], REACH, REACH)[1:]
    np.testing.assert_allclose(found, wanted[:, None] * way, atol=1e-12)


def test_derivatives_through_the_history_are_exact():
    """At values for which no bend is just about to turn: the moment's slope has a step there."""
    check_derivatives(GradualFriction(), [2e-4, 1.5])


def test_the_solver_takes_the_same_law():
    """What balances the rope in a frame is the strain of the memory, in two dimensions."""
    setup = GradualFriction().apply(there_and_back(40, 12), np.array([3e-4, 1.0]))
    point = settled(setup)
    step = point.steps[7]
    elements = step.solution.conditions.friction_elements
    assert elements is not None
    assert elements.gradual.all()
    assert np.abs(elements.strain).max() > 0
    # The same forces, as springs that are fixed: the rope stays.
    after = point.steps[8].before.strain
    vector = point.steps[8].before.vector
    drag = elements.drag
    fixed = type(elements).slipping(drag, vector - after[None], np.full_like(elements.slip, np.inf))
    held = step.solution.conditions
    again = solve(
        step.solution.rod, type(held)(held.ends, held.clamp, friction_elements=fixed),
        step.solution,
    )  # fmt: skip
    np.testing.assert_allclose(again.x, step.solution.x, atol=1e-9)
