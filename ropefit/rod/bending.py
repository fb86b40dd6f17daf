"""A bending moment that is a nonlinear function of curvature, in place of Euler's M = EI κ.

The law is odd, alike about all axes across the rope, and piecewise linear in the curvature, as it
is measured in the vector part of a bend element's Darboux quaternion about its rest. To the solver
it is a sum of springs whose force no longer grows beyond some length: the friction elements of
`solvers.equilibrium.conditions`, without a memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.rod import Rod, at_nodes


class Bending(NamedTuple):
    """dM/dκ over EI: slope (B,) [1] below, between and beyond the curvatures knots (B-1,) [1/m]; or
    (R, B) and (R, B-1), of R ropes."""

    knots: np.ndarray
    slope: np.ndarray


class Springs(NamedTuple):
    """R ropes' law as B springs beside the rod's own: drag (R, B, N+1) [N m], centre (R, N+1, 2),
    the length slip (R, B, N+1) beyond which the force is constant."""

    drag: np.ndarray
    centre: np.ndarray
    slip: np.ndarray


def springs(law: Bending, rod: Rod) -> Springs:
    """Return a law as springs."""
    stiffness, rest = (t if t.ndim == 3 else t[None] for t in (rod.stiffness, rod.rest))
    length = rod.length if rod.length.ndim == 2 else rod.length[None]
    drag, reach = _and_last(law.slope, 1.0), _and_last(law.knots, np.inf)  # last: the rod's own
    return Springs(
        stiffness[:, None, :, 0] * (drag[:, :-1] - drag[:, 1:])[..., None],
        rest[..., :2],
        0.25 * at_nodes(length)[:, None] * reach[..., None],  # v = sin(turn / 2)
    )


def _and_last(values: np.ndarray, last: float) -> np.ndarray:
    """Return values (..., B) as (R, B+1), with a last one."""
    return np.pad(np.atleast_2d(values), ((0, 0), (0, 1)), constant_values=last)


def moment_changes(at: Springs, changes: Springs, vector: np.ndarray) -> np.ndarray:
    """Return (F, P, N+1, 2) [N m] the changes of the moments of springs `at` (one row) at vectors
    (F, N+1, 2) that stay, for P changes (a row each) of them."""
    drag, centre, slip = at
    strain = vector - centre
    size = np.linalg.norm(strain, axis=-1)[:, None]
    long = size > slip
    share = np.where(long, slip / np.maximum(size, 1e-300), 1.0)
    way = strain / np.maximum(size[:, 0], 1e-300)[..., None]
    across, short = (drag * share).sum(1), (drag * ~long).sum(1)
    along = np.einsum("fni,pni->fpn", way, changes.centre) * (short - across)[:, None]
    out = -across[:, None, :, None] * changes.centre - along[..., None] * way[:, None]
    stiffer, longer = (np.flatnonzero(c.any((1, 2))) for c in (changes.drag, changes.slip))
    if len(stiffer):
        more = np.einsum("pbn,fbn->fpn", changes.drag[stiffer], share)
        out[:, stiffer] += more[..., None] * strain[:, None]
    if len(longer):
        more = np.einsum("pbn,fbn->fpn", changes.slip[longer], np.where(long, drag, 0.0))
        out[:, longer] += more[..., None] * way[:, None]
    return out
