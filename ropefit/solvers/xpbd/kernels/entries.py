"""Algorithm 1 for one rope after the other in compiled loops, and its reverse-mode derivative.

The same mathematics as `reference.py`. Entry points: `run_ropes` and `pull_ropes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ropefit.solvers.kernels.jit import SHARED, copy_rows, exact_helper, exact_kernel, source_key
from ropefit.solvers.xpbd.kernels.adjoint import begin_step_adjoint, iterate_adjoint
from ropefit.solvers.xpbd.kernels.iterations import begin_step, iterate
from ropefit.solvers.xpbd.kernels.tables import (
    CHANGE_COLUMNS,
    SHEAR,
    STATE_COLUMNS,
    WORK_COLUMNS,
    Q,
    Weights,
    fill,
)


@exact_helper
def rope_weights(eta):
    """Return from the (5,) of one rope: η_x^D, η_x^S, η_q^S, η_q^B, η^SOR."""
    half = 0.5 * eta[4]
    return Weights(half * eta[0], half * eta[1], half * eta[2], half * eta[3])


@exact_helper
def finite(s):
    """Return whether all of x and q is finite; not the row without a frame."""
    total = 0.0
    for i in range(len(s)):
        for k in range(SHEAR if i < len(s) - 1 else Q):
            total += 0.0 * s[i, k]
    return total == 0.0


def _entries(sources: int) -> tuple[Callable[..., Any], ...]:
    """Return the entry points; `sources`, a hash of all they call, is part of the cache's key."""

    @exact_kernel
    def run_ropes(state, gravity, eta, rod, options):
        """Run Algorithm 1 in place on state (B, K, STATE_COLUMNS); gravity (B, K), eta (B, 5)."""
        assert sources != 0
        nodes = len(rod)
        change, work = np.empty((nodes, CHANGE_COLUMNS)), np.empty((nodes, WORK_COLUMNS))
        for rope in range(len(state)):
            s, weights = state[rope], rope_weights(eta[rope])
            for index in range(options.total):
                if index % options.iterations == 0:
                    begin_step(s, gravity[rope], rod)
                iterate(s, rod, options, weights, change, work)
            if not finite(s):
                fill(s, math.nan)

    @exact_kernel
    def pull_ropes(state, gravity, eta, rod, options, block, g_state, g_gravity, g_eta):
        """Run the adjoint of run_ropes: g_state, that of its result, becomes that of its start.

        Every rope runs again: once to keep its state at the start of each block of iterations,
        then, from the last block to the first, to record the block and walk it back.
        """
        assert sources != 0
        nodes, blocks = len(rod), (options.total + block - 1) // block
        starts = np.empty((blocks, nodes, STATE_COLUMNS))
        path = np.empty((block + 1, nodes, STATE_COLUMNS))
        changes, work = np.empty((block, nodes, CHANGE_COLUMNS)), np.empty((nodes, WORK_COLUMNS))
        dots = np.empty(4)
        for rope in range(len(state)):
            s, g, weights = state[rope], g_state[rope], rope_weights(eta[rope])
            for k in range(4):
                dots[k] = 0.0
            copy_rows(s, starts[0])
            for index in range((blocks - 1) * block):
                if index % options.iterations == 0:
                    begin_step(s, gravity[rope], rod)
                iterate(s, rod, options, weights, changes[0], work)
                if (index + 1) % block == 0:
                    copy_rows(s, starts[(index + 1) // block])
            for number in range(blocks - 1, -1, -1):
                first, last = number * block, min((number + 1) * block, options.total)
                copy_rows(starts[number], s)
                for index in range(first, last):
                    if index % options.iterations == 0:
                        begin_step(s, gravity[rope], rod)
                    copy_rows(s, path[index - first])
                    iterate(s, rod, options, weights, changes[index - first], work)
                copy_rows(s, path[last - first])
                if last == options.total and not finite(s):
                    fill(g, math.nan)
                for i in range(last - first - 1, -1, -1):
                    iterate_adjoint(
                        g, rod, options, weights, path[i], path[i + 1], changes[i], work, dots
                    )
                    if (first + i) % options.iterations == 0:
                        begin_step_adjoint(g, g_gravity[rope], rod)
            half = 0.5 * eta[rope, 4]
            g_eta[rope, 4] = 0.0
            for k in range(4):
                g_eta[rope, k] = half * dots[k]
                g_eta[rope, 4] += 0.5 * eta[rope, k] * dots[k]

    return run_ropes, pull_ropes


run_ropes, pull_ropes = _entries(source_key(Path(__file__).parent, SHARED))
