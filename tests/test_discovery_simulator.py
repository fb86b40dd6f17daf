"""The reference simulators against closed forms: nothing here asks ropefit."""

from __future__ import annotations

import ast
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from benchmarks.discovery.following import followed
from reference_simulators.collocation import solve
from reference_simulators.kirchhoff_rod import (
    CLAMPED,
    FREE,
    PINNED,
    Ends,
    catenary,
    facing,
    follow,
    hang,
    problem,
)
from reference_simulators.rod_equations import Point, Rod, Section, rotation
from tests.conftest import ROOT

WEIGHT = 0.05 * 9.81  # N/m
# Modules that state the reference problems in ropefit's terms, or check its states by its energy.
BRIDGES = {"as_ropefit.py", "energy_balance.py", "rod_energy.py"}


def test_simulators_share_no_code_with_ropefit():
    modules = sorted((ROOT / "reference_simulators").glob("*.py"))
    assert len(modules) > 8
    for path in modules:
        imported = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split(".")[0])
        assert not imported & {"benchmarks", "tests"}, path.name
        assert ("ropefit" in imported) == (path.name in BRIDGES), path.name


def pinned(first, last) -> Ends:
    positions = np.array([[first, last]], dtype=float)
    return Ends(positions, np.tile([1.0, 0, 0, 0], (1, 2, 1)), (PINNED, PINNED))


def cantilever(rod: Rod):
    """A rope clamped level at end 0 and free at end 1: the problem and its states."""
    level = np.roll(facing(np.array([1.0, 0.0, 0.0])).as_quat(), 1)
    held = Ends(np.zeros((1, 2, 3)), np.tile(level, (1, 2, 1)), (CLAMPED, FREE))
    first = problem(rod, held)
    y = np.zeros((1, len(first.mesh), 13))
    y[..., 0], y[..., 3:7] = first.mesh, level

    def at(part):
        eased = replace(rod, gravity=(0.0, 0.0, -9.81 * max(part, 1e-3)))
        return replace(first, rod=eased)

    return first, follow(at, y, first=0.0)


def test_a_limp_rope_hangs_as_a_catenary():
    """The bending length of EI/(w L^3) = 1e-6 is 1 % of L; the shape differs by its square."""
    rod = Rod(1.0, 0.05, 1e-6 * WEIGHT, 1e-6 * WEIGHT)
    solved, y = hang(rod, pinned([-0.3, 0.1, 0.1], [0.3, 0.0, 0.0]), elements=160)
    tangents, force = catenary(rod, *solved.held.positions[0], solved.mesh)
    middle = slice(len(solved.mesh) // 4, -len(solved.mesh) // 4)
    np.testing.assert_allclose(rotation(y[0, :, 3:7])[middle, :, 2], tangents[middle], atol=2e-3)
    np.testing.assert_allclose(y[0, :, 7:10], force, atol=2e-3 * WEIGHT)
    spline = CubicHermiteSpline(solved.mesh, y[0, :, :3], rotation(y[0, :, 3:7])[..., 2])
    steps = np.diff(spline(np.linspace(0, 1, 4001)), axis=0)
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(1.0, abs=1e-4)


def test_a_stiff_cantilever_bends_as_a_beam():
    """w L^4 / 8 EI at the tip, and w x^2 (6 L^2 - 4 L x + x^2) / 24 EI along it."""
    rod = Rod(1.0, 0.05, 20 * WEIGHT, 15 * WEIGHT)
    solved, y = cantilever(rod)
    x = solved.mesh
    beam = -WEIGHT * x**2 * (6 - 4 * x + x**2) / (24 * rod.bending)
    np.testing.assert_allclose(y[0, :, 2], beam, atol=2e-3 * abs(beam[-1]))
    np.testing.assert_allclose(y[0, 0, 10:], [0.0, 0.5 * WEIGHT, 0.0], atol=1e-3 * WEIGHT)


def test_a_soft_cantilever_as_scipy_has_it():
    """The planar elastica, EI theta'' = w (L - s) cos theta, by scipy's own solver."""
    rod = Rod(1.0, 0.05, 0.05 * WEIGHT, 0.04 * WEIGHT)
    solved, y = cantilever(rod)
    s = np.linspace(0, 1, 101)

    def slope(s, u):
        return np.stack([u[1], (1 - s) * np.cos(u[0]) / 0.05])

    found = solve_bvp(
        slope, lambda a, b: np.array([a[0], b[1]]), s, np.stack([-s, s - 1]), tol=1e-8
    )
    assert found.success
    theta = found.sol(solved.mesh)[0]
    np.testing.assert_allclose(rotation(y[0, :, 3:7])[:, 2, 2], np.sin(theta), atol=1e-5)


def test_a_mass_on_a_limp_rope_makes_a_corner():
    """The force of the rope jumps by the weight of the mass; nothing else holds the rope."""
    rod = Rod(1.0, 0.05, 1e-4 * WEIGHT, 1e-4 * WEIGHT)
    held = pinned([-0.35, 0.0, 0.0], [0.35, 0.0, 0.0])
    solved, y = hang(rod, held, breaks=[0.4])
    heavy = replace(solved, rod=replace(rod, points=(Point(0.4, mass=0.02),)))
    z = follow(lambda part: replace(heavy, rod=replace(
        rod, points=(Point(0.4, mass=0.02 * part),))), y)  # fmt: skip
    total = z[0, -1, 9] - z[0, 0, 9]
    assert total == pytest.approx(WEIGHT + 0.02 * 9.81, abs=1e-8)
    node = int(np.argmin(np.abs(solved.mesh - 0.4)))
    step = z[0, node + 1, 9] - z[0, node, 9] - WEIGHT * np.diff(solved.mesh)[node]
    assert step == pytest.approx(0.02 * 9.81, abs=1e-8)
    assert z[0, :, 2].min() < y[0, :, 2].min() - 0.005


def test_a_finer_mesh_changes_nothing():
    rod = Rod(1.0, 0.05, 2e-4 * WEIGHT, 1.5e-4 * WEIGHT)
    positions = np.array([[[-0.5, 0.2, 0.1], [0.0, 0.0, 0.0]]])
    turns = [[1.0, 0.3, -0.4], [1.0, 0.0, 0.4]]
    turns = np.array(
        [[np.roll(facing(np.array(t) / np.linalg.norm(t)).as_quat(), 1) for t in turns]]
    )
    held = Ends(positions, turns, (CLAMPED, CLAMPED))
    shapes = []
    for elements in (80, 160):
        solved, y = hang(rod, held, elements=elements)
        assert np.allclose(solve(solved, y), y, atol=1e-9)
        curve = CubicHermiteSpline(solved.mesh, y[0, :, :3], rotation(y[0, :, 3:7])[..., 2])
        shapes.append(curve(np.linspace(0, 1, 50)))
    np.testing.assert_allclose(*shapes, atol=2e-5)


def test_mujoco_agrees_on_a_rope_with_a_mass():
    """Two simulators with nothing in common; 0.3 mm on a rope that the mass moves by 8 mm."""
    pytest.importorskip("mujoco")
    from reference_simulators import mujoco_rope

    rod = Rod(1.0, 0.05, 1e-3 * WEIGHT, 8e-4 * WEIGHT)
    held = pinned([-0.6, 0.1, 0.1], [0.0, 0.0, 0.0])
    solved, y = hang(rod, held, breaks=[0.4])
    heavy = replace(rod, points=(Point(0.4, mass=0.005),))
    z = follow(lambda part: replace(solved, rod=heavy if part == 1.0 else rod), y)
    s, nodes = mujoco_rope.shapes(heavy, held, 0.008)
    curve = CubicHermiteSpline(solved.mesh, z[0, :, :3], rotation(z[0, :, 3:7])[..., 2])
    assert np.linalg.norm(z[0, :, :3] - y[0, :, :3], axis=1).max() > 0.005
    assert np.linalg.norm(nodes[0] - curve(s), axis=1).max() < 0.0003


def test_shapes_follow_from_frame_to_frame():
    """Frames that were solved to somewhere else than their neighbours are solved from these."""
    rod = Rod(1.0, 0.05, 1e-2 * WEIGHT, 1e-2 * WEIGHT)
    apart = np.linspace(0.5, 0.6, 6)
    places = np.array([[[-0.5 * d, 0.0, 0.0], [0.5 * d, 0.0, 0.0]] for d in apart])
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (6, 2, 1))
    solved, plain = hang(rod, Ends(places, turns, (PINNED, PINNED)))
    heavier = replace(solved, rod=replace(rod, density=1.1 * rod.density))
    right = solve(heavier, plain)
    jumped = right.copy()
    jumped[4:, :, 2] += 0.02
    np.testing.assert_allclose(followed(heavier, plain, jumped), right, atol=1e-8)
    assert followed(heavier, plain, right) is right


