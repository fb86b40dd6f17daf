"""Checks of array shapes before compiled code, which does not check its own indices.

Every kernel's arguments pass through here once a call; a mistake is an exception, never a write
past the end of an array.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

    from ropefit.solvers.dynamics_kernels import Drive
    from ropefit.solvers.dynamics_kernels import Rod as Moving
    from ropefit.solvers.newton_kernels import Frames, Rods


class ShapeError(ValueError):
    """Arrays that do not belong together were given to a solver: a mistake in the code."""


def check_shapes(**arrays: tuple[np.ndarray | Tensor, tuple[int, ...]]) -> None:
    """Check arrays, each given by name with the shape that it must have. Raises ShapeError."""
    for name, (array, shape) in arrays.items():
        if tuple(array.shape) != shape:
            raise ShapeError(f"{name} has shape {tuple(array.shape)}, not {shape}")


def check_problem(rods: Rods, frames: Frames) -> None:
    """Check the rods and the conditions of F frames against each other. Raises ShapeError."""
    ropes, segments = rods.length.shape
    count, supports, sliders = len(rods.of), len(frames.node), frames.drag.shape[1]
    nodes = segments + 1
    check_shapes(
        supple=(rods.supple, (ropes, segments, 3)),
        stiff=(rods.stiff, (ropes, nodes, 3)),
        rest=(rods.rest, (ropes, nodes, 4)),
        load=(rods.load, (ropes, nodes, 3)),
        moment=(rods.moment, (ropes, 2, 3)),
        gauge=(rods.gauge, (ropes,)),
        clamp=(frames.clamp, (count, 2, 4)),
        direction=(frames.direction, (count, supports, 3)),
        offset=(frames.offset, (count, supports)),
        compliance=(frames.compliance, (count, supports)),
        active=(frames.active, (count, supports)),
        drag=(frames.drag, (count, sliders, nodes)),
        centre=(frames.centre, (count, sliders, nodes, 2)),
        slip=(frames.slip, (count, sliders, nodes)),
    )
    check_indices("of", rods.of, ropes)
    check_indices("node", frames.node, nodes)


def check_clips(rods: Moving, of: np.ndarray, drives: Drive) -> None:
    """Check ropes in motion and how the ends of C clips are driven. Raises ShapeError."""
    (ropes, segments), (clips, steps) = rods.length.shape, drives.time.shape
    nodes = segments + 1
    check_shapes(
        flexibility=(rods.supple, (ropes, segments, 3)),
        viscous=(rods.viscous, (ropes, segments, 3)),
        stiff=(rods.stiff, (ropes, nodes, 3)),
        loss=(rods.loss, (ropes, nodes, 3)),
        rest=(rods.rest, (ropes, nodes, 4)),
        load=(rods.load, (ropes, nodes, 3)),
        mass=(rods.mass, (ropes, nodes)),
        air=(rods.air, (ropes, nodes)),
        gauge=(rods.gauge, (ropes,)),
        of=(of, (clips,)),
        ends=(drives.ends, (clips, steps, 2, 3)),
        clamp=(drives.clamp, (clips, steps, 2, 4)),
        held=(drives.held, (2,)),
    )
    check_indices("of", of, ropes)


def check_indices(name: str, index: np.ndarray, size: int) -> None:
    """Check that indices (n,) are those of an axis of this size. Raises ShapeError."""
    if len(index) and not (index.min() >= 0 and index.max() < size):
        raise ShapeError(f"{name} points outside an axis of {size}")
