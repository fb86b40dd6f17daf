"""Equilibria under energies of single nodes (contact, tethers): Newton around Newton.

At the present nodes every potential is replaced by its quadratic approximation, whose stiffness
enters the rod's own Newton as elastic supports; repeated until the nodes stay where they are.
"""

from __future__ import annotations

import numpy as np

from ropefit.rod.potential import Potential, derivatives_of, slope_of
from ropefit.rod.rod import Rod
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution, States, unsettled
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.supports import Supported, held_by, supports
from ropefit.solvers.status import Status

ROUNDS, CORNERED_ROUNDS = 40, 120
SHARES, SHORTEST = 17, 0.01  # of a step: how many are tried, and the least
SHRINKS, MORE, LESS, LEAST = 0.7, 2.0, 0.5, 0.1  # moves that do, or not: share of them to go
SMALL_MOVE = (
    1e-4  # of the length: nodes that move less are where potentials may show their own curvature
)
ROUND_STEPS = 60  # Newton steps of one round
MOST_FAILED = 3  # rounds in a row in which these do not lead to rest
SOFTER = (0.003, 0.03, 0.3)  # of the hardness, one after the other
Nodes = slice | np.ndarray  # which nodes: their indices
# Of the length: nodes that move less have arrived. A smooth potential is then replaced once more,
# which leaves an error of the square of that; what soft ropes are settled to is not much less.
STILL, CORNERED_STILL, SOFT_STILL = 1e-6, 1e-9, 1e-5
GONE = 1e-6  # of the length: what moves more when it is replaced once more has not arrived


