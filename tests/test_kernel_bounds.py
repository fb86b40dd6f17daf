"""Compiled code never reads or writes past its arrays: what does not belong together is refused
before it, and what does is taken whatever its values are.

`make bounds` runs these tests, and those of everything that calls compiled code, with index checks
compiled in.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ropefit.models.equilibrium import Equilibrium
from ropefit.rod.moving import moving, undamped
from ropefit.rod.potential import Potential
from ropefit.rod.rod import build, uniform
from ropefit.rod.setup import bare
from ropefit.solvers.dynamics import derivatives, problem
from ropefit.solvers.dynamics import solve as dynamics
from ropefit.solvers.equilibrium.conditions import Conditions, FrictionElements
from ropefit.solvers.equilibrium.differentiable import settled
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.potentials import solve_with_potentials
from ropefit.solvers.equilibrium.solution import ARRAYS, Solution, States, unsettled
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.stability import stability
from ropefit.solvers.shapes import ShapeError
from ropefit.solvers.status import Status
from tests.rods import DOWN
from tests.tensors import tensors

STATUSES = (Status.CONVERGED, Status.LIMIT, Status.STUCK, Status.NOT_FINITE, Status.UNSTABLE)
STRANGE = (0.0, 1.0, -1e3, 1e-300, 1e300, np.inf, np.nan)
ENDS = np.array([[0.0, 0.0, 0.0], [0.7, 0.0, 0.0]])


def random_problem(draw) -> tuple:
    """A rod and conditions of random sizes and kinds."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    frames, segments = draw(st.integers(1, 4)), draw(st.integers(2, 9))
    ends = np.tile(ENDS, (frames, 1, 1))
    clamp = np.full((frames, 2, 4), np.nan)
    clamped = (draw(st.booleans()), draw(st.booleans()))
    for end in range(2):
        if clamped[end]:
            clamp[:, end] = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])
    loose = draw(st.sampled_from([None, 0, 1]))
    if loose is not None:
        ends[:, loose] = np.nan
    many = draw(st.integers(0, 4))
    more: dict = {}
    if many:
        direction = rng.normal(size=(frames, many, 3))
        more = {
            "node": rng.integers(0, segments + 1, many),
            "direction": direction / np.linalg.norm(direction, axis=-1, keepdims=True),
            "offset": 0.1 * rng.normal(size=(frames, many)),
            "compliance": 10.0 ** rng.uniform(-3, 1, (frames, many)),
            "active": rng.random((frames, many)) < 0.7,
        }
    if draw(st.booleans()):
        count = draw(st.integers(1, 2))
        more["friction_elements"] = FrictionElements(
            rng.random((frames, count, segments + 1)),
            0.1 * rng.normal(size=(frames, count, segments + 1, 2)),
            0.1 * rng.random((frames, count, segments + 1)),
            0.05 * rng.normal(size=(frames, count, segments + 1, 2)),
            rng.random((frames, count)) < 0.5,
        )
    bend = 10.0 ** rng.uniform(-4, 0)
    rod = build(
        uniform(length=1.0, segments=segments, bend=bend, density=0.1), 9.81 * DOWN, clamped
    )
    if draw(st.booleans()):
        rod = rod.each(frames)
    return rod, Conditions(ends, clamp, **more), seed


@st.composite
def problems(draw) -> tuple:
    return random_problem(draw)


@settings(max_examples=60, deadline=None)
@given(problems(), st.sampled_from(STRANGE), st.sampled_from(STATUSES))
def test_every_solution_can_be_differentiated(problem, value, status):
    """Whatever came out, converged or not, finite or not."""
    rod, conditions, seed = problem
    rng = np.random.default_rng(seed)
    solution = solve(rod, conditions, limit=int(rng.integers(0, 30)))
    frames, segments = solution.q.shape[:2]
    for name in rng.choice(ARRAYS, 2):
        array = getattr(solution, name)
        if array.dtype == np.float64 and array.size:
            array.ravel()[rng.integers(array.size)] = value
    solution.status[rng.integers(frames)] = status
    with np.errstate(all="ignore"):
        dx, turn = tangent(solution, Directions(load=rng.normal(size=(1, 3, segments + 1, 3))))
        assert dx.shape == (frames, 3, segments + 1, 3)
        assert turn.shape == (frames, 3, segments, 3)
        assert stability(solution).shape == (frames,)
        load = torch.tensor(rod.load, requires_grad=True)
        state = settled(solution, tensors(rod)._replace(load=load), tensors(conditions))
        (state.x.sum() + state.q.sum()).backward()
    assert load.grad is not None
    assert load.grad.shape == load.shape


