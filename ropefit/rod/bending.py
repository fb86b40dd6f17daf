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
    """dM/dκ over EI: slope (B,) [1] below, between and beyond the curvatures knots (B-1,) [1/m]."""

    knots: np.ndarray
    slope: np.ndarray


class Springs(NamedTuple):
    """R ropes' law as B springs beside the rod's own: drag (R, B, N+1) [N m], centre (R, N+1, 2),
    the length slip (R, B, N+1) beyond which the force is constant."""

    drag: np.ndarray
    centre: np.ndarray
    slip: np.ndarray


def springs(law: Bending | None, rod: Rod) -> Springs:
    """Return a law as springs; for a linear rope one without stiffness for each of none."""
    stiffness, rest = (t if t.ndim == 3 else t[None] for t in (rod.stiffness, rod.rest))
    length = rod.length if rod.length.ndim == 2 else rod.length[None]
    if law is None:
        none = np.zeros((len(stiffness), 0, stiffness.shape[-2]))
        return Springs(none, rest[..., :2], none)
    drag = np.append(law.slope, 1.0)  # the last: of the rod itself
    reach = np.append(law.knots, np.inf)
    return Springs(
        stiffness[:, None, :, 0] * (drag[:-1] - drag[1:])[:, None],
        rest[..., :2],
        0.25 * at_nodes(length)[:, None] * reach[:, None],  # v = sin(turn / 2)
    )


def moment_changes(a: Springs, b: Springs, step: float, vector: np.ndarray) -> np.ndarray:
    """Return (F, N+1, 2) [N m] the derivative of the springs' moments from those of two laws `step`
    to either side, at vectors (F, N+1, 2) that stay."""
    now = [0.5 * (p + q) for p, q in zip(a, b, strict=True)]
    pairs = zip(a, b, strict=True)
    with np.errstate(invalid="ignore"):
        moved = [np.nan_to_num((q - p) / (2 * step)) for p, q in pairs]
    drag, centre, slip = now
    strain = vector - centre
    size = np.linalg.norm(strain, axis=-1)[:, None]
    long = size > slip
    share = np.where(long, slip / np.maximum(size, 1e-300), 1.0)
    way = strain / np.maximum(size[:, 0], 1e-300)[..., None]
    along = (way * moved[1]).sum(-1)
    out = (moved[0] * share).sum(1)[..., None] * strain
    out += np.where(long, drag * moved[2], 0.0).sum(1)[..., None] * way
    across = (drag * share).sum(1)[..., None] * (moved[1] - along[..., None] * way)
    return out - across - ((drag * ~long).sum(1) * along)[..., None] * way
