"""warm-up: compile every compiled loop ahead of the first work, on several cores at once.

Each loop is called with arrays of no frames, of the types that real work has: numba compiles it,
keeps it on disk, and there is nothing to compute.
"""

from __future__ import annotations

import gc
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from ropefit.errors import StageFailed
from ropefit.inference import curve, round_surface
from ropefit.rod.fields import MOVING_ROD, ROD, Field, zeros
from ropefit.solvers.compiling import folder_beside, said
from ropefit.solvers.dynamics.kernels import entries as dynamics
from ropefit.solvers.dynamics.kernels import records as moving
from ropefit.solvers.equilibrium.kernels import entries as equilibrium
from ropefit.solvers.equilibrium.kernels import records as settled
from ropefit.solvers.kernels.jit import TEMPORARY
from ropefit.solvers.xpbd.kernels import entries as xpbd
from ropefit.solvers.xpbd.kernels import tables

SEGMENTS, SUPPORTS, TIMES = 2, 3, 2
# Loops that share helpers, which a process compiles once. Two processes take every other group, and
# as long as each other.
Group = tuple[str, ...]
GROUPS: tuple[Group, ...] = (
    ("solve_ropes", "stability_ropes"),
    ("tangent_clips", "simulate_clips"),
    ("tangent_ropes", "adjoint_ropes", "start_ropes", "hang_rope"),
    ("adjoint_clips", "pull_ropes", "run_ropes", "axes", "feet"),
)
OBJECTS = 200_000  # new ones, before the collector looks for cycles among them: there are few
Call = tuple[Any, tuple[Any, ...]]  # a compiled loop and its arguments


def warm_up(progress: Callable[[float, str], None]) -> dict[str, Any]:
    """Return how many loops there are, how many were compiled now, seconds, and where they are.

    Raises StageFailed where no folder can keep them.
    """
    folder = Path(equilibrium.solve_ropes.stats.cache_path)  # type: ignore[attr-defined]
    if folder.parent.name.startswith(TEMPORARY):
        raise StageFailed(
            "no folder can keep the compiled loops; set NUMBA_CACHE_DIR to one that you may write"
        )
    said(equilibrium.solve_ropes)  # nothing is left to be said by the first work
    start, compiled, loops = time.perf_counter(), 0, len(calls())
    progress(0.0, f"0 of {loops}")
    with ExitStack() as stack:
        running = []
        for groups in shares(os.cpu_count() or 1):
            pool = ProcessPoolExecutor(
                1, get_context("spawn"), initializer=gc.set_threshold, initargs=(OBJECTS,)
            )
            stack.enter_context(pool)
            running += [pool.submit(compile_loop, name) for names in groups for name in names]
        for done, future in enumerate(as_completed(running), 1):
            compiled += future.result()
            progress(done / loops, f"{done} of {loops} compiled loops")
    seconds = time.perf_counter() - start
    where = str(folder_beside(folder))
    return {"loops": loops, "compiled": compiled, "seconds": seconds, "folder": where}


def shares(processors: int) -> list[list[Group]]:
    """Return the groups that each process compiles, one process for each processor that helps."""
    processes = min(processors, len(GROUPS))
    return [list(GROUPS[k::processes]) for k in range(processes)]


def compile_loop(name: str) -> bool:
    """Compile one loop, or load it; return whether it had to be compiled."""
    loop, arguments = calls()[name]
    loop(*arguments)
    return not loop.stats.cache_hits


def calls() -> dict[str, Call]:
    """Return every compiled loop with arguments of no frames, by name."""
    found = [*_equilibrium(), *_dynamics(), *_xpbd(), *_stations()]
    return {loop.__name__: (loop, arguments) for loop, arguments in found}


def _rods(kind: Any, fields: tuple[Field, ...]) -> Any:
    """Return the record of one rope."""
    arrays = zeros(fields, (1,), SEGMENTS) | {"rest": np.zeros((1, SEGMENTS + 1, 4))}
    return kind(**arrays, gauge=np.zeros(1))


