"""Stability: loads at which ropes buckle, what they buckle into, and ropes with two answers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv

from reference_simulators.as_ropefit import planar
from reference_simulators.closed_forms import buckled_reach
from reference_simulators.planar_elastica import Planar
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.stability import stability
from ropefit.solvers.status import Status
from tests.rods import NOT_HELD, Order, solved

SEGMENTS = (10, 20, 40)
# Ends of a strut of length 1 m and EI 1 N m², and the load that buckles it (Euler).
STRUTS = {
    "pinned": ((False, False), math.pi**2),
    "clamped, free": ((True, False), math.pi**2 / 4),
    "clamped": ((True, True), 4 * math.pi**2),
}


def strut(name: str, segments: int, load: float = 0.0, weight: float = 0.0):
    """Upright, end 0 below; end 1 slides along z under a load, or is free."""
    clamped = STRUTS[name][0]
    down = np.array([0.0, 0.0, -weight])
    rod = build(uniform(length=1.0, segments=segments, bend=1.0, twist=10.0), down, clamped)
    pushed = rod.load.copy()
    pushed[-1, 2] -= load
    ends = np.zeros((1, 2, 3))
    ends[0, 1] = np.nan
    clamp = NOT_HELD.copy()
    for end in range(2):
        if clamped[end]:
            clamp[0, end] = np.array([1.0, 0.0, 0.0, 0.0])
    conditions = Conditions(ends, clamp)
    if name != "clamped, free":
        zero = np.zeros((1, 2))
        across = np.eye(3)[None, :2]
        conditions = replace(
            conditions, node=np.full(2, segments), direction=across, offset=zero, compliance=zero
        )
    return rod._replace(load=pushed), conditions


def straight(name: str, segments: int) -> Solution:
    """Pulled a little, so that it is straight; it stays in equilibrium when pushed."""
    rod, conditions = strut(name, segments, load=-1e-3)
    solution = solved(rod, conditions)
    assert np.abs(solution.x[0, :, :2]).max() < 1e-12
    return solution


def under(solution: Solution, rod: Rod, conditions: Conditions) -> Solution:
    """The same states under another load, where they are still in equilibrium."""
    return replace(solution, rod=rod, conditions=conditions)


@pytest.mark.parametrize("name", STRUTS)
def test_euler_load(name):
    """The smallest eigenvalue is the bending stiffness less the load, and crosses zero there."""
    critical = STRUTS[name][1]
    errors = []
    for segments in SEGMENTS:
        still = straight(name, segments)

        def smallest(load: float, segments=segments, still=still) -> float:
            return float(stability(under(still, *strut(name, segments, load)))[0])

        found = brentq(smallest, 0.5 * critical, 1.5 * critical, xtol=1e-9)
        assert smallest(0.6 * critical) == pytest.approx(found - 0.6 * critical, rel=1e-5)
        assert smallest(1.2 * critical) == pytest.approx(found - 1.2 * critical, rel=1e-5)
        errors.append(abs(found / critical - 1))
    Order(SEGMENTS, tuple(errors)).check()


def test_column_under_its_own_weight():
    """Greenhill: a clamped column buckles at ρ g L³/EI = 9/4 j², J_{-1/3}(j) = 0."""
    critical = 2.25 * brentq(lambda j: jv(-1 / 3, j), 1.0, 3.0) ** 2
    assert critical == pytest.approx(7.8373, abs=1e-3)
    errors = []
    for segments in SEGMENTS:
        still = straight("clamped, free", segments)
        found = brentq(
            lambda weight, still=still, segments=segments: float(
                stability(under(still, *strut("clamped, free", segments, weight=weight)))[0]
            ),
            5.0, 10.0, xtol=1e-9,
        )  # fmt: skip
        errors.append(abs(found / critical - 1))
    Order(SEGMENTS, tuple(errors)).check()


@pytest.mark.parametrize("name", ["pinned", "clamped"])
def test_buckled_strut(name):
    """Started exactly straight under 1.1 times the critical load, it leaves that state, and ends
    where the elastica does; a turn about the load's line costs nothing, and is no instability."""
    critical = STRUTS[name][1]

    def error(segments: int) -> float:
        rod, conditions = strut(name, segments, load=1.1 * critical)
        still = straight(name, segments)
        assert stability(under(still, rod, conditions))[0] < -0.05 * critical
        solution = solved(rod, conditions, start=still.states)
        assert abs(stability(solution)[0]) < 1e-5 * critical
        assert np.abs(solution.x[0, :, :2]).max() > 0.1
        return abs(solution.x[0, -1, 2] - buckled_reach(1.1, 1.0))

    Order((20, 40, 80), tuple(error(n) for n in (20, 40, 80))).check()


