"""A bending moment that is a nonlinear function of curvature, in place of Euler's M = EI κ.

The law is odd, alike about all axes across the rope, and piecewise linear in the curvature, as it
is measured in the vector part of a bend element's Darboux quaternion about its rest. To the solver
it is a sum of springs whose force no longer grows beyond some length: the friction elements of
`solvers.equilibrium.conditions`, without a memory.
"""

from __future__ import annotations

from collections.abc import Iterator
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


def moment_changes(
    pairs: list[tuple[Springs, Springs]], step: float, vector: np.ndarray
) -> Iterator[np.ndarray]:
    """Yield (F, N+1, 2) [N m] the derivative of the springs' moments at vectors (F, N+1, 2) that
    stay, from the same laws `step` to either side in each of some values."""
    if not pairs:
        return
    drag, centre, slip = (0.5 * (p + q) for p, q in zip(*pairs[0], strict=True))
    strain = vector - centre
    size = np.linalg.norm(strain, axis=-1)[:, None]
    long = size > slip
    share = np.where(long, slip / np.maximum(size, 1e-300), 1.0)
    way = strain / np.maximum(size[:, 0], 1e-300)[..., None]
    across, short = (drag * share).sum(1)[..., None], (drag * ~long).sum(1)
    held = np.where(long, drag, 0.0)
    for before, after in pairs:
        of_drag, of_centre, of_slip = map(_difference, before, after)
        out = np.zeros_like(strain)
        if of_drag.any():
            out += (of_drag * share).sum(1)[..., None] * strain
        if of_slip.any():
            out += (held * of_slip).sum(1)[..., None] * way
        if of_centre.any():
            along = (way * of_centre).sum(-1)[..., None]
            out -= across * (of_centre - along * way) + short[..., None] * along * way
        yield out / (2 * step)


def _difference(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(after - before)