@settings(max_examples=60, deadline=None)
@given(problems(), st.sampled_from([f.name for f in fields(Solution)][:8]), st.integers(0, 2))
def test_arrays_of_other_shapes_are_refused(problem, name, axis):
    rod, conditions, _ = problem
    solution = solve(rod, conditions, limit=1)
    array = getattr(solution, name)
    axis = min(axis, array.ndim - 1)
    more = [(0, int(k == axis)) for k in range(array.ndim)]
    with pytest.raises(ShapeError, match=name):
        replace(solution, **{name: np.pad(array, more)})


@settings(max_examples=40, deadline=None)
@given(problems(), problems())
def test_a_solution_meets_no_other_conditions(one, other):
    """Supports, frames or nodes that differ are told, for a solution and for every start."""
    (rod, conditions, _), (rod_2, conditions_2, _) = one, other
    solution = solve(rod, conditions, limit=1)
    frames, segments = solution.q.shape[:2]
    same = (frames, segments) == (len(conditions_2.ends), rod_2.length.shape[-1])
    if not (same and conditions.supports == conditions_2.supports):
        with pytest.raises(ShapeError):
            replace(solution, rod=rod_2, conditions=conditions_2)
    if not same:
        with pytest.raises(ShapeError):
            solve(rod_2, conditions_2, solution)
    else:
        found = solve(rod_2, conditions_2, solution, limit=2)
        assert found.reaction.shape == (frames, conditions_2.supports)


def test_directions_of_other_shapes_are_refused():
    rod, held = hanging(2, 5)
    solution = solve(rod, held)
    for name, shape in [("load", (1, 2, 5, 3)), ("length", (1, 2, 6)), ("ends", (3, 2, 2, 3))]:
        with pytest.raises(ValueError, match="broadcast"):
            tangent(solution, Directions(**{name: np.zeros(shape)}))


def test_nodes_and_ropes_that_are_not_there_are_refused():
    rod, held = hanging(2, 5)
    across = np.zeros((2, 1, 3))
    one = np.zeros((2, 1))
    for node in (-1, 6):
        with pytest.raises(ShapeError, match="node"):
            solve(rod, replace(held, node=np.array([node]), direction=across, offset=one,
                               compliance=one))  # fmt: skip
    with pytest.raises(ShapeError, match="of"):
        solve(rod, held, member=np.array([0, 1]))


def hanging(frames: int, segments: int):
    rod = build(uniform(length=1.0, segments=segments, bend=1e-3, density=0.1), 9.81 * DOWN,
                (False, False))  # fmt: skip
    none = np.full((frames, 2, 4), np.nan)
    return rod, Conditions(np.tile(ENDS, (frames, 1, 1)), none)


