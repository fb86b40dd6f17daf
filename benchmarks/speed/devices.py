"""Many ropes at once, at rest and in motion: on a CPU and on an accelerator, if there is one.

The same ropes (36 frames times C candidate bending rigidities), each with its own rod, from a cold
start to states, and on to the gradient of a loss in every rope's rigidity: compiled, and as
tensors. And one clip of a motion, of many candidates. Answers are compared.

    python -m benchmarks.speed.devices [--write docs/results.md] [--json FILE] [--ropes N ...]
                                       [--clips N ...]
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from benchmarks.accuracy.dynamics import clip, rope
from benchmarks.document import parser, publish
from benchmarks.speed.workloads import FRAMES, GRAVITY, apart
from benchmarks.threads import use_threads
from reference_simulators.rod_energy import tensors
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.batched.implicit import settled_batched
from ropefit.solvers.batched.simulate import simulate_batched
from ropefit.solvers.batched.solve import solve_batched
from ropefit.solvers.dynamics.differentiable import simulate
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.differentiable import settled
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.equilibrium.solve import solve

ROPES = (36, 1152)
ROPES_ON_DEVICE = (36, 1152, 36864)
SEGMENTS = 19
CLIPS = (16, 1024)
CLIPS_ON_DEVICE = (1024, 6144, 16384, 65536)
STEPS = 50  # of 10 ms
COMPARED = 64  # clips, with those of the compiled path


def ropes(count: int) -> tuple[torch.Tensor, Callable[[torch.Tensor], Rod], Conditions]:
    """Return bending rigidities (count,) [N m²], the rods they make, and what holds them."""
    bend = 2e-3 * torch.logspace(-1, 1, count // FRAMES, dtype=torch.float64)
    ends = torch.zeros(count, 2, 3, dtype=torch.float64)
    ends[:, 1, 0] = torch.from_numpy(np.resize(apart(), count))
    gravity = torch.from_numpy(GRAVITY)

    def rod(bend: torch.Tensor) -> Rod:
        properties = uniform(length=1.0, segments=SEGMENTS, bend=bend, axial=1e4)
        return build(properties, gravity, (False, False))

    held = Conditions(ends, torch.full((count, 2, 4), torch.nan, dtype=torch.float64))
    return bend.repeat_interleave(FRAMES), rod, held


def shortest(work: Callable[[], Any], clock: Callable[[], float]) -> float:
    """Return the time [s] of the shortest of three runs, or of as many as take a second."""
    work()
    times: list[float] = []
    while len(times) < 3 or (sum(times) < 1 and len(times) < 100):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


def measure(device: torch.device | None, count: int) -> dict[str, Any]:
    """Time [s] states, and states with gradient; device None is the compiled path."""
    bend, rod, held = ropes(count)
    reference = solve(rod(bend), held)

    def states(rods: Rod) -> Solution:
        return solve(rods, held) if device is None else solve_batched(rods, held, device)

    def gradient() -> torch.Tensor:
        leaf = bend.clone().requires_grad_()
        rods = rod(leaf)
        found = states(rods)
        if device is None:
            x = settled(found, rods, held).x
        else:
            x = settled_batched(found, rods, held, device).x
        return torch.autograd.grad((x**2).sum(), leaf)[0]

    found = states(rod(bend))
    assert found.converged.all()
    difference = float(np.abs(found.x - reference.x).max())
    assert difference < 1e-9, "the paths disagree"
    on_cpu = device is None or device.type == "cpu"
    clock = time.process_time if on_cpu else time.perf_counter
    return {
        "states_s": shortest(lambda: states(rod(bend)), clock),
        "gradient_s": shortest(gradient, clock),
        "apart_m": difference,
    }


def measure_motion(device: torch.device | None, count: int) -> dict[str, float]:
    """Time [s] one clip of `count` candidates, with the gradient in every bending rigidity."""
    drive, start = clip(STEPS + 1, held=True)
    bend = 1e-3 * torch.logspace(-0.5, 0.5, count, dtype=torch.float64)

    def gradient(by: torch.device | None = device, every: int = 1) -> torch.Tensor:
        leaf = bend[::every].clone().requires_grad_()
        drives = Drive(*(f.expand(len(leaf), *f.shape[1:]) for f in tensors(drive)))
        starts = Start(*(f.expand(len(leaf), *f.shape[1:]) for f in tensors(start)))
        ropes = rope(leaf, (True, True), 1.0, 13)
        if by is None:
            x = simulate(ropes, drives, starts)[0]
        else:
            x = simulate_batched(ropes, drives, starts, by)[0]
        return torch.autograd.grad((x**2).sum(), leaf)[0]

    every = max(count // COMPARED, 1)
    exact, found = gradient(None, every), gradient()[::every]
    clock = time.process_time if device is None else time.perf_counter
    return {
        "gradient_s": shortest(gradient, clock),
        "rope_s": count * STEPS * 0.01,
        "apart": float(((found - exact).abs() / exact.abs().clamp_min(1e-12)).max()),
    }


def settlers(ropes: tuple[int, ...]) -> list[tuple[str, torch.device | None, tuple[int, ...]]]:
    """Return what settles ropes, where, and how many at once."""
    found = [("compiled, CPU", None, ROPES), ("tensors, CPU", torch.device("cpu"), ROPES)]
    if torch.cuda.is_available():
        name = f"tensors, {torch.cuda.get_device_name()}"
        found.append((name, torch.device("cuda"), ropes))
    return found


def steppers(clips: tuple[int, ...]) -> list[tuple[str, torch.device | None, tuple[int, ...]]]:
    """Return what steps clips, and how many at once: compiled code, and that on an accelerator."""
    found: list[tuple[str, torch.device | None, tuple[int, ...]]] = [("CPU", None, CLIPS)]
    if torch.cuda.is_available():
        found.append((torch.cuda.get_device_name(), torch.device("cuda"), clips))
    return found


def table(data: dict[str, Any]) -> str:
    lines = [
        f"Ropes of {SEGMENTS + 1} nodes settled at once, float64; from a cold start to states, and",
        "on to the gradient in every rope's bending rigidity. Shortest of several runs; on the CPU",
        "processor time of one thread. Written by `python -m benchmarks.speed.devices`.",
        "",
        "| path | ropes | states [ms] | with gradient [ms] | a rope [µs] | difference [m] |",
        "|---|---|---|---|---|---|",
    ]
    for name, rows in data["paths"].items():
        for count, m in rows.items():
            lines.append(
                f"| {name} | {count} | {1e3 * m['states_s']:.1f} | {1e3 * m['gradient_s']:.1f} "
                f"| {1e6 * m['states_s'] / int(count):.0f} | {m['apart_m']:.0e} |"
            )
    lines += [
        "",
        f"Clips of {STEPS} steps of 10 ms, 13 nodes, clamped at both ends, with the gradient in",
        "every rope's bending rigidity, by the compiled loops: one clip after the other on a CPU,",
        f"a thread a clip on an accelerator. Difference: of the gradients of some {COMPARED} of",
        "them from those of the CPU.",
        "",
        "| where | clips | with gradient [s] | seconds of rope a second | relative difference |",
        "|---|---|---|---|---|",
    ]
    for name, rows in data["motion"].items():
        for count, m in rows.items():
            lines.append(
                f"| {name} | {count} | {m['gradient_s']:.2f} "
                f"| {m['rope_s'] / m['gradient_s']:.0f} | {m['apart']:.0e} |"
            )
    if not data["accelerator"]:
        lines += ["", "No accelerator was there to be timed; `--device cuda` uses the tensors."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the table; write it where asked."""
    arguments = parser(__doc__)
    arguments.add_argument("--ropes", type=int, nargs="+", help="how many at once on a device")
    arguments.add_argument("--clips", type=int, nargs="+", help="how many at once on a device")
    options = arguments.parse_args()
    use_threads(1)
    data = {
        "accelerator": torch.cuda.is_available(),
        "paths": {
            name: {str(count): measure(device, count) for count in counts}
            for name, device, counts in settlers(options.ropes or ROPES_ON_DEVICE)
        },
        "motion": {
            name: {str(count): measure_motion(device, count) for count in counts}
            for name, device, counts in steppers(options.clips or CLIPS_ON_DEVICE)
        },
    }
    publish(options, "devices", table(data), data)


if __name__ == "__main__":
    main()
