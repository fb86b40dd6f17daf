"""Elastic supports that stand for the potentials of nodes at a place: a quadratic approximation."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ropefit.rod.rod import Rod
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.problem import Problem, check_problem, problem_of
from ropefit.solvers.equilibrium.solution import States
from ropefit.solvers.equilibrium.solve import newton
from ropefit.solvers.status import Status

WEAKEST = 1e-9  # of the largest stiffness: weaker supports are none


class Supports(NamedTuple):
    """S supports of F frames, as in `Conditions`, that are at rest at the present nodes."""

    node: np.ndarray
    direction: np.ndarray
    offset: np.ndarray
    compliance: np.ndarray
    active: np.ndarray


def supports(
    x: np.ndarray, stiffness: np.ndarray, bold: np.ndarray
) -> tuple[Supports | None, np.ndarray]:
    """Return supports of a stiffness (F, K, 3, 3) [N/m] at nodes x (F, K, 3) [m], and the stiffness
    that they have.

    bold (F,): frames in which what pushes away counts too; from afar, a rope would slide off a bar.
    A support along an eigenvector d of the stiffness κ pushes with κ (offset - d · x).
    """
    touched = np.flatnonzero((stiffness != 0).any((0, 2, 3)))
    if len(touched) == 0:
        return None, stiffness
    values, vectors = np.linalg.eigh(stiffness[:, touched])  # (F, T, 3), (F, T, 3, 3)
    values = np.where(bold[:, None, None], values, np.maximum(values, 0.0))
    kept = np.zeros_like(stiffness)
    kept[:, touched] = np.einsum("ftab,ftb,ftcb->ftac", vectors, values, vectors)
    order = np.argsort(-np.abs(values), axis=-1)
    values = np.take_along_axis(values, order, -1)
    vectors = np.take_along_axis(vectors, order[..., None, :], -1)
    strong = np.abs(values) > WEAKEST * np.abs(values).max()
    rank = int(strong.any((0, 1)).sum())
    values, strong = values[..., :rank], strong[..., :rank]
    direction = vectors.swapaxes(-1, -2)[:, :, :rank]  # (F, T, rank, 3)
    offset = np.einsum("ftra,fta->ftr", direction, x[:, touched])
    active = strong.reshape(len(x), -1)
    used = np.flatnonzero(active.any(0))
    if len(used) == 0:
        return None, kept
    flat = [
        np.ascontiguousarray(item.reshape(len(x), len(active[0]), *item.shape[3:])[:, used])
        for item in (direction, offset, 1 / np.where(strong, values, 1.0), strong)
    ]
    return Supports(np.repeat(touched, rank)[used], *flat), kept


def held_by(conditions: Conditions, added: Supports | None) -> Conditions:
    """Return conditions with further supports."""
    if added is None:
        return conditions
    return replace(conditions, **added._asdict())


class Supported:
    """Frames of ropes to be settled again and again, with other supports and loads each time."""

    def __init__(self, rod: Rod, conditions: Conditions) -> None:
        self.problem = problem_of(rod.each(len(conditions.ends)), conditions, None)
        self.base = None if conditions.free else as_numpy(conditions.ends[:, 0])

    def settled(
        self, mine: np.ndarray, near: States, load: np.ndarray, added: Supports | None, limit: int
    ) -> tuple[States, np.ndarray]:
        """Return states of the frames `mine`, from states near them, under loads (f, K, 3) [N] and
        supports; and which of them (f,) have converged."""
        rods, _, held = self.problem
        rods = rods._make(np.ascontiguousarray(item[mine]) for item in rods)
        rods = rods._replace(load=rods.load + load)
        own = {name: getattr(held, name)[mine] for name in held._fields[2:]}
        node, count = held.node, held.node.size
        if added is not None:
            node = np.concatenate([node, added.node])
            for name in Supports._fields[1:]:
                own[name] = np.concatenate([own[name], getattr(added, name)], axis=1)
        problem = Problem(rods, np.arange(len(mine)), held._replace(node=node, **own))
        check_problem(problem)
        q, base = near.q.copy(), near.base.copy()
        if self.base is not None:
            base[:] = self.base[mine]
        reaction = np.zeros((len(mine), node.size))
        reaction[:, :count] = near.reaction[:, :count]
        x, _, status, *_ = newton(problem, q, reaction, base, limit=limit)
        return States(q, x, base, reaction[:, :count]), status == Status.CONVERGED