def force_and_stiffness(
    potentials: tuple[Potential, ...], x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return -dV/dx (..., K, 3) [N] and d²V/dx² (..., K, 3, 3) [N/m] at nodes x (..., K, 3)."""
    force, stiffness = np.zeros_like(x), np.zeros((*x.shape, 3))
    for p in potentials:
        at = _nodes_of(p)
        slope, rows = derivatives_of(p, x[..., at, :])
        force[..., at, :] -= p.share[at, None] * slope
        stiffness[..., at, :, :] += p.share[at, None, None] * rows
    return force, stiffness


def force_of(
    potentials: tuple[Potential, ...], x: np.ndarray, nodes: list[Nodes] | None = None
) -> np.ndarray:
    """Return -dV/dx (..., K, 3) [N] at nodes x (..., K, 3); nodes: of the first of the potentials,
    where they act, if known."""
    force, known = np.zeros_like(x), nodes or []
    for k, p in enumerate(potentials):
        at = known[k] if k < len(known) else _nodes_of(p)
        force[..., at, :] -= p.share[at, None] * slope_of(p, x[..., at, :])
    return force


def acted_on(potentials: tuple[Potential, ...], x: np.ndarray) -> list[Nodes]:
    """Return which nodes each potential acts on in some frame of x (F, K, 3)."""
    return [
        np.flatnonzero(_acting(p, x).any(0)) if _is_body(p) else _nodes_of(p) for p in potentials
    ]


def _nodes_of(p: Potential) -> Nodes:
    """Return which nodes a potential may act on: most tethers and fields act on few. One that has a
    corner knows its nodes by their number."""
    return slice(None) if p.cornered or p.share.all() else np.flatnonzero(p.share)


def _acting(p: Potential, x: np.ndarray) -> np.ndarray:
    """Return (..., K) the nodes that a potential acts on: most ropes touch something with few."""
    acting = np.broadcast_to(p.share != 0, x.shape[:-1])
    return acting & (p.energy(x) > 0) if _is_body(p) else acting


def solve_with_potentials(
    rod: Rod,
    conditions: Conditions,
    potentials: tuple[Potential, ...],
    start: States | None = None,
    deepest: float = np.inf,
    at_once: bool = False,
) -> Solution:
    """Return equilibria of F frames of one rope, or of F ropes, with energies of their nodes.

    deepest: of the length; where a node of `start` is deeper than that in what the rope touches,
    nothing is tried, and all frames are marked.

    The solution's own conditions and rods are those with the supports and loads that stand for the
    potentials there: derivatives of the states need them. Frames that do not settle are marked.
    Those that do not at first begin anew from where they would hang alone, and are brought out of
    the obstacle in steps, while it hardens; not beside forces alone from a `start`, which is nearer
    than that. at_once: none is begun anew.
    """
    rod, conditions = rod.in_numpy(), conditions.in_numpy()
    alone = start is None or (isinstance(start, Solution) and not start.converged.all())
    if start is None or alone:
        start = solve(rod, conditions)
    length = float(rod.length.sum(-1).max())
    if deepest < np.inf and _depth(potentials, start.x) > deepest * length:
        return unsettled(rod, conditions, start)
    if all(p.quadratic for p in potentials):  # supports that stand for them do so anywhere
        bold = np.ones(len(start.x), dtype=bool)
        once = _replaced(rod, conditions, potentials, start.x, start, bold)
        if once.converged.all():
            return _replaced(rod, conditions, potentials, once.x, once, bold)
    # A softer obstacle may let the rope through: only where nothing else leads to rest.
    still = (CORNERED_STILL if any(p.cornered for p in potentials) else STILL) * length
    found = _settle(rod, conditions, potentials, start, still, at_once)
    late = np.flatnonzero(~found.converged)
    if at_once or not len(late) or not (alone or any(map(_is_body, potentials))):
        return found
    few, ends = rod.frames(late), conditions.frames(late)
    current: States = solve(few, ends)
    for share in SOFTER:
        scaled = tuple(p._replace(share=share * p.share) for p in potentials)
        current = _settle(few, ends, scaled, current, SOFT_STILL * length)
    again = found.states
    again.put(late, current)
    return _settle(rod, conditions, potentials, again, still)


def _is_body(p: Potential) -> bool:
    """Return whether a potential is something that the rope touches."""
    return p.hardness is not None


def _depth(potentials: tuple[Potential, ...], x: np.ndarray) -> float:
    """Return [m] how deep nodes x (F, K, 3) are in what they touch, of E = hardness depth² / 2."""
    deepest = 0.0
    for p in potentials:
        if p.hardness is not None:
            energy = float(p.energy(x).max())
            deepest = max(deepest, float(np.sqrt(2 * energy / float(p.hardness))))
    return deepest


def _settle(
    rod: Rod,
    conditions: Conditions,
    potentials: tuple[Potential, ...],
    start: States,
    still: float,
    at_once: bool = False,
) -> Solution:
    """Replace the potentials by supports until no node moves by more than `still` [m], in every
    frame by itself. A frame that goes astray stays where it began, marked; at_once: all do, as soon
    as Newton's method fails in one.

    Frames that touch nothing, before and after they settle without the potentials, are done. Where
    the slope of a potential has corners (friction), a step goes as far along as the forces drive
    it: that of the rod, which is known at both of its ends, and those of the potentials.
    """
    x, frames = start.x.copy(), len(start.x)
    far = conditions.far_supports
    current = States(start.q.copy(), x.copy(), start.base.copy(), start.reaction[:, :far].copy())
    moved = np.full(frames, np.inf)
    cornered, bodies = any(p.cornered for p in potentials), any(map(_is_body, potentials))
    failed = np.zeros(frames, dtype=int)  # rounds in a row
    own = np.full(x.shape, np.nan)  # the rod's own force on the nodes, once it is known
    length = float(rod.length.sum(-1).max())
    near = np.full(frames, SMALL_MOVE * length)
    bold, share = np.full(frames, cornered), np.ones(frames)
    going, alone = ~_untouched(potentials, x), Supported(rod, conditions)
    if not going.all():
        mine = np.flatnonzero(~going)
        none = np.zeros_like(x[mine])
        free, settled = alone.settled(mine, current.frames(mine), none, None, ROUND_STEPS)
        done = settled & _untouched(potentials, free.x)
        current.put(mine[done], free, done)
        x[mine[done]], moved[mine[done]] = free.x[done], 0.0
        going[mine[~done]] = True
    for _ in range(CORNERED_ROUNDS if cornered else ROUNDS):
        mine = np.flatnonzero(going)
        if not len(mine):
            break
        force, stiffness = force_and_stiffness(potentials, x[mine])
        # Supports that are at rest at x push with nothing: only the ends' reactions are known.
        held, stiffness = supports(x[mine], stiffness, bold[mine])
        new, reached = alone.settled(mine, current.frames(mine), force, held, ROUND_STEPS)
        step = new.x - x[mine]
        earlier, moved[mine] = moved[mine], np.abs(step).max(axis=(1, 2))
        if at_once and not reached.all():
            return unsettled(rod, conditions, start)
        failed[mine] = np.where(reached, 0, failed[mine] + 1)
        if not bodies:  # forces alone: contact comes and goes
            moved[mine[failed[mine] >= MOST_FAILED]] = np.inf
        astray = ~np.isfinite(moved[mine])
        going[mine] = ~astray & ~(bold[mine] & (moved[mine] < still))
        x[mine[astray]] = start.x[mine[astray]]
        mine, step, earlier = mine[~astray], step[~astray], earlier[~astray]
        current.put(mine, new, np.flatnonzero(~astray))
        if cornered:
            # At the new nodes the rod balances the force as it was replaced.
            force, stiffness = force[~astray], stiffness[~astray]
            rods = np.einsum("fnab,fnb->fna", stiffness, step) - force
            known = ~np.isnan(own[mine, 0, 0])
            share[mine[known]] = _share(
                potentials, x[mine[known]], step[known], own[mine[known]], rods[known]
            )
            part = share[mine, None, None]
            own[mine] = np.where(known[:, None, None], (1 - part) * own[mine] + part * rods, rods)
        else:  # contact that opens and closes in turn: go a part of the way
            more = np.where(moved[mine] < SHRINKS * earlier, MORE, LESS)
            share[mine] = np.clip(more * share[mine], LEAST, 1.0)
            led = bold[mine] & (moved[mine] > near[mine])
            near[mine[led]] *= 0.1  # their own curvature led away
            bold[mine] = moved[mine] < near[mine]
        part = np.where(going[mine], share[mine], 1.0)
        x[mine] += part[:, None, None] * step
    astray = ~np.isfinite(moved)
    found = _replaced(rod, conditions, potentials, x, current, bold)
    gone = np.abs(found.x - x).max(axis=(1, 2))
    late = found.converged & ~(gone < GONE * length)
    found.unsettle(astray, start)
    found.status[late] = Status.LIMIT
    return found


def _untouched(potentials: tuple[Potential, ...], x: np.ndarray) -> np.ndarray:
    """Return (F,) bool: frames whose nodes x (F, K, 3) are outside of everything; none of them
    where a potential acts everywhere."""
    out = np.full(len(x), all(map(_is_body, potentials)))
    if out.any():
        for p in potentials:
            out &= ~_acting(p, x).any(-1)
    return out


def _replaced(
    rod: Rod,
    conditions: Conditions,
    potentials: tuple[Potential, ...],
    x: np.ndarray,
    near: States,
    bold: np.ndarray,
) -> Solution:
    """Return equilibria where supports stand for the potentials at nodes x (F, K, 3), found from
    states near them. bold (F,): frames in which potentials show their own curvature."""
    force, stiffness = force_and_stiffness(potentials, x)
    held, _ = supports(x, stiffness, bold)
    if (force != 0).any():
        # As one, a force and a stiffness near zero would be a support from far away.
        rod = rod.each(len(x))
        rod = rod._replace(load=rod.load + force)
    return solve(rod, held_by(conditions, held), near, limit=ROUND_STEPS)


def _share(
    potentials: tuple[Potential, ...],
    x: np.ndarray,
    step: np.ndarray,
    old: np.ndarray,
    new: np.ndarray,
) -> np.ndarray:
    """Return (F,) of a step (F, K, 3) [m] from nodes x, at which nothing drives further along it.

    old, new (F, K, 3) [N]: the rod's own force at its ends.
    """
    at = np.linspace(0.0, 1.0, SHARES)
    force = force_of(potentials, x + at[:, None, None, None] * step)
    along = np.einsum("sfna,fna->sf", force, step)
    first, last = (np.einsum("fna,fna->f", own, step) for own in (old, new))
    along += first + at[:, None] * (last - first)
    out = np.ones(len(step))
    for f, drive in enumerate(along.T):
        back = np.flatnonzero(drive[1:] < 0)
        if len(back) and drive[0] > 0:
            k = int(back[0])
            part = drive[k] / (drive[k] - drive[k + 1]) if drive[k] > 0 else 0.0
            out[f] = max((k + part) / (SHARES - 1), SHORTEST)
    return out
