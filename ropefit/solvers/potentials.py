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

ROUNDS, FIRM_ROUNDS = 40, 120
SHRINKS, MORE, LESS, LEAST = 0.7, 2.0, 0.5, 0.1  # moves that do, or not: share of them to go
SLOW, ALIGNED = 0.3, 0.98  # factor by which moves shrink, and how parallel: then extrapolate
NEAR = 1e-4  # of the length: nodes that move less are where potentials may show their own curvature
LIMIT = 60  # Newton steps of one round
SOFTER = (0.003, 0.03, 0.3)  # of the hardness, one after the other
STILL, SOFT_STILL = 1e-9, 1e-5  # of the length: nodes that move less have arrived


@torch.enable_grad()  # also where a caller wants no gradients of its own
def force_and_stiffness(potentials: tuple[Potential, ...], x: Tensor) -> tuple[Tensor, Tensor]:
    """-dV/dx (F, K, 3) [N] and d²V/dx² (F, K, 3, 3) [N/m] at nodes x (F, K, 3)."""
    x = x.detach().requires_grad_()
    total = torch.zeros((), dtype=x.dtype)
    for p in potentials:
        total = total + (p.share.detach() * p.energy(x)).sum()
    (slope,) = torch.autograd.grad(total, x, create_graph=True)
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
) -> tuple[Solution, Conditions, Rod]:
    """Equilibria of F frames of one rope, or of F ropes, with energies of their nodes.

    Returns the states, and the conditions and rods with the supports and loads that stand for the
    potentials there (derivatives of the states need them). Frames that do not settle are marked.
    A rope that does not settle is brought out of an obstacle in steps, while the obstacle hardens.
    """
    if start is None or not start.converged.all():
        start = solve(rod, conditions)
    length = float(rod.length.detach().sum(-1).max())
    # A softer obstacle may let the rope through: only where nothing else leads to rest.
    found = _settle(rod, conditions, potentials, start, STILL * length)
    if found[0].converged.all():
        return found
    current = start
    for share in SOFTER:
        scaled = tuple(p._replace(share=share * p.share) for p in potentials)
        current = _settle(rod, conditions, scaled, current, SOFT_STILL * length)[0]
    return _settle(rod, conditions, potentials, current, STILL * length)


def _settle(
    rod: Rod,
    conditions: Conditions,
    potentials: tuple[Potential, ...],
    current: Solution,
    still: float,
) -> tuple[Solution, Conditions, Rod]:
    """Replace the potentials by supports until no node moves by more than `still` [m]. A frame that
    goes astray stays where it began, marked, and stops no other."""
    held, rods, before, began = conditions, rod, current.x, current
    moved, lost = np.full(len(current.x), np.inf), np.zeros(len(current.x), dtype=bool)
    far = 3 if conditions.far_held else 0
    firm = tuple(p if p.firm is None else p._replace(energy=p.firm) for p in potentials)
    careful = any(p.firm is not None for p in potentials)
    near, bold = NEAR * float(rod.length.detach().sum(-1).max()), False
    ahead, last = np.zeros_like(before), None
    share = np.ones((len(before), 1, 1))
    for _ in range(FIRM_ROUNDS if careful else ROUNDS):
        before = current.x + ahead - (1 - share) * (current.x - before)
        x = torch.from_numpy(np.nan_to_num(before))
        force, stiffness = force_and_stiffness(potentials if bold else firm, x)
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
        earlier, moved = moved, np.abs(current.x - before).max(axis=(1, 2))
        lost |= ~np.isfinite(moved)
        current.put(lost, began, lost)
        moved[lost] = 0.0
        if not careful:  # contact that opens and closes in turn: go a part of the way
            calm = moved < SHRINKS * earlier
            factor = np.where(calm, MORE, LESS)[:, None, None]
            share = np.clip(factor * share, LEAST, 1.0)
        if bold and moved.max() < still:
            break
        if bold and moved.max() > near:
            near *= 0.1  # their own curvature led away
        bold = bool(moved.max() < near)
        if careful:
            ahead, last = _extrapolated(last, np.where(lost[:, None, None], 0, current.x - before))
    late = lost | (current.converged & ~(moved < 1e3 * still))
    current.status[late] = kernels.LIMIT
    return current, held, rods


def _pulling_back(stiffness: Tensor) -> Tensor:
    """Stiffness (F, K, 3, 3) without what pushes away: from afar, a rope would slide off a bar."""
    if not bool((stiffness != 0).any()):
        return stiffness
    values, vectors = torch.linalg.eigh(stiffness)
    return (vectors * values.clamp_min(0.0)[..., None, :]) @ vectors.transpose(-1, -2)


def _extrapolated(
    last: np.ndarray | None, move: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """Where moves that shrink, or swing, by a constant factor lead to, and the move to compare the
    next with (Aitken's delta squared process)."""
    if last is not None:
        along = float((last * move).sum())
        factor = along / float((last**2).sum())
        straight = abs(along) > ALIGNED * np.linalg.norm(last) * np.linalg.norm(move)
        if straight and abs(factor) > SLOW and factor < 1 - 1e-3:
            return factor / (1 - factor) * move, None
    return np.zeros_like(move), move


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
