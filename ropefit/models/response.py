"""What small changes of a setup change of what is seen.

How a setup depends on a value is cheap and smooth: it is differenced, to nine digits, and to seven
in errors of the set-up. How the rope answers is the one exact linear solve of
`solvers/equilibrium/implicit.py`, for all changes at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ropefit.models.bends import vectors
from ropefit.models.differences import DIFFERENCE_STEP, sensor_slope, slope, turn_slope
from ropefit.rod.axial import at_tension
from ropefit.rod.bending import Springs, moment_changes, springs
from ropefit.rod.off_axis import off_axis, off_axis_turned
from ropefit.rod.rod import DIMS, Rod
from ropefit.rod.setup import SensorModel, Setup
from ropefit.solvers.equilibrium.followers import loads, rotated
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.potentials import Nodes, acted_on, force_of
from ropefit.solvers.equilibrium.solution import Solution, States

# The setup where one value has moved by so many of its scales from where its difference is taken:
# about the point itself, or about a step beside it.
Change = Callable[[float], Setup]
# Indices (f,) of frames, and changes (P, f, K, 3) of the nodes there.
Parts = Iterator[tuple[np.ndarray, np.ndarray]]
LOAD = Rod._fields.index("load")
AT_ONCE, FEWEST = 4e6, 8  # bytes of answers in memory at once, of that many frames at least


@dataclass
class Point:
    """A model evaluated at search variables u (P,): setup, states, and nodes as seen (F, K, 3)."""

    u: np.ndarray
    setup: Setup
    solution: Solution
    seen: np.ndarray

    @property
    def converged(self) -> np.ndarray:
        """Return (F,) bool: which frames could be computed."""
        return self.solution.converged

    def respond(self, changes: list[Change], turned: bool = False) -> np.ndarray:
        """Return (P, F, K, 3) first-order changes of the nodes as seen, for P changed setups.

        turned: a rope that spins at no cost turns in every frame until a rest curvature, which has
        one sign, costs least.
        """
        if not changes:
            return np.zeros((0, *self.seen.shape))
        slopes = slopes_of(self.setup, changes, self.solution)
        return self._moved(self.solution, slopes, turned)

    def parts(self, changes: list[Change], turned: bool = False) -> Parts:
        """Yield indices (f,) of frames and `respond` (P, f, K, 3) there, until all are: of all
        frames together it is large."""
        if not changes:
            return
        slopes = slopes_of(self.setup, changes, self.solution)
        for index, few in in_parts(self.solution, len(changes)):
            yield index, self._moved(few, [s.frames(index, len(self.seen)) for s in slopes], turned)

    def by_loads(self, many: int, load: Callable[[np.ndarray], np.ndarray]) -> Parts:
        """Yield the same for so `many` loads (f, P, K, 3) [N] on the nodes of a rope at rest, as
        given for indices (f,) of frames."""
        for index, few in in_parts(self.solution, many):
            moved = tangent(few, Directions(load=load(index)))
            yield index, np.moveaxis(seen_move(self.setup, few.q, *moved), 1, 0)

    def _moved(self, solution: Solution, slopes: list[Slopes], turned: bool) -> np.ndarray:
        """Return (P, f, K, 3) changes of the nodes as seen in the frames of a solution."""
        which = [k for k, s in enumerate(slopes) if s.moves_rope]
        moving = [slopes[k] for k in which]
        dx = np.zeros((len(solution.x), len(slopes), *solution.x.shape[1:]))
        if moving:
            directions = directions_of(solution.rod, moving, len(solution.x))
            if turned:
                directions = turned_to_bends(directions, solution.rod, vectors(solution))
            directions = with_law(directions, solution, moving)
            directions = with_axial_law(directions, solution.rod, [solution], moving)
            dx[:, which] = seen_move(self.setup, solution.q, *tangent(solution, directions))
        return add_sensor(dx, slopes, self.setup.sensor)


def seen_move(setup: Setup, q: np.ndarray, dx: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return (F, P, N+1, 3) [m] changes of the markers' positions on a rope with frames q (F, N,
    4), from changes dx (F, P, N+1, 3) [m] of its nodes and turns (F, P, N, 3) [rad] of its frames.
    """
    if setup.off_axis is None:
        return dx
    return dx + off_axis_turned(setup.off_axis, q, turn)


def in_parts(solution: Solution, many: int) -> Iterator[tuple[np.ndarray, Solution]]:
    """Yield indices of some frames and the solution there, until all are; many: changes that are
    asked for."""
    every = np.arange(len(solution.x))
    few = max(FEWEST, int(AT_ONCE / (many * solution.x[:1].nbytes)))
    if len(every) <= few:
        yield every, solution
        return
    for k in range(0, len(every), few):
        index = every[k : k + few]
        yield index, solution.frames(index)