def test_a_start_deep_in_an_obstacle_has_its_own_conditions():
    """A rope that was settled on a plane, and starts far below a higher one, is not tried. What
    comes back belongs to the conditions without supports, and so do its derivatives."""
    rod, held = hanging(3, 20)

    def plane(height: float) -> Potential:
        def derivatives(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            slope, curvature = np.zeros_like(x), np.zeros((*x.shape, 3))
            slope[..., 2] = -200.0 * np.maximum(height - x[..., 2], 0.0)
            curvature[..., 2, 2] = 200.0 * (x[..., 2] < height)
            return slope, curvature

        energy = lambda x: 100.0 * np.maximum(height - x[..., 2], 0.0) ** 2  # noqa: E731
        return Potential(energy, np.ones(21), np.array(200.0), derivatives=derivatives)

    low = solve_with_potentials(rod, held, (plane(-0.2),))
    assert low.converged.all()
    assert low.reaction.shape[1] == low.conditions.supports > 3
    deep = solve_with_potentials(rod, held, (plane(0.4),), low, deepest=0.05)
    assert not deep.converged.any()
    assert deep.reaction.shape == (3, 3)
    assert np.array_equal(deep.x, low.x)
    dx, _ = tangent(deep, Directions(load=np.ones((1, 1, 21, 3))))
    assert dx.shape == (3, 1, 21, 3)


def test_a_fit_that_goes_too_deep_has_derivatives_of_its_own():
    """The same through a model: a point that did not settle can still be asked for its response."""
    setup = bare(
        uniform(length=1.0, segments=20, bend=1e-3, density=0.1), 9.81 * DOWN,
        np.tile(ENDS, (3, 1, 1)), np.full((3, 2, 4), np.nan), np.zeros(3),
    )  # fmt: skip
    from ropefit.effects import SupportPlane

    first = Equilibrium(SupportPlane().apply(setup, np.array([-0.2, 0.0, 0.0])), [])
    point = first.at(np.empty(0))
    assert point.solution.converged.all()
    higher = SupportPlane().apply(setup, np.array([0.4, 0.0, 0.0]))
    model = Equilibrium(higher, [], point.solution)
    model.reached = True  # as in the middle of a fit
    marked = model.at(np.empty(0))
    assert np.isnan(marked.seen).all()
    change = lambda step: higher._replace(gravity=higher.gravity * (1 + step))  # noqa: E731
    assert marked.respond([change]).shape == (1, 3, 21, 3)


def test_unsettled_states_are_marked():
    rod, held = hanging(2, 5)
    found = solve(rod, held)
    marked = unsettled(rod, held, found.states)
    assert not marked.converged.any()
    assert isinstance(found.states, States)
    with pytest.raises(ValueError, match="supports"):
        found.put(0, replace_supports(found))


def replace_supports(solution: Solution) -> Solution:
    """The same states with one support more."""
    frames = len(solution.q)
    one = np.ones((frames, 1))
    more = replace(
        solution.conditions, node=np.array([2]), direction=np.ones((frames, 1, 3)),
        offset=one, compliance=one,
    )  # fmt: skip
    reaction = np.concatenate([solution.reaction, np.zeros((frames, 1))], axis=1)
    return replace(solution, conditions=more, reaction=reaction)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 3), st.integers(2, 6), st.integers(2, 6), st.sampled_from(STRANGE))
def test_motions_of_any_size(clips, segments, steps, value):
    """Every motion can be simulated and differentiated, finished or not; a trajectory with arrays
    of another shape is refused."""
    p = uniform(length=1.0, segments=segments, bend=1e-2, density=0.1)
    rod = build(p, 9.81 * DOWN, (False, False))
    rope = moving(p, rod, undamped(p))
    time = np.tile(np.arange(steps) * 0.01, (clips, 1))
    ends = np.tile(ENDS, (clips, steps, 1, 1))
    ends[0, -1, 1, 0] += value if np.isfinite(value) else 0.5
    none = np.full((clips, steps, 2, 4), np.nan)
    still = solve(rod, Conditions(ends[:, 0], none[:, 0]))
    start = problem.Start(still.x, still.q, 0 * still.x)
    drive = problem.Drive(time, ends, none)
    found = dynamics.solve(rope, drive, start, limit=3)
    with np.errstate(all="ignore"):
        change = derivatives.Directions(load=np.ones((1, 2, segments + 1, 3)))
        dx = derivatives.tangent(found, change)
    assert dx.shape == (clips, 2, steps, segments + 1, 3)
    for name in ("x", "q", "force", "v0", "status"):
        array = getattr(found, name)
        with pytest.raises(ShapeError, match=name):
            replace(found, **{name: np.concatenate([array, array[-1:]])})
