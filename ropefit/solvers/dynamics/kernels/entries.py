"""Entry points of the compiled dynamics: C clips, one after the other.

rods: `Rod` of R ropes; of (C,): which of them each clip shows; drives: `Drive` of C clips.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ropefit.rod import fields
from ropefit.solvers import status as statuses
from ropefit.solvers.dynamics.kernels.adjoint import adjoint_clip, make_pullback
from ropefit.solvers.dynamics.kernels.records import change_of, drive_of, rod_of
from ropefit.solvers.dynamics.kernels.simulate import make_scratch, simulate_clip
from ropefit.solvers.dynamics.kernels.tangent import tangent_clip
from ropefit.solvers.kernels.jit import SHARED, kernel, source_key


def _entries(sources: int) -> tuple[Callable[..., Any], ...]:
    """Return the entry points; `sources`, a hash of all they call, is part of the cache's key."""

    @kernel
    def simulate_clips(rods, of, drives, v0, limit, xs, qs, forces, iterations, status, done):
        """Step through the clips from the start in xs[:, 0], qs[:, 0], forces[:, 0]."""
        assert sources != 0
        for k in range(qs.shape[0]):
            scratch = make_scratch(qs.shape[2])
            status[k], done[k] = simulate_clip(
                rod_of(rods, of[k]), drive_of(drives, k), v0[k], limit, xs[k], qs[k], forces[k],
                iterations[k], scratch,
            )  # fmt: skip

    @kernel
    def tangent_clips(rods, of, drives, v0, xs, qs, forces, change, every, dx):
        """Find forward derivatives in P directions, dx (C, P, T', N+1, 3) at every `every`-th time:
        `Change` of R ropes and C clips, (R, ..., P) and (C, ..., P)."""
        assert sources != 0
        for k in range(qs.shape[0]):
            tangent_clip(
                rod_of(rods, of[k]), drive_of(drives, k), v0[k], xs[k], qs[k], forces[k],
                change_of(change, k, of[k]), every, dx[k],
            )  # fmt: skip

    @kernel
    def adjoint_clips(rods, of, drives, v0, xs, qs, forces, gx, gq, out):
        """Pull gradients back into `out`, a `Change` of C clips also in what belongs to ropes."""
        assert sources != 0
        for k in range(qs.shape[0]):
            scratch = make_pullback(qs.shape[1], qs.shape[2])
            adjoint_clip(
                rod_of(rods, of[k]), drive_of(drives, k), v0[k], xs[k], qs[k], forces[k], gx[k],
                gq[k], change_of(out, k, k), scratch,
            )  # fmt: skip

    return simulate_clips, tangent_clips, adjoint_clips


# The records and what a status means are compiled in as well.
SOURCES = (Path(__file__).parent, SHARED, Path(fields.__file__), Path(statuses.__file__))
simulate_clips, tangent_clips, adjoint_clips = _entries(source_key(*SOURCES))
