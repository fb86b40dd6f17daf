"""Ropes in motion: how fast, how much energy is lost, how far gradients are of use.

python -m benchmarks.accuracy.dynamics [--write docs/results.md] [--json FILE]
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.document import parser, publish
from benchmarks.threads import use_threads
from reference_simulators.rod_energy import tensors
from ropefit.rod.either import like
from ropefit.rod.moving import Damping, Moving, moving, undamped
from ropefit.rod.rod import Properties, build, uniform
from ropefit.solvers.dynamics.differentiable import simulate
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import solve
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle
from tests.test_dynamics import beam, chain, frequency, pendulum, swing

DOWN = np.array([0.0, 0.0, -9.81])
ALONG_X = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])
TORCH_DER = 8.3  # s: a differentiable discrete elastic rod in torch, the same clip, as published
SPANS = (10, 100, 500, 2000)
CHANGE = 0.01  # of EI


def rope(bend: Tensor | float, clamped: tuple[bool, bool], damped: float, nodes: int) -> Moving:
    """Return a rope of 1 m and 60 g/m, of tensors where its rigidity is one."""
    p = uniform(length=1.0, segments=nodes - 1, bend=bend, density=0.06)
    every = np.ones(nodes - 1)
    d = Damping(*(like(damped * c * every, p.length) for c in (2e-5, 2e-5, 0, 0.02)))
    return moving(p, build(p, DOWN, clamped), d)


def clip(steps: int, held: bool, nodes: int = 13) -> tuple[Drive, Start]:
    """Return the drive of a rope held at both ends, one of which sweeps, or let go from a bow."""
    t = np.arange(steps) * 0.01
    ends = np.zeros((1, steps, 2, 3))
    ends[..., 1, 0] = 0.6
    if held:
        ends[0, :, 0, 0], ends[0, :, 0, 1] = 0.1 * np.sin(3 * t), 0.1 * (1 - np.cos(2 * t))
    clamp = np.full((1, steps, 2, 4), ALONG_X if held else np.nan)
    at = settle(rope(1e-3, (held, held), 0.0, nodes).rod, Conditions(ends[:, 0], clamp[:, 0]))
    if not held:
        ends[:, :, 1] = np.nan
    return Drive(t[None], ends, clamp), Start(at.x, at.q, np.zeros((1, nodes, 3)))


def seconds(work: Callable[[], Any], times: int = 5) -> float:
    """Return the least processor time [s] of several runs, the first excluded."""
    work()
    found = []
    for _ in range(times):
        begun = time.process_time()
        work()
        found.append(time.process_time() - begun)
    return min(found)


def speed() -> dict[str, float]:
    """Time [s] 500 steps of 13 nodes, forward and with gradient, and of four times the nodes."""
    out = {}
    for name, nodes in (("13 nodes", 13), ("52 nodes", 52)):
        drive, start = clip(500, True, nodes)
        moved = rope(1e-3, (True, True), 1.0, nodes)
        out[f"{name}, forward"] = seconds(lambda m=moved, d=drive, s=start: solve(m, d, s))

        def gradient(nodes: int = nodes, drive: Drive = drive, start: Start = start) -> None:
            bend = torch.tensor(1e-3, dtype=torch.float64, requires_grad=True)
            moved = rope(bend, (True, True), 1.0, nodes)
            x, _, _ = simulate(moved, tensors(drive), tensors(start))
            (x**2).sum().backward()

        out[f"{name}, with gradient"] = seconds(gradient)
    return out


def use(held: bool, damped: float) -> list[float]:
    """Return, for each span, the error of the change that the gradient predicts for 1 % more EI.

    Over the true change, of the final place of the last node but one.
    """
    found = []
    for steps in SPANS:
        drive, start = clip(steps + 1, held)
        ends = []
        slope = 0.0
        for share in (0.0, CHANGE):
            log = torch.tensor(share, dtype=torch.float64, requires_grad=True)
            moved = rope(1e-3 * torch.exp(log), (held, held), damped, 13)
            x, _, _ = simulate(moved, tensors(drive), tensors(start))
            value = x[0, -1, -2].sum()
            ends.append(float(value.detach()))
            if share == 0.0:
                (gradient,) = torch.autograd.grad(value, log)
                slope = float(gradient)
        change = ends[1] - ends[0]
        found.append(abs(change - slope * CHANGE) / abs(change))
    return found


def drift() -> dict[str, float]:
    """Return the share of its energy that a pendulum of 0.5 m, let go at 46°, loses in 100 s."""
    out = {}
    for h in (0.01, 0.005):
        p: Properties = uniform(length=0.5, segments=1, bend=1.0)
        moved = moving(p, build(p, DOWN, (False, False)), undamped(p))
        steps = round(100 / h)
        ends = np.full((1, steps, 2, 3), np.nan)
        ends[:, :, 0] = 0.0
        angle = 0.8
        tip = [0.5 * math.sin(angle), 0.0, -0.5 * math.cos(angle)]
        x = np.array([[[0.0, 0.0, 0.0], tip]])
        half = (math.pi - angle) / 2
        q = np.array([[[math.cos(half), 0.0, math.sin(half), 0.0]]])
        time_ = np.arange(steps)[None] * h
        none = np.full((1, steps, 2, 4), np.nan)
        found = solve(moved, Drive(time_, ends, none), Start(x, q, 0 * x)).x[0, :, 1]
        swings = np.abs(np.arctan2(found[:, 0], -found[:, 2]))
        last = swings[-round(1.6 / h) :].max()
        out[f"{h * 1e3:g} ms"] = 1 - (1 - math.cos(last)) / (1 - math.cos(angle))
    return out


def accuracy() -> dict[str, list[float]]:
    """Compare with closed forms.

    Return the largest error [rad] of a pendulum at 200, 400 and 800 steps of 2 s, its order in the
    step, and the relative error of ω in the first three modes of two ropes.
    """
    steps = (200, 400, 800)
    times = [np.linspace(0, 2, n + 1) for n in steps]
    errors = [float(np.abs(swing(t) - pendulum(t, 1.2, 0.5)).max()) for t in times]
    out = {
        "pendulum": errors,
        "order": [-float(np.polyfit(np.log(steps), np.log(errors), 1)[0])],
    }
    vibrations = {"hanging chain": chain, "cantilever": lambda mode: beam(mode, 60)}
    for name, made in vibrations.items():
        found = [made(mode) for mode in (1, 2, 3)]
        out[name] = [abs(frequency(*f)[0] / f[2] - 1) for f in found]
    return out


def table(
    exact: dict[str, list[float]],
    s: dict[str, float],
    lost: dict[str, float],
    of_use: dict[str, list[float]],
) -> str:
    rows = [
        "500 steps of 10 ms, held and clamped at both ends, one processor core, least processor",
        "time of five; written by `python -m benchmarks.accuracy.dynamics`.",
        "",
        "| solver | forward [s] | with gradient [s] |",
        "|---|---|---|",
        f"| ropefit, 13 nodes | {s['13 nodes, forward']:.3f} | "
        f"{s['13 nodes, with gradient']:.3f} |",
        f"| ropefit, 52 nodes | {s['52 nodes, forward']:.3f} | "
        f"{s['52 nodes, with gradient']:.3f} |",
        f"| differentiable discrete elastic rod in torch, 13 nodes (published, not run here) | "
        f"{TORCH_DER:g} | |",
        "",
        "Against closed forms:",
        "",
        "| what | error |",
        "|---|---|",
        "| pendulum let go at 69°, 2 s in 200, 400, 800 steps, largest error [rad] | "
        + ", ".join(f"{e:.2g}" for e in exact["pendulum"])
        + f" (order {exact['order'][0]:.2f}) |",
        "| hanging chain of 200 segments, ω of the first three modes (zeros of J0), share | "
        + ", ".join(f"{e:.1g}" for e in exact["hanging chain"])
        + " |",
        "| cantilever of 60 segments, ω of the first three modes, share | "
        + ", ".join(f"{e:.1g}" for e in exact["cantilever"])
        + " |",
        "",
        "A pendulum of 0.5 m let go at 46° loses in 100 s: "
        + ", ".join(f"{100 * v:.2g} % of its energy at {k}" for k, v in lost.items())
        + ".",
        "",
        "Change predicted by the gradient for 1 % more EI; error over the true change:",
        "",
        "| rope | " + " | ".join(f"{n} steps" for n in SPANS) + " |",
        "|---" * (len(SPANS) + 1) + "|",
    ]
    for name, errors in of_use.items():
        rows.append(f"| {name} | " + " | ".join(f"{e:.1g}" for e in errors) + " |")
    return "\n".join(rows) + "\n"


def main() -> None:
    options = parser(__doc__).parse_args()
    use_threads(1)
    exact = accuracy()
    found = speed()
    lost = drift()
    of_use = {
        "driven at both ends, damped": use(True, 1.0),
        "driven at both ends, undamped": use(True, 0.0),
        "let go, hanging by one end, undamped": use(False, 0.0),
    }
    publish(
        options, "dynamics", table(exact, found, lost, of_use),
        {
            "against closed forms": exact, "seconds": found, "energy lost": lost,
            "gradient error": of_use, "spans": SPANS,
        },
    )  # fmt: skip


if __name__ == "__main__":
    main()
