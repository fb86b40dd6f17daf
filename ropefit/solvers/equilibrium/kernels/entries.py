"""Entry points of the compiled equilibrium: F frames, one after the other.

rods: `Rod` of R ropes; of (F,): which of them each frame shows; held: `Held` of F frames.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ropefit.rod import fields
from ropefit.solvers import status as statuses
from ropefit.solvers.equilibrium.kernels.adjoint import adjoint_rope
from ropefit.solvers.equilibrium.kernels.catenary import frames_of, hang, pull_at_end, roll
from ropefit.solvers.equilibrium.kernels.newton import CONVERGED, solve_rope
from ropefit.solvers.equilibrium.kernels.records import (
    change_of,
    held_in,
    make_work,
    pull_in,
    rod_of,
)
from ropefit.solvers.equilibrium.kernels.stability import smallest_eigenvalue
from ropefit.solvers.equilibrium.kernels.state import set_state
from ropefit.solvers.equilibrium.kernels.tangent import tangent_rope
from ropefit.solvers.kernels.jit import SHARED, copy_rows, exact_kernel, kernel, source_key
from ropefit.solvers.kernels.rotations import director


def _of_states(sources: int) -> tuple[Callable[..., Any], ...]:
    """Return the entry points that settle ropes, and those of settled ones; `sources`, a hash of
    all they call, is part of the cache's key."""

    @kernel
    def solve_ropes(
        rods, of, held, q, lam, x0, tolerance, limit, status, iterations, residual, x, force
    ):
        """Find the equilibria from q (F, N, 4), lam (F, S), x0 (F, 3), changed in place.

        x (F, N+1, 3) [m], force (F, N, 3) [N], status, iterations, residual (F,) are written.
        """
        assert sources != 0
        n, count = q.shape[1], lam.shape[1]
        w = make_work(n, count, 1)
        for t in range(q.shape[0]):
            rod, here = rod_of(rods, of[t]), held_in(held, t)
            status[t], iterations[t], residual[t] = solve_rope(
                rod, here, q[t], lam[t], x0[t], tolerance, limit, w
            )
            if status[t] != CONVERGED:  # else the state last set is this one
                set_state(rod, here, q[t], lam[t], x0[t], w)
            copy_rows(w.x, x[t])
            copy_rows(w.force, force[t])

    @kernel
    def tangent_ropes(rods, of, held, q, lam, x0, changes, acts, clamp, anchor, offset, dx, turn):
        """Find the derivatives dx (F, P, N+1, 3), turn (F, P, N, 3) of solutions.

        changes: `Change` with arrays (R, P, ...); acts (2, P): which change bends (stiffness,
        rest), and segments (the other fields but moments); clamp (F, P, 2, 3), anchor (F, P, 3),
        offset (F, P, S).
        """
        assert sources != 0
        n, count, many = q.shape[1], lam.shape[1], clamp.shape[1]
        w = make_work(n, count, many)
        for t in range(q.shape[0]):
            tangent_rope(
                rod_of(rods, of[t]), held_in(held, t), q[t], lam[t], x0[t],
                change_of(changes, of[t]), acts, clamp[t], anchor[t], offset[t], w, dx[t], turn[t],
            )  # fmt: skip

    @kernel
    def adjoint_ropes(rods, of, held, q, lam, x0, gx, gq, pulls):
        """Pull gradients gx (F, N+1, 3), gq (F, N, 4) back into `pulls`, a `Pull` of F frames."""
        assert sources != 0
        n, count = q.shape[1], lam.shape[1]
        w = make_work(n, count, 1)
        for t in range(q.shape[0]):
            adjoint_rope(
                rod_of(rods, of[t]), held_in(held, t), q[t], lam[t], x0[t], gx[t], gq[t], w,
                pull_in(pulls, t),
            )  # fmt: skip

    @kernel
    def stability_ropes(rods, of, held, q, lam, x0, eigenvalue):
        """Find the smallest eigenvalue (F,) [N] of each energy, see `smallest_eigenvalue`."""
        assert sources != 0
        n, count = q.shape[1], lam.shape[1]
        w = make_work(n, count, 1)
        for t in range(q.shape[0]):
            eigenvalue[t] = smallest_eigenvalue(
                rod_of(rods, of[t]), held_in(held, t), q[t], lam[t], x0[t], w
            )

    return solve_ropes, tangent_ropes, adjoint_ropes, stability_ropes


def _of_starts(sources: int) -> tuple[Callable[..., Any], ...]:
    """Return the entry points that find where to start from; `sources` as in `_of_states`."""

    @exact_kernel
    def hang_rope(arc, gravity, ends, tangents, shape):
        """Write the shape (K, 3) of one hanging rope, see `hang`."""
        assert sources != 0
        hang(arc, gravity, ends, tangents, shape)

    @exact_kernel
    def start_ropes(arc, of, weight, ends, clamp, turns, rest, rolls, load, q, x, pull):
        """Find starts of F ropes: nodes x (F, K, 3), frames q (F, K-1, 4), and the force that holds
        the last node pull (F, 3) [N].

        arc (R, K) [m] of rope of[t]; weight (R, 3) [N]; ends (F, 2, 3), clamp (F, 2, 4), NaN where
        not held; turns (F,) whole turns of twist; rest (R, K, 4), towards which the rope is rolled
        where nothing keeps it from that; load (R, 3) [N] on the last node.
        """
        assert sources != 0
        tangents = np.empty((2, 3))
        for t in range(q.shape[0]):
            for end in range(2):
                director(clamp[t, end], tangents[end])
            k = of[t]
            scale = hang(arc[k], weight[k], ends[t], tangents, x[t])
            frames_of(x[t], arc[k], clamp[t], turns[t], q[t])
            if rolls:
                roll(q[t], rest[k])
            pull_at_end(x[t], arc[k, -1], weight[k], load[k], scale, pull[t])

    return hang_rope, start_ropes


# The records and what a status means are compiled in as well.
SOURCES = (Path(__file__).parent, SHARED, Path(fields.__file__), Path(statuses.__file__))
KEY = source_key(*SOURCES)
solve_ropes, tangent_ropes, adjoint_ropes, stability_ropes = _of_states(KEY)
hang_rope, start_ropes = _of_starts(KEY)
