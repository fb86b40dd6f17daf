"""How a setup depends on a value: cheap and smooth, it is differenced, to nine digits, and to seven
in errors of the set-up."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ropefit.rod.at_once import BUILT_FROM, laws, rods
from ropefit.rod.bending import Springs, springs
from ropefit.rod.differences import DIFFERENCE_STEP, sensor_slope, slope, turn_slope
from ropefit.rod.off_axis import off_axis, sides_at_nodes
from ropefit.rod.rod import DIMS, Rod
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.followers import loads
from ropefit.solvers.equilibrium.potentials import Nodes, acted_on, force_of
from ropefit.solvers.equilibrium.solution import States

# The setup where one value has moved by so many of its scales from where its difference is taken:
# about the point itself, or about a step beside it.
Change = Callable[[float], Setup]
LOAD = Rod._fields.index("load")


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the rod's fields, the force [N] of potentials, the ends [m], the clamps' turns
    [rad] and what is seen [m] at nodes that stay, in one value. springs: a law of bending, and its
    derivatives; axial (A,): of a law of axial strain. same_rod: whether all derivatives of the
    rod's fields are zero."""

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


def slopes_of(setup: Setup, changes: list[Change], solution: States) -> list[Slopes]:
    """Return the slopes of every change of a setup, with the rope in the states of a solution."""
    nodes, markers = acted_on(setup.potentials, solution.x), solution.x
    across = None
    if setup.off_axis is not None:
        across = sides_at_nodes(solution.q)
        markers = markers + off_axis(setup.off_axis, across)
    if setup.solver_error is not None:
        markers = markers + setup.solver_error.move
    # What does not depend on a value is the same object.
    pairs = [(changed(-DIFFERENCE_STEP), changed(DIFFERENCE_STEP)) for changed in changes]
    return [
        _slopes(setup, *pair, solution, built, nodes, markers, across)
        for pair, built in zip(pairs, _built(setup, pairs), strict=True)
    ]


class Built(NamedTuple):
    """Derivatives of a rod's fields but for its loads, and a law of bending with its own; still:
    whether nothing that they are built from changes."""

    rod: list[np.ndarray]
    law: tuple[Springs, Springs] | None = None
    still: bool = False


def _built(setup: Setup, pairs: list[tuple[Setup, Setup]]) -> list[Built]:
    """Return how the rods of pairs of setups differ, all built at once."""
    still = Built([np.zeros(field.shape) for field in setup.rod()], still=True)
    out = [still] * len(pairs)
    which = [
        k
        for k, (a, b) in enumerate(pairs)
        if a.bending is not b.bending or not _equal(_built_from(a), _built_from(b))
    ]
    if not which:
        return out
    setups = [setup for k in which for setup in pairs[k]]
    every = rods(setups)
    fields = [slope(values[::2], values[1::2]) for values in every]
    fields[LOAD] = np.broadcast_to(still.rod[LOAD], (len(which), *still.rod[LOAD].shape))
    for row, k in enumerate(which):
        out[k] = Built([values[row] for values in fields])
    bent = np.flatnonzero([pairs[k][0].bending is not None for k in which])
    if len(bent):
        rows = np.stack([2 * bent, 2 * bent + 1], axis=1).ravel()
        law = springs(laws([setups[row] for row in rows]), every.frames(rows))
        now = Springs(*(0.5 * (values[:1] + values[1:2]) for values in law))
        changes = [slope(values[::2], values[1::2]) for values in law]
        for number, row in enumerate(bent):
            one = Springs(*(values[number : number + 1] for values in changes))
            out[which[row]] = out[which[row]]._replace(law=(now, one))
    return out


def _slopes(
    now: Setup, a: Setup, b: Setup, states: States, built: Built, nodes: list[Nodes],
    markers: np.ndarray, across: np.ndarray | None,
) -> Slopes:  # fmt: skip
    """Return the slopes of one change from a setup to another; nodes: those that each potential
    acts on now; markers (F, N+1, 3) [m]: where they are now, without the sensor's errors; across:
    `sides_at_nodes` of the rope."""
    x, q = states.x, states.q
    rod, law, same_rod = built
    if not _equal(_loaded_by(a), _loaded_by(b)):
        rod, same_rod = list(rod), False
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
    seen = sensor_slope(a, b, markers)
    if a.off_axis is not b.off_axis:
        assert a.off_axis is not None
        assert b.off_axis is not None
        assert across is not None
        seen = seen + off_axis(slope(a.off_axis, b.off_axis), across)
    if a.solver_error is not b.solver_error:
        near = now.solver_error or b.solver_error  # of a value that would bring it in
        assert near is not None
        seen = seen + near.slope(a.solver_error, b.solver_error)
    return Slopes(rod, force, ends, clamp, seen, law, axial, same_rod)


def same_rod(a: Setup, b: Setup) -> bool:
    """Return whether two setups have the same rod: all that it is built from is equal."""
    parts = _built_from, _loaded_by
    return all(_equal(of(a), of(b)) for of in parts)


def _built_from(setup: Setup) -> list[np.ndarray]:
    """Return what a rod is built from, but the dead loads of its nodes."""
    return [*setup.properties, *(getattr(setup, name) for name in BUILT_FROM)]


def _loaded_by(setup: Setup) -> list[np.ndarray]:
    """Return what the dead loads of the nodes are made from, besides what the rod is."""
    p = setup.properties
    return [setup.gravity, setup.load, setup.mass, p.density, p.length]


def _equal(first: Iterable[np.ndarray], second: Iterable[np.ndarray]) -> bool:
    return all(p is q or np.array_equal(p, q) for p, q in zip(first, second, strict=True))
