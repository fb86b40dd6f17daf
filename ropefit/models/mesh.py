"""The error of a motion's mesh and steps, estimated by a finer simulation (Richardson 1911)."""

from __future__ import annotations

import numpy as np

from ropefit.rod.rod import Properties
from ropefit.rod.setup import Setup

FINER = 2  # times as many segments, and steps
EXTRAPOLATED = FINER**2 / (FINER**2 - 1)  # the error is of second order in both


def refined(setup: Setup) -> Setup | None:
    """Return the rope with `FINER` times as many segments; what is on a node stays where it is.

    None for a rope with potentials, followers or memory, which are of one mesh.
    """
    if setup.potentials or setup.followers or setup.memory:
        return None
    p, damping = setup.properties, setup.damping
    parts = {name: _segments(value) for name, value in p._asdict().items()}
    return setup._replace(
        properties=Properties(**parts)._replace(length=_segments(p.length) / FINER),
        load=_nodes(setup.load),
        mass=_nodes(setup.mass[:, None])[:, 0],
        kinks=_nodes(setup.kinks),
        springs=None if setup.springs is None else _nodes(setup.springs[:, None])[:, 0],
        stretch=_segments(setup.stretch),
        rigid=None if setup.rigid is None else _segments(setup.rigid),
        damping=None if damping is None else type(damping)(*(_segments(v) for v in damping)),
    )


def mesh_error(coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Return (F, N+1, 3) [m] what is to be added to a simulation; zero where one was not reached.

    coarse (F, N+1, 3) and fine (F, FINER N + 1, 3) [m]: the rope by both meshes.
    """
    return np.nan_to_num(EXTRAPOLATED * (fine[:, ::FINER] - coarse))


def _segments(value: np.ndarray) -> np.ndarray:
    """Return values of the segments (N, ...) for those of the finer mesh."""
    return value.repeat(FINER, axis=0)


def _nodes(value: np.ndarray) -> np.ndarray:
    """Return what acts on nodes (..., N+1, 3) for those of the finer mesh."""
    *frames, nodes, axes = value.shape
    out = np.zeros((*frames, FINER * (nodes - 1) + 1, axes))
    out[..., ::FINER, :] = value
    return out