def ring(segments: int, ratio: float):
    """A closed ring of length 1 m with one whole turn of twist; ratio is GJ/EI.

    It may turn about the clamp's tangent at no cost: a support half way round holds it from that.
    """
    gravity = np.zeros(3)
    properties = uniform(length=1.0, segments=segments, bend=1.0, twist=ratio)
    clamp = np.zeros((1, 2, 4))
    clamp[..., 0] = 1.0
    zero = np.zeros((1, 1))
    conditions = Conditions(
        np.zeros((1, 2, 3)), clamp, np.array([segments // 2]),
        np.array([[[1.0, 0.0, 0.0]]]), zero, zero,
    )  # fmt: skip
    rod = build(properties, gravity, (True, True))
    solution = solved(rod, conditions, turns=np.ones(1))
    return solution, float(stability(solution)[0])


def test_michells_ring():
    """A twisted ring leaves its plane at the twist 2π√3 EI/GJ (Michell 1889; Goriely 2006): with
    one turn at GJ/EI = √3."""
    errors = []
    for segments in (40, 80, 160):
        ratios = np.array([1.5, 1.55, 1.6, 1.65])
        values = []
        for ratio in ratios:
            solution, value = ring(segments, ratio)
            assert np.linalg.svd(solution.x[0] - solution.x[0].mean(0))[1][2] < 1e-3
            values.append(value)
        # The eigenvalue of the plane ring, continued to where it vanishes.
        curve = np.polynomial.Polynomial.fit(ratios, values, 3)
        root = brentq(curve, 1.65, 1.8)
        errors.append(abs(root - math.sqrt(3)))
    Order((40, 80, 160), tuple(errors)).check(slack=0.4)
    assert errors[-1] < 2e-3


def test_twisted_ring_leaves_its_plane():
    solution, value = ring(40, 1.65)
    assert np.linalg.svd(solution.x[0] - solution.x[0].mean(0))[1][2] < 2e-3
    assert value > 0
    solution, value = ring(20, 1.85)
    assert np.linalg.svd(solution.x[0] - solution.x[0].mean(0))[1][2] > 0.05
    assert value > 0


def bent_cable(angle: float, segments: int = 40):
    """A cantilever with a set, clamped `angle` degrees above the horizontal; GJ is 2 EI."""
    rod, conditions = planar(
        Planar(1.0, 0.05, 1.0, first=math.radians(angle), curvature=1.0), segments
    )
    return rod._replace(stiffness=rod.stiffness * np.array([1.0, 1.0, 3.0])), conditions


def swept(angles: np.ndarray) -> Solution:
    """Each frame started from the one before."""
    solution = None
    for angle in angles:
        solution = solved(*bent_cable(angle), start=solution)
    assert solution is not None
    return solution


def test_two_stable_states_of_a_cantilever():
    """Clamped 160° from the plumb line it may hang to either side: the state is that of the
    previous frame, and the other one is found from another start."""
    right, left = swept(np.linspace(10, 70, 13)), swept(np.linspace(110, 70, 9))
    assert right.x[0, -1, 0] > 0.5
    assert left.x[0, -1, 0] < -0.5
    for solution in (right, left):
        assert stability(under(solution, *bent_cable(70.0)))[0] > 1e-3
        again = solved(*bent_cable(70.0), start=solution)
        assert np.abs(again.x - solution.x).max() < 1e-9
    # Further on there is only one: whichever it comes from, it jumps there.
    ends = [swept_from(start, 80.0).x[0, -1, 0] for start in (right, left)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-6)


def swept_from(start: Solution, angle: float) -> Solution:
    return solved(*bent_cable(angle), start=start)


def test_unstable_state_is_left():
    """Newton's method alone would stay in an unstable equilibrium: the straight column."""
    rod, conditions = strut("clamped, free", 20, weight=12.0)
    solution = solve(rod, conditions, start=straight("clamped, free", 20))
    assert solution.status[0] == Status.CONVERGED
    assert abs(solution.x[0, -1, :2]).max() > 0.2
    assert stability(under(straight("clamped, free", 20), rod, conditions))[0] < 0