def slopes_of(setup: Setup, changes: list[Change], solution: States) -> list[Slopes]:
    """Return the slopes of every change of a setup, with the rope in the states of a solution."""
    still = [np.zeros(field.shape) for field in setup.rod()]
    nodes = acted_on(setup.potentials, solution.x)
    return [_slopes(setup, changed, solution, still, nodes) for changed in changes]


def directions_of(rods: Rod, slopes: list[Slopes], frames: int) -> Directions:
    """Return all changes at once; of each field with a row for each frame where one of them needs
    it, else with one."""
    # Loads that differ from frame to frame: of inertia, and the forces of potentials.
    if any(s.force is not None or s.rod[LOAD].ndim == 3 for s in slopes):
        rods = rods.each(frames)
    fields = []
    for k in range(len(rods)):
        values = [s.rod[k] for s in slopes]
        if k == LOAD:
            values = [s.rod[k] if s.force is None else s.rod[k] + s.force for s in slopes]
        own = rods[k].shape[rods.length.ndim - 1 :]
        if all(v.ndim == len(own) for v in values):
            fields.append(np.stack(values)[None])
        else:
            fields.append(np.stack([np.broadcast_to(v, (frames, *own)) for v in values], axis=1))
    return Directions(
        *fields,
        ends=np.stack([s.ends for s in slopes], axis=1),
        clamp=np.stack([s.clamp for s in slopes], axis=1),
    )


def turned_to_bends(directions: Directions, rods: Rod, bends: np.ndarray) -> Directions:
    """Return directions with rest vectors, about the first director, turned towards the bends (F,
    N+1, 2) of each frame, all of a frame alike."""
    stiff = rods.stiffness.reshape(-1, 1, bends.shape[1], 3)[..., :1]
    assert directions.rest is not None
    size = directions.rest[..., :1]
    way = (stiff * size * bends[:, None]).sum(axis=2, keepdims=True)
    way /= np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-300)
    return directions._replace(rest=np.pad(size * way, [(0, 0)] * 3 + [(0, 1)]))


def law_moments(slopes: list[Slopes], vector: np.ndarray) -> np.ndarray:
    """Return (F, P, N+1, 2) [N m] derivatives of the moments of a law of bending at vectors (F,
    N+1, 2) that stay."""
    out = np.zeros((len(vector), len(slopes), *vector.shape[1:]))
    changed = [k for k, s in enumerate(slopes) if s.springs is not None]
    pairs = [s.springs for s in slopes if s.springs is not None]
    for k, moments in zip(changed, moment_changes(pairs, DIFFERENCE_STEP, vector), strict=True):
        out[:, k] = moments
    return out


def with_law(directions: Directions, solution: Solution, slopes: list[Slopes]) -> Directions:
    """Return directions with the moments of a law of bending that change, as a change of the rest
    shape: that is how the solver takes them."""
    if all(s.springs is None for s in slopes):
        return directions
    moved = law_moments(slopes, vectors(solution))
    stiff = solution.rod.stiffness.reshape(-1, 1, moved.shape[2], 3)[..., :2]
    assert directions.rest is not None
    rest = np.array(np.broadcast_to(directions.rest, (*moved.shape[:3], 3)))
    rest[..., :2] -= moved / np.where(stiff > 0, stiff, np.inf)
    return directions._replace(rest=rest)


def tensions(solution: Solution) -> np.ndarray:
    """Return (F, N) [N] the force along each segment's tangent."""
    way = np.zeros_like(solution.force)
    way[..., 2] = 1.0
    return (solution.force * rotated(solution.q, way)).sum(-1)


def with_axial_law(
    directions: Directions, rods: Rod, solutions: list[Solution], slopes: list[Slopes]
) -> Directions:
    """Return directions with a law of axial strain that changes, as a change of the flexibility
    under the tensions of each frame of some solutions."""
    if all(s.axial is None for s in slopes):
        return directions
    soft = rods.flexibility[..., 2]
    assert directions.flexibility is not None
    tension = np.concatenate([tensions(solution) for solution in solutions])
    rows = len(tension), len(slopes), tension.shape[1], 3
    out = np.array(np.broadcast_to(directions.flexibility, rows))
    for k, s in enumerate(slopes):
        if s.axial is not None:
            out[:, k, :, 2] += soft * at_tension(s.axial, tension)
    return directions._replace(flexibility=out)


