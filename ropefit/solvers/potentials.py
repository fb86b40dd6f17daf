"""Equilibria under energies of single nodes (contact, tethers): Newton around Newton.

At the present nodes every potential is replaced by its quadratic approximation, whose stiffness
enters the rod's own Newton as elastic supports; repeated until the nodes stay where they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.rod import Rod
from ropefit.rod.setup import Potential
from ropefit.solvers import newton_kernels as kernels
from ropefit.solvers.conditions import Conditions
from ropefit.solvers.equilibrium import Solution, solve

ROUNDS, CORNERED_ROUNDS = 40, 120
SHARES, SHORTEST = 17, 0.01  # of a step: how many are tried, and the least
SHRINKS, MORE, LESS, LEAST = 0.7, 2.0, 0.5, 0.1  # moves that do, or not: share of them to go
NEAR = 1e-4  # of the length: nodes that move less are where potentials may show their own curvature
LIMIT = 60  # Newton steps of one round
SOFTER = (0.003, 0.03, 0.3)  # of the hardness, one after the other
STILL, SOFT_STILL = 1e-9, 1e-5  # of the length: nodes that move less have arrived


@torch.enable_grad()  # also where a caller wants no gradients of its own
def force_and_stiffness(
    potentials: tuple[Potential, ...], x: Tensor, stiff: bool = True
) -> tuple[Tensor, Tensor]:
    """-dV/dx (F, K, 3) [N] and d²V/dx² (F, K, 3, 3) [N/m] at nodes x (F, K, 3); the second only
    where it is asked for."""
    x = x.detach().requires_grad_()
    total = torch.zeros((), dtype=x.dtype)
    for p in potentials:
        total = total + (p.share.detach() * p.energy(x)).sum()
    (slope,) = torch.autograd.grad(total, x, create_graph=stiff)
    if not stiff:
        return -slope, torch.empty(0)
    rows = []
    for a in range(3):
        if slope.requires_grad:
            (row,) = torch.autograd.grad(
                slope[..., a].sum(), x, retain_graph=True, allow_unused=True
            )
        else:
            row = None
        rows.append(torch.zeros_like(x) if row is None else row)
    return -slope.detach(), torch.stack(rows, dim=-2).detach()


def solve_with_potentials(
    rod: Rod,
    conditions: Conditions,
    potentials: tuple[Potential, ...],
    start: Solution | None = None,
    deepest: float = np.inf,
) -> tuple[Solution, Conditions, Rod]:
    """Equilibria of F frames of one rope, or of F ropes, with energies of their nodes.

    deepest: of the length; where a node of `start` is deeper than that in what the rope touches,
    nothing is tried, and all frames are marked.

    Returns the states, and the conditions and rods with the supports and loads that stand for the
    potentials there (derivatives of the states need them). Frames that do not settle are marked.
    If any does not, all begin anew from where they would hang alone, and are brought out of the
    obstacle in steps, while it hardens.
    """
    if start is None or not start.converged.all():
        start = solve(rod, conditions)
    length = float(rod.length.detach().sum(-1).max())
    if deepest < np.inf and _depth(potentials, start.x) > deepest * length:
        marked = start.copy()
        marked.status[:] = kernels.LIMIT
        return marked, conditions, rod
    # A softer obstacle may let the rope through: only where nothing else leads to rest.
    found = _settle(rod, conditions, potentials, start, STILL * length)
    if found[0].converged.all():
        return found
    current = solve(rod, conditions)
    for share in SOFTER:
        scaled = tuple(p._replace(share=share * p.share) for p in potentials)
        current = _settle(rod, conditions, scaled, current, SOFT_STILL * length)[0]
    return _settle(rod, conditions, potentials, current, STILL * length)


def _depth(potentials: tuple[Potential, ...], x: np.ndarray) -> float:
    """[m] how deep nodes x (F, K, 3) are in what they touch: E = hardness depth² / 2 of each."""
    deepest = 0.0
    for p in potentials:
        if p.hardness is not None:
            energy = float(p.energy(torch.from_numpy(x)).detach().max())
            deepest = max(deepest, float(np.sqrt(2 * energy / float(p.hardness))))
    return deepest


def _settle(
    rod: Rod,
    conditions: Conditions,
    potentials: tuple[Potential, ...],
    current: Solution,
    still: float,
) -> tuple[Solution, Conditions, Rod]:
    """Replace the potentials by supports until no node moves by more than `still` [m]. A frame that
    goes astray stays where it began, marked, and stops no other.

    Where the slope of a potential has corners (friction), a step goes as far along as the forces
    drive it: that of the rod, which is known at both of its ends, and those of the potentials.
    """
    held, rods, before, began = conditions, rod, current.x, current
    moved, lost = np.full(len(current.x), np.inf), np.zeros(len(current.x), dtype=bool)
    far = 3 if conditions.far_held else 0
    cornered, own = any(p.cornered for p in potentials), None
    near, bold = NEAR * float(rod.length.detach().sum(-1).max()), cornered
    share = np.ones(len(before))
    for _ in range(CORNERED_ROUNDS if cornered else ROUNDS):
        x = torch.from_numpy(before)
        force, stiffness = force_and_stiffness(potentials, x)
        if not bold:
            stiffness = _pulling_back(stiffness)
        held, load, reaction = _supports(conditions, x, force, stiffness)
        guess = Solution(
            current.q, current.x, current.force,
            np.concatenate([current.reaction[:, :far], reaction], axis=1),
            current.base, current.status, current.iterations, current.residual,
        )  # fmt: skip
        rods = rod
        if load is not None:
            rods = rod.each(len(x))
            rods = rods._replace(load=rods.load + load)
        current = solve(rods, held, guess, limit=LIMIT)
        step = current.x - before
        earlier, moved = moved, np.abs(step).max(axis=(1, 2))
        lost |= ~np.isfinite(moved)
        current.put(lost, began, lost)
        moved[lost], step[lost] = 0.0, 0.0
        if bold and moved.max() < still:
            break
        if cornered:
            # At the new nodes the rod balances the force as it was replaced.
            new = np.einsum("fnab,fnb->fna", stiffness.numpy(), step) - force.numpy()
            share = np.ones(len(step)) if own is None else _share(potentials, x, step, own, new)
            part = share[:, None, None]
            own = new if own is None else (1 - part) * own + part * new
        else:  # contact that opens and closes in turn: go a part of the way
            share = np.clip(np.where(moved < SHRINKS * earlier, MORE, LESS) * share, LEAST, 1.0)
            if bold and moved.max() > near:
                near *= 0.1  # their own curvature led away
            bold = bool(moved.max() < near)
        before = before + share[:, None, None] * step
    late = lost | (current.converged & ~(moved < 1e3 * still))
    current.status[late] = kernels.LIMIT
    return current, held, rods


def _pulling_back(stiffness: Tensor) -> Tensor:
    """Stiffness (F, K, 3, 3) without what pushes away: from afar, a rope would slide off a bar."""
    if not bool((stiffness != 0).any()):
        return stiffness
    values, vectors = torch.linalg.eigh(stiffness)
    return (vectors * values.clamp_min(0.0)[..., None, :]) @ vectors.transpose(-1, -2)


def _share(
    potentials: tuple[Potential, ...], x: Tensor, step: np.ndarray, old: np.ndarray, new: np.ndarray
) -> np.ndarray:
    """(F,) of a step (F, K, 3) [m] from nodes x, at which nothing drives further along it.

    old, new (F, K, 3) [N]: the rod's own force at its ends.
    """
    at = torch.linspace(0.0, 1.0, SHARES, dtype=x.dtype)
    places = x + at[:, None, None, None] * torch.from_numpy(step)
    force = force_and_stiffness(potentials, places, stiff=False)[0].numpy()
    along = np.einsum("sfna,fna->sf", force, step)
    first, last = (np.einsum("fna,fna->f", own, step) for own in (old, new))
    along += first + at.numpy()[:, None] * (last - first)
    out = np.ones(len(step))
    for f, drive in enumerate(along.T):
        back = np.flatnonzero(drive[1:] < 0)
        if len(back) and drive[0] > 0:
            k = int(back[0])
            part = drive[k] / (drive[k] - drive[k + 1]) if drive[k] > 0 else 0.0
            out[f] = max((k + part) / (SHARES - 1), SHORTEST)
    return out


def _supports(
    conditions: Conditions, x: Tensor, force: Tensor, stiffness: Tensor
) -> tuple[Conditions, Tensor | None, np.ndarray]:
    """Elastic supports with the potentials' stiffness that are at rest at x; the force at x is a
    load. (As one, a force and a stiffness near zero would be a support from far away.)

    A support along an eigenvector d of the stiffness κ pushes with κ (offset - d · x).
    """
    touched = torch.nonzero((stiffness != 0).any(-1).any(-1).any(0))[:, 0]
    frames = len(x)
    load = force if bool((force != 0).any()) else None
    if len(touched) == 0:
        return conditions, load, np.zeros((frames, 0))
    values, vectors = torch.linalg.eigh(stiffness[:, touched])  # (F, T, 3), (F, T, 3, 3)
    order = values.abs().argsort(-1, descending=True)
    values = torch.gather(values, -1, order)
    vectors = torch.gather(vectors, -1, order[..., None, :].expand_as(vectors))
    strong = values.abs() > 1e-9 * values.abs().max()
    rank = int(strong.any(0).any(0).sum())
    values, vectors, strong = values[..., :rank], vectors[..., :rank], strong[..., :rank]
    direction = vectors.transpose(-1, -2)  # (F, T, rank, 3)
    safe = torch.where(strong, values, 1.0)
    offset = (direction * x[:, touched, None]).sum(-1)
    flat = lambda t: t.reshape(frames, -1, *t.shape[3:])  # noqa: E731
    active = flat(strong).numpy()
    used = np.flatnonzero(active.any(0))
    held = replace(
        conditions,
        node=np.repeat(touched.numpy(), rank)[used],
        direction=flat(direction)[:, used].contiguous(),
        offset=flat(offset)[:, used],
        compliance=flat(1 / safe)[:, used],
        active=active[:, used],
    )
    return held, load, np.zeros((frames, len(used)))