def test_half_a_turn_about_the_rope_is_not_the_orientation_that_a_clamp_holds():
    rod = Rod(1.0, 0.05, 1e-3, 1e-3)
    level = facing(np.array([1.0, 0.0, 0.0]))
    turns = [level * Rotation.from_rotvec([0.0, 0.0, angle]) for angle in (0.0, 2.0, np.pi)]
    wanted, *turned = (np.roll(turn.as_quat(), 1) for turn in turns)
    held = Ends(np.zeros((1, 2, 3)), np.tile(wanted, (1, 2, 1)), (CLAMPED, CLAMPED))
    for frame, angle in zip(turned, (2.0, np.pi), strict=True):
        y = np.zeros((1, 13))
        y[:, 3:7] = frame
        first, last = problem(rod, held).ends(np.array([0]), y, y)
        np.testing.assert_allclose(np.abs(first[0, :5]), [0, 0, 0, 0, 0], atol=1e-12)
        np.testing.assert_allclose(np.abs([first[0, 5], last[0, 5]]), angle, atol=1e-12)


def test_a_rope_that_rests_curved_is_twisted_by_as_much_as_its_clamp_is_turned():
    """With sines for the angle of a clamp Newton ended half a turn off."""
    rod = Rod(0.86, 0.034, 3.5e-5, 2.7e-5)
    ends = np.array([[[0.35, 0.05, 0.1], [0.0, 0.0, 0.0]]])
    down = np.array([[-0.3, 0.0, -1.0], [-0.3, 0.0, 1.0]])
    turns = [np.roll(facing(d / np.linalg.norm(d)).as_quat(), 1) for d in down]
    plain, y = hang(rod, Ends(ends, np.array([turns]), (CLAMPED, CLAMPED)))
    free = np.stack([y[:, 0, 3:7], y[:, -1, 3:7]], axis=1)
    section = Section(0.16, 0.75, curvature=(-1.04, -3.86))
    fixed = Ends(ends, free, (CLAMPED, CLAMPED))
    goal = replace(plain, rod=rod, held=fixed, gauge=False)
    for angle in (1.0, 2.0857):
        turned = Rotation.from_quat(np.roll(free[0, 0], -1)) * Rotation.from_rotvec([0, 0, angle])
        wanted = free.copy()
        wanted[0, 0] = np.roll(turned.as_quat(), 1)
        curved = replace(rod, sections=(section,))
        end = replace(goal, rod=curved, held=replace(fixed, orientations=wanted))
        states = follow(lambda _, end=end: end, y)
        assert abs(states[0, 0, 3:7] @ wanted[0, 0]) == pytest.approx(1.0, abs=1e-9)
