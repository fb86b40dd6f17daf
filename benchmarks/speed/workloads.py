"""The ropes and the work that all contenders are timed on."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from reference_simulators import xpbd_torch
from ropefit.models.algorithm import Algorithm
from ropefit.models.xpbd_rope import XpbdRope, build_rope
from ropefit.rod.rod import build, uniform
from ropefit.rod.setup import bare
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.differentiable import settle
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.xpbd.compiled import simulate_compiled
from ropefit.solvers.xpbd.reference import SOLVERS, Eta, simulate
from ropefit.solvers.xpbd.settings import Settings

FRAMES = 36
GRAVITY = np.array([0.0, 0.0, -9.81])
WEIGHTS = (0.04, 0.9, 0.8, 0.7, 0.6, 0.9)
HUNDRED = Settings(steps=5, iterations=20)
GRID, SLICE = 5**6, 5**4  # candidates, and how many of them are simulated at once


def best(work: Callable[[], Any], least: int = 3, seconds: float = 1.0) -> float:
    """Return the shortest time [s] of several runs, without the first (compilation, caches)."""
    work()
    times, begin = [], time.perf_counter()
    while len(times) < least or (time.perf_counter() - begin < seconds and len(times) < 200):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def apart() -> np.ndarray:
    return np.linspace(0.35, 0.95, FRAMES)


def equilibrium(nodes: int) -> dict[str, float]:
    """Time a cold start: build, solve all frames, gradient of a loss in six parameters."""
    gravity = torch.from_numpy(GRAVITY)
    ends = torch.zeros(FRAMES, 2, 3, dtype=torch.float64)
    ends[:, 1, 0] = torch.from_numpy(apart())
    conditions = Conditions(ends, torch.full((FRAMES, 2, 4), torch.nan, dtype=torch.float64))
    values = (2e-4 * 9.81, 1e-3, 1e4, 1e4, 1.0, 0.01)
    last: list[Solution] = []

    def work(gradient: bool) -> None:
        bend, twist, axial, shear, density, curvature = (
            torch.tensor(v, dtype=torch.float64, requires_grad=gradient) for v in values
        )
        zero = torch.zeros((), dtype=torch.float64)
        properties = uniform(
            length=1.0, segments=nodes - 1, bend=bend, twist=twist, axial=axial, shear=shear,
            density=density, curvature=torch.stack([curvature, zero, zero]),
        )  # fmt: skip
        state, solution = settle(build(properties, gravity, (False, False)), conditions)
        if gradient:
            wanted = [bend, twist, axial, shear, density, curvature]
            torch.autograd.grad((state.x**2).sum(), wanted)
        last[:] = [solution]

    forward, both = best(lambda: work(False)), best(lambda: work(True))
    assert last[0].converged.all()
    return {
        "solve_s": forward,
        "gradient_s": both,
        "iterations": float(last[0].iterations.mean()),
        "residual": float(last[0].residual.max()),
    }


def hanging(solver: str, settings: Settings) -> XpbdRope:
    ends = np.zeros((FRAMES, 2, 3))
    ends[:, 0, 0] = apart()
    rope = uniform(length=1.0, segments=19, bend=1.0)
    setup = bare(rope, GRAVITY, ends, np.full((FRAMES, 2, 4), np.nan), np.zeros(3))
    return build_rope(setup, Algorithm(solver, settings))


def algorithm(solver: str, contender: str) -> dict[str, float]:
    """Time [s] Algorithm 1, K = 20, 100 iterations of all frames.

    Contender: compiled, reference (both ropefit), or careful (torch).
    """
    rope = hanging(solver, HUNDRED)

    def work(gradient: bool) -> torch.Tensor:
        eta = [torch.tensor(w, dtype=torch.float64, requires_grad=gradient) for w in WEIGHTS]
        if contender == "careful":
            x, _ = xpbd_torch.settle(
                *rope.start, rope.rest.length, rope.gravity, eta, HUNDRED.steps,
                HUNDRED.iterations, solver == "thomas",
            )  # fmt: skip
        else:
            run = simulate_compiled if contender == "compiled" else simulate
            x = run(
                rope.start, rope.rest, rope.chain, Eta(*eta), SOLVERS[solver], rope.gravity, HUNDRED
            ).x
        if gradient:
            torch.autograd.grad((x**2).sum(), eta)
        return x.detach()

    seconds = 1.0 if contender == "compiled" else 0.1
    return {
        "forward_s": best(lambda: work(False), seconds=seconds),
        "gradient_s": best(lambda: work(True), seconds=seconds),
        "checksum": float(work(False).sum()),
    }


def grid(solver: str, slices: int) -> dict[str, float]:
    """Time slices of the grid of candidate weights, on two threads, with their processor time.

    100 iterations of all frames each, scaled to the whole grid.
    """
    rope = hanging(solver, HUNDRED)
    axis = torch.linspace(0.2, 1.0, 5, dtype=torch.float64)
    candidates = torch.cartesian_prod(*[axis] * 6) * torch.tensor([0.1, 1.0, 1.0, 1.0, 1.0, 1.0])
    target = rope.start.x

    def work(part: int) -> torch.Tensor:
        eta = candidates[part * SLICE : (part + 1) * SLICE, None, :, None, None]
        x = simulate_compiled(
            rope.start, rope.rest, rope.chain, Eta(*eta.unbind(2)), SOLVERS[solver], rope.gravity,
            HUNDRED,
        ).x  # fmt: skip
        return ((x - target) ** 2).sum((-1, -2, -3))

    work(0)
    start, before = time.perf_counter(), time.process_time()
    losses = torch.cat([work(part) for part in range(slices)])
    assert len(losses) == slices * SLICE
    whole = GRID // SLICE / slices
    return {
        "seconds": whole * (time.perf_counter() - start),
        "processor_s": whole * (time.process_time() - before) / 2,
    }