def add_sensor(dx: np.ndarray, slopes: list[Slopes], seen: SensorModel) -> np.ndarray:
    """Return (P, F, K, 3) as seen, of changes dx (F, P, K, 3) of the nodes."""
    dx = np.moveaxis(dx, 1, 0) * (1 - float(seen.lag))
    for moved, s in zip(dx, slopes, strict=True):
        # The sensor's small errors move a change of the rope by a change of second order only.
        moved += s.seen
    return dx


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the rod's fields, the force [N] of potentials, the ends [m], the clamps' turns
    [rad] and what is seen [m] at nodes that stay, in one value. springs: a law of bending
    `DIFFERENCE_STEP` to either side; axial (A,): of a law of axial strain. same_rod: whether all
    derivatives of the rod's fields are zero."""

    rod: list[np.ndarray]
    force: np.ndarray | None
    ends: np.ndarray
    clamp: np.ndarray
    seen: np.ndarray
    springs: tuple[Springs, Springs] | None
    axial: np.ndarray | None
    same_rod: bool

    @property
    def moves_rope(self) -> bool:
        """Return whether the value changes the rope or what holds it, and not only what is seen."""
        if any(law is not None for law in (self.force, self.springs, self.axial)):
            return True
        rod = () if self.same_rod else self.rod
        return any(item.any() for item in (self.ends, self.clamp, *rod))

    def frames(self, index: np.ndarray, frames: int) -> Slopes:
        """Return the slopes in some of the frames; what is the same in all stays as it is."""
        if len(index) == frames:
            return self
        rod = [v[index] if v.ndim > d else v for v, d in zip(self.rod, DIMS, strict=True)]
        force = None if self.force is None else self.force[index]
        seen = self.seen[index] if self.seen.ndim == 3 else self.seen
        return replace(
            self, rod=rod, force=force, ends=self.ends[index], clamp=self.clamp[index], seen=seen
        )


def _slopes(
    now: Setup, changed: Change, states: States, still: list[np.ndarray], nodes: list[Nodes]
) -> Slopes:
    """Return the slopes of one change; still: the rod's fields' derivatives where nothing that it
    is built from changes; nodes: those that each potential acts on now."""
    x, q = states.x, states.q
    # What does not depend on the value is the same object.
    a, b = changed(-DIFFERENCE_STEP), changed(DIFFERENCE_STEP)
    rod, law = still, None
    if a.bending is not b.bending or not _equal(_built_from(a), _built_from(b)):
        rods = a.rod(), b.rod()
        rod = [slope(p, q) for p, q in zip(*rods, strict=True)]
        if a.bending is not None or b.bending is not None:
            law = springs(a.bending, rods[0]), springs(b.bending, rods[1])
    elif not _equal(_loaded_by(a), _loaded_by(b)):  # a rod takes longer to build
        rod = list(still)
        rod[LOAD] = slope(a.node_loads(), b.node_loads())
    force = None
    if a.potentials is not b.potentials:
        low, high = (force_of(s.potentials, x, nodes) for s in (a, b))
        force = None if np.array_equal(low, high) else slope(low, high)
    if a.followers is not b.followers:
        low, high = (loads(s.followers, q, x.shape[-2]) for s in (a, b))
        following = (high - low) / (2 * DIFFERENCE_STEP)
        force = following if force is None else force + following
    axial = None
    if a.axial is not b.axial:
        assert a.axial is not None
        assert b.axial is not None
        axial = slope(a.axial, b.axial)
    clamp = turn_slope(now.clamp, a.clamp, b.clamp)
    ends = np.zeros(a.ends.shape) if a.ends is b.ends else slope(a.ends, b.ends)
    beside = x if now.off_axis is None else x + off_axis(now.off_axis, q)
    seen = sensor_slope(a, b, beside)
    if a.off_axis is not b.off_axis:
        assert a.off_axis is not None
        assert b.off_axis is not None
        seen = seen + off_axis(slope(a.off_axis, b.off_axis), q)
    return Slopes(rod, force, ends, clamp, seen, law, axial, same_rod=rod is still)


def same_rod(a: Setup, b: Setup) -> bool:
    """Return whether two setups have the same rod: all that it is built from is equal."""
    parts = _built_from, _loaded_by
    return all(_equal(of(a), of(b)) for of in parts)


def _built_from(setup: Setup) -> list[np.ndarray]:
    """Return what a rod is built from, but the dead loads of its nodes."""
    s = setup
    return [*s.properties, s.moment, s.clamp_compliance, s.kinks, s.stretch]


def _loaded_by(setup: Setup) -> list[np.ndarray]:
    """Return what the dead loads of the nodes are made from, besides what the rod is."""
    return [setup.gravity, setup.load, setup.mass]


def _equal(first: Iterable[np.ndarray], second: Iterable[np.ndarray]) -> bool:
    return all(p is q or np.array_equal(p, q) for p, q in zip(first, second, strict=True))
