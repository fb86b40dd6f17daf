"""What small changes of a setup change of what is seen: how the rope answers to its slopes, by the
one exact linear solve of `solvers/equilibrium/implicit.py`, for all changes at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ropefit.models.bends import vectors
from ropefit.models.slopes import LOAD, Change, Slopes, slopes_of
from ropefit.rod.axial import at_tension
from ropefit.rod.bending import Springs, moment_changes
from ropefit.rod.off_axis import off_axis_turned
from ropefit.rod.rod import Rod
from ropefit.rod.sensor import SensorModel
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.followers import rotated
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.solution import Solution

# Indices (f,) of frames, and changes (P, f, K, 3) of the nodes there.
Parts = Iterator[tuple[np.ndarray, np.ndarray]]
AT_ONCE, FEWEST = 16e6, 8  # bytes of answers in memory at once, of that many frames at least


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

    def parts(
        self, changes: list[Change], turned: bool = False, nodes: np.ndarray | None = None
    ) -> Parts:
        """Yield indices (f,) of frames and `respond` (P, f, K, 3) there, until all are: of all
        frames together it is large; nodes (K,): only of these, in order."""
        if not changes:
            return
        slopes = slopes_of(self.setup, changes, self.solution)
        for index, few in in_parts(self.solution, len(changes)):
            there = [s.frames(index, len(self.seen)) for s in slopes]
            yield index, self._moved(few, there, turned, nodes)

    def by_loads(self, many: int, load: Callable[[np.ndarray], np.ndarray]) -> Parts:
        """Yield the same for so `many` loads (f, P, K, 3) [N] on the nodes of a rope at rest, as
        given for indices (f,) of frames."""
        for index, few in in_parts(self.solution, many):
            moved = tangent(few, Directions(load=load(index)))
            yield index, np.moveaxis(seen_move(self.setup, few.q, *moved), 1, 0)

    def _moved(
        self, solution: Solution, slopes: list[Slopes], turned: bool,
        nodes: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return (P, f, K, 3) changes of the nodes as seen in the frames of a solution."""
        frames, every, _ = solution.x.shape
        nodes = np.arange(every) if nodes is None else nodes
        which = [k for k, s in enumerate(slopes) if s.moves_rope]
        moving = [slopes[k] for k in which]
        dx = np.zeros((frames, len(slopes), len(nodes), 3))
        if moving:
            directions = directions_of(solution.rod, moving, frames)
            if turned:
                directions = turned_to_bends(directions, solution.rod, vectors(solution))
            directions = with_law(directions, solution, moving)
            directions = with_axial_law(directions, solution.rod, [solution], moving)
            moved = tangent(solution, directions)
            dx[:, which] = seen_move(self.setup, solution.q, *moved, nodes)
        return add_sensor(dx, slopes, self.setup.sensor, nodes)


def seen_move(
    setup: Setup, q: np.ndarray, dx: np.ndarray, turn: np.ndarray, nodes: np.ndarray | None = None
) -> np.ndarray:
    """Return (F, P, K, 3) [m] changes of the markers' positions at some nodes (K,) of a rope with
    frames q (F, N, 4), None for all, from changes dx (F, P, N+1, 3) [m] of its nodes and turns (F,
    P, N, 3) [rad] of its frames."""
    every = dx.shape[2]
    nodes = np.arange(every) if nodes is None else nodes
    moved = dx if len(nodes) == every else dx[:, :, nodes]
    if setup.off_axis is None:
        return moved
    return moved + off_axis_turned(setup.off_axis, q, turn, nodes)


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
    every = [s.springs for s in slopes if s.springs is not None]
    if every:
        changes = Springs(*map(np.concatenate, zip(*(one for _, one in every), strict=True)))
        out[:, changed] = moment_changes(every[0][0], changes, vector)
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


def add_sensor(
    dx: np.ndarray, slopes: list[Slopes], seen: SensorModel, nodes: np.ndarray | None = None
) -> np.ndarray:
    """Return (P, F, K, 3) as seen, of changes dx (F, P, K, 3) of some nodes (K,), None for all."""
    dx = np.moveaxis(dx, 1, 0) * (1 - float(seen.lag))
    for moved, s in zip(dx, slopes, strict=True):
        # The sensor's small errors move a change of the rope by a change of second order only.
        moved += s.seen if nodes is None or s.seen.ndim < 3 else s.seen[:, nodes]
    return dx
