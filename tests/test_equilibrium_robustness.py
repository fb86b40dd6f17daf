"""Any placement, any start: a state is in equilibrium, or its status says that it is not."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robustness.random_ropes import placements
from reference_simulators.as_ropefit import planar
from reference_simulators.energy_balance import equilibrium_residual
from reference_simulators.planar_elastica import Planar
from ropefit.rod.rod import build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.stability import stability
from ropefit.solvers.status import Status
from tests.rods import DOWN, NOT_HELD, solved

COUNT = 1500


@pytest.mark.parametrize("clamped", [False, True], ids=["pinned", "clamped"])
def test_random_placements(clamped):
    p = placements(COUNT, clamped, seed=1)
    solution = solve(p.rod, p.conditions)
    assert (~solution.converged).sum() <= COUNT // 1000
    off = equilibrium_residual(p.rod, p.conditions, solution)
    assert off[solution.converged].max() < 1e-8
    assert stability(solution)[solution.converged].min() > 0
    assert np.median(solution.iterations) <= 6
    # The check can fail: the same states with one node's frame a little off.
    q = solution.q.copy()
    q[:, 7, 1] += 1e-5
    moved = replace(solution, q=q / np.linalg.norm(q, axis=-1, keepdims=True))
    assert (equilibrium_residual(p.rod, p.conditions, moved) > 1e-8).mean() > 0.99


def test_unconverged_is_marked():
    """Fewer iterations than it takes: the status of just those frames says so, and the residual
    agrees with the check."""
    p = placements(300, True, seed=2)
    whole = solve(p.rod, p.conditions)
    cut = solve(p.rod, p.conditions, limit=5, continuation=False)
    short = whole.iterations >= 5
    assert 20 < short.sum() < 280
    assert np.array_equal(cut.status == Status.LIMIT, short)
    assert np.array_equal(cut.converged, ~short)
    assert equilibrium_residual(p.rod, p.conditions, cut)[cut.converged].max() < 1e-8
    assert cut.residual[short].min() > 1e-14


def test_continuation_in_stiffness():
    """Fewer iterations than it takes from a catenary: strides from a softer or stiffer rope reach
    what they can, by the check and nearly always on the same branch; the rest is marked."""
    p = placements(300, True, seed=2)
    whole = solve(p.rod, p.conditions)
    direct = solve(p.rod, p.conditions, limit=7, continuation=False)
    helped = solve(p.rod, p.conditions, limit=7)
    lost, won = ~direct.converged, helped.converged & ~direct.converged
    assert lost.sum() > 50
    assert won.sum() > 0.7 * lost.sum()
    assert equilibrium_residual(p.rod, p.conditions, helped)[helped.converged].max() < 1e-8
    assert stability(helped)[helped.converged].min() > 0
    assert np.mean(np.abs(helped.x - whole.x).max((1, 2))[won] < 1e-8) > 0.9
    assert np.array_equal(helped.x[~lost], direct.x[~lost])
    still = lost & ~won
    assert np.array_equal(helped.status[still], direct.status[still])


def hanging(apart: float, **properties) -> tuple:
    rod = build(
        uniform(length=1.0, segments=20, bend=1e-3, density=1.0, **properties), DOWN, (False, False)
    )
    ends = np.zeros((1, 2, 3))
    ends[0, 1, 0] = apart
    return rod, Conditions(ends, NOT_HELD)


@pytest.mark.parametrize("apart", [1.001, 1.2, 5.0])
def test_ends_too_far_apart(apart):
    """No rope that does not stretch can be there; one that stretches can."""
    solution = solve(*hanging(apart))
    assert solution.status[0] in (Status.STUCK, Status.LIMIT, Status.NOT_FINITE)
    assert Status(int(solution.status[0])).advice != "converged"
    stretched = solved(*hanging(apart, axial=100.0))
    assert np.linalg.norm(np.diff(stretched.x[0], axis=0), axis=1).sum() > apart


@pytest.mark.parametrize("apart", [1e-9, 1e-4, 0.9999, 0.999999])
def test_nearly_closed_and_nearly_taut(apart):
    rod, conditions = hanging(apart)
    solution = solved(rod, conditions)
    length = np.linalg.norm(np.diff(solution.x[0], axis=0), axis=1)
    assert np.abs(length - rod.length).max() < 1e-12
    assert np.linalg.norm(solution.x[0, -1] - [apart, 0, 0]) < 1e-9


@pytest.mark.parametrize("where", ["load", "stiffness", "length", "flexibility", "rest", "moment"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_rods_that_are_no_numbers(where, value):
    """Only the frames that show such a rope are marked."""
    rod, conditions = hanging(0.6)
    item = getattr(rod, where).copy()
    item[1 if where == "moment" else 3] = value
    broken = rod._replace(**{where: item})
    ropes = type(rod)(*(np.stack([a, b]) for a, b in zip(rod, broken, strict=True)))
    two = Conditions(*(np.tile(v, (2, 1, 1)) for v in (conditions.ends, conditions.clamp)))
    solution = solve(ropes, two)
    assert solution.converged.tolist() == [True, False]
    alone = solved(rod, conditions)
    assert np.array_equal(solution.x[0], alone.x[0])


def test_starts_that_are_no_numbers():
    rod, conditions = hanging(0.6)
    start = solved(rod, conditions)
    q = start.q.copy()
    q[0, 3] = np.nan
    assert solve(rod, conditions, start=replace(start, q=q)).status[0] == Status.NOT_FINITE


def test_support_that_is_no_number():
    rod, conditions = hanging(0.6)
    up = np.array([[[0.0, 0.0, 1.0]]])
    one = np.ones((1, 1))
    for offset, direction in ((np.nan, 1.0), (0.0, np.nan)):
        held = replace(
            conditions, node=np.array([9]), direction=direction * up, offset=offset * one,
            compliance=0 * one,
        )  # fmt: skip
        assert not solve(rod, held).converged.any()


def test_wrong_number_of_ropes():
    rod, conditions = hanging(0.6)
    two = type(rod)(*(np.stack([item, item]) for item in rod))
    three = Conditions(*(np.tile(v, (3, 1, 1)) for v in (conditions.ends, conditions.clamp)))
    with pytest.raises(ValueError, match="2 ropes for 3 frames"):
        solve(two, three)


def test_both_ends_free_falls():
    """Nothing holds it: no equilibrium, and said so."""
    rod, conditions = hanging(0.6)
    loose = replace(conditions, ends=np.full_like(conditions.ends, np.nan))
    assert not solve(rod, loose).converged.any()


def test_threads_change_nothing(monkeypatch):
    p = placements(100, True, seed=4)
    found = []
    for threads in ("1", "2", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        s = solve(p.rod, p.conditions)
        found.append((s.q, s.x, s.reaction, s.iterations, stability(s)))
    for other in found[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found[0], other, strict=True))


def test_continuation_through_a_sweep():
    """Each frame started from the one before, out to nearly taut and back: few iterations, and
    where there is one state only, the one that a catenary start finds."""
    apart = np.concatenate([np.linspace(0.3, 0.99, 40), np.linspace(0.99, 0.3, 40)])
    last, way = None, []
    for value in apart:
        case = Planar(1.0, 5e-3, 1.0, far=(value, 0.05), first=-1.2, last=0.9)
        last = solved(*planar(case, 20), start=last)
        assert np.abs(last.x - solved(*planar(case, 20)).x).max() < 1e-8
        way.append(last)
    assert np.median([s.iterations[0] for s in way[1:]]) <= 5
    assert np.abs(way[0].x - way[-1].x).max() < 1e-8


def test_start_is_left_alone():
    rod, conditions = hanging(0.6)
    start = solved(rod, conditions)
    kept = start.copy()
    solve(*hanging(0.9), start=start)
    for name in ("q", "x", "reaction", "base", "status"):
        assert np.array_equal(getattr(start, name), getattr(kept, name))