def _equilibrium() -> list[Call]:
    n, s, e = SEGMENTS, SUPPORTS, equilibrium
    arrays = zeros(settled.HELD, (0,), n, S=s, B=0, A=0)
    held = settled.Held(node=np.zeros(s, np.int64), free=False, **arrays)
    none, whole, x = np.zeros(0), np.zeros(0, np.int64), np.zeros((0, n + 1, 3))
    q, lam, x0 = np.zeros((0, n, 4)), np.zeros((0, s)), np.zeros((0, 3))
    state = (_rods(settled.Rod, ROD), whole, held, q, lam, x0)
    found = (whole, whole, none, x, np.zeros((0, n, 3)))
    changes = settled.Change(**zeros(ROD, (1, 1), n))
    ways = [np.zeros((0, 1, *shape)) for shape in ((2, 3), (3,), (s,), (n + 1, 3), (n, 3))]
    pulls = settled.Pull(**zeros((*ROD, *settled.HELD_GRADIENT), (0,), n, S=s))
    rest = np.zeros((1, n + 1, 4))
    ends, clamp, arc = np.zeros((0, 2, 3)), np.zeros((0, 2, 4)), np.linspace(0.0, 1.0, n + 1)
    down, apart = np.array([0.0, 0.0, -9.81]), np.array([[0.0, 0.0, 0.0], [0.8, 0.0, 0.0]])
    return [
        (e.solve_ropes, (*state, 1e-9, 50, *found)),
        (e.tangent_ropes, (*state, changes, np.zeros((2, 1), np.bool_), *ways)),
        (e.adjoint_ropes, (*state, x, q, pulls)),
        (e.stability_ropes, (*state, none)),
        (e.start_ropes, (arc[None], whole, down[None], ends, clamp, none, rest, True, down[None], q,
                         x, x0)),
        (e.hang_rope, (arc, down, apart, np.full((2, 3), np.nan), np.empty((n + 1, 3)))),
    ]  # fmt: skip


def _dynamics() -> list[Call]:
    n, t = SEGMENTS, TIMES
    time, ends, clamp = np.zeros((0, t)), np.zeros((0, t, 2, 3)), np.zeros((0, t, 2, 4))
    drives = moving.Drive(time, ends, clamp, np.zeros(2, np.bool_))
    whole, x, v0 = np.zeros(0, np.int64), np.zeros((0, t, n + 1, 3)), np.zeros((0, n + 1, 3))
    q, force = np.zeros((0, t, n, 4)), np.zeros((0, t, n, 3))
    problem = (_rods(moving.Rod, MOVING_ROD), whole, drives, v0)
    of_clips = zeros(moving.CLIP, (0, 1), n, T=t)
    change = moving.Change(**zeros(MOVING_ROD, (1, 1), n), **of_clips)
    out = moving.Change(**zeros((*MOVING_ROD, *moving.CLIP), (0,), n, T=t))
    iterations, dx = np.zeros((0, t), np.int64), np.zeros((0, 1, t, n + 1, 3))
    return [
        (dynamics.tangent_clips, (*problem, x, q, force, change, 1, dx)),
        (dynamics.adjoint_clips, (*problem, x, q, force, x, force, out)),
        (dynamics.simulate_clips, (*problem, 50, x, q, force, iterations, whole, whole)),
    ]


def _xpbd() -> list[Call]:
    nodes = SEGMENTS + 1
    state, rod = np.zeros((0, nodes, tables.STATE_COLUMNS)), np.zeros((nodes, tables.ROD_COLUMNS))
    gravity, eta = np.zeros((0, nodes)), np.zeros((0, 5))
    options = tables.Options(0.0, 0.0, 0.0, 0.0, True, 1, 1)
    start = (state, gravity, eta, rod, options)
    return [(xpbd.pull_ropes, (*start, 1, state, gravity, eta)), (xpbd.run_ropes, start)]


def _stations() -> list[Call]:
    """Return what finds the nearest points of curves, and the axis of a round surface."""
    points, share, mask = np.zeros((0, 1, 3)), np.zeros((0, 1)), np.zeros((0, 1), np.bool_)
    count, inner = np.ones(1, np.int64), np.ones(1, np.bool_)
    return [
        (curve.feet, (points, share, mask, np.zeros((0, 2, 3)), math.inf)),
        (round_surface.axes, (np.zeros((1, 2)), np.zeros(1, np.int64), count, inner, 0.0)),
    ]
