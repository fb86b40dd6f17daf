"""Speed: all contenders on the same work, in the same run, on one thread.

python -m benchmarks.speed [--write docs/results.md] [--json FILE] [--grid] [--elastica PYTHON]
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import careful_torch, contenders
from benchmarks.document import parser, publish
from ropefit.inference.rope import Ends, Rope, build_rope
from ropefit.rod.rod import build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.implicit import settle
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.xpbd.compiled import simulate_compiled
from ropefit.solvers.xpbd.reference import SOLVERS, Eta, Settings, simulate

FRAMES = 36
NODES = (20, 40, 100, 400)
GRAVITY = np.array([0.0, 0.0, -9.81])
WEIGHTS = (0.04, 0.9, 0.8, 0.7, 0.6, 0.9)
HUNDRED = Settings(steps=5, iterations=20)
GRID, SLICE = 5**6, 5**4  # candidates, and how many of them are simulated at once
START_UP = """
import time; start, before = time.perf_counter(), time.process_time()
import numpy as np, torch
torch_s = time.process_time() - before
from ropefit.rod.rod import build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve
ends = torch.zeros(1, 2, 3, dtype=torch.float64); ends[:, 1, 0] = 0.6
down = torch.tensor([0, 0, -9.81], dtype=torch.float64)
rod = build(uniform(length=1.0, segments=19, bend=1e-3), down, (False, False))
found = solve(rod, Conditions(ends, torch.full((1, 2, 4), torch.nan, dtype=torch.float64)))
assert found.converged.all()
print(time.perf_counter() - start, time.process_time() - before, torch_s)
"""


def best(work: Callable[[], Any], least: int = 3, seconds: float = 1.0) -> float:
    """Shortest time [s] of several runs; the first is not counted (compilation, caches)."""
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
    """Cold start: build, solve all frames, gradient of a loss in EI, GJ, EA, GA, density and rest
    curvature."""
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


def hanging(solver: str, settings: Settings) -> Rope:
    position = np.zeros((FRAMES, 2, 3))
    position[:, 0, 0] = apart()
    ends = Ends(position, np.full((FRAMES, 2, 4), np.nan))
    return build_rope(
        length=1.0, nodes=20, gravity=GRAVITY, ends=ends, solver=solver, settings=settings
    )


def algorithm(solver: str, contender: str) -> dict[str, float]:
    """Algorithm 1, K = 20, 100 iterations of all frames [s]; contender: compiled, reference (both
    ropefit), or careful (torch)."""
    rope = hanging(solver, HUNDRED)

    def work(gradient: bool) -> torch.Tensor:
        eta = [torch.tensor(w, dtype=torch.float64, requires_grad=gradient) for w in WEIGHTS]
        if contender == "careful":
            x, _ = careful_torch.settle(
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
    """Seconds for slices of the grid of candidate weights, 100 iterations of all frames each, on
    two threads; and the processor time of a thread."""
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


def start_up() -> dict[str, float]:
    """Seconds from nothing imported to the first solution, compiled code in the cache; processor
    time of the same, and of importing numpy and torch alone."""
    times = []
    for _ in range(4):
        run = subprocess.run(
            [sys.executable, "-c", START_UP], capture_output=True, text=True, check=True
        )
        times.append([float(value) for value in run.stdout.split()])
    seconds, processor, libraries = (min(column) for column in zip(*times[1:], strict=True))
    return {"seconds": seconds, "processor_s": processor, "libraries_s": libraries}


def one_thread() -> None:
    """Start again with one thread for every library, if it is not so yet."""
    wanted = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    if any(os.environ.get(key) != value for key, value in wanted.items()):
        command = [sys.executable, "-m", "benchmarks.speed", *sys.argv[1:]]
        os.execve(sys.executable, command, {**os.environ, **wanted})
    torch.set_num_threads(1)


def measure(full_grid: bool, elastica: Path | None) -> dict[str, Any]:
    data: dict[str, Any] = {"equilibrium": {str(n): equilibrium(n) for n in NODES}}
    for solver in ("jacobi", "thomas"):
        data[solver] = {c: algorithm(solver, c) for c in ("compiled", "careful", "reference")}
        sums = [item["checksum"] for item in data[solver].values()]
        assert np.ptp(sums) < 1e-9, "the contenders did not do the same work"
    data["mujoco"] = attempt(lambda: FRAMES * contenders.mujoco(19))
    if elastica is None:
        data["pyelastica"] = "no Python that has it was given (--elastica)"
    else:
        data["pyelastica"] = attempt(
            lambda: FRAMES * contenders.STATES * contenders.pyelastica(elastica, 19)["seconds"]
        )
    torch.set_num_threads(2)
    slices = GRID // SLICE if full_grid else 1
    data["grid"] = {s: {**grid(s, slices), "scaled": not full_grid} for s in ("jacobi", "thomas")}
    torch.set_num_threads(1)
    data["start_up"] = start_up()
    return data


def attempt(work: Callable[[], float]) -> float | str:
    """The seconds, or in words why there are none."""
    try:
        return work()
    except (ImportError, OSError, RuntimeError, subprocess.TimeoutExpired) as problem:
        return f"{type(problem).__name__}: {problem}"[:120]


def table(data: dict[str, Any]) -> str:
    a = data["equilibrium"]
    ours = a["20"]["gradient_s"]

    def row(name: str, seconds: float | str, remark: str) -> str:
        if isinstance(seconds, str):
            return f"| {name} | - | - | {seconds} |"
        return f"| {name} | {1e3 * seconds:.1f} | {seconds / ours:.1f} x | {remark} |"

    lines = [
        f"{FRAMES} ropes of 20 nodes, pinned, float64, one thread, shortest of several runs; from",
        "a cold start to states and the gradient of a loss in six parameters. Written by",
        "`python -m benchmarks.speed`.",
        "",
        "| contender | [ms] | against ropefit | remark |",
        "|---|---|---|---|",
        row("ropefit, equilibrium", ours, "converged, residual below 1e-9"),
    ]
    for solver in ("jacobi", "thomas"):
        for key, name in (
            ("compiled", "ropefit, Algorithm 1"),
            ("careful", "careful torch, Algorithm 1"),
            ("reference", "ropefit's readable Algorithm 1"),
        ):
            lines.append(
                row(f"{name}, {solver}", data[solver][key]["gradient_s"],
                    "100 iterations, not converged")
            )  # fmt: skip
    scaled = "to rest, central differences; one frame timed and scaled"
    lines += [
        row("MuJoCo 4", data["mujoco"], scaled),
        row("PyElastica", data["pyelastica"], f"{scaled}, one state of {contenders.STATES}"),
        "",
        "| nodes | solve [ms] | with gradient [ms] | Newton iterations | largest residual |",
        "|---|---|---|---|---|",
    ]
    for nodes, m in a.items():
        lines.append(
            f"| {nodes} | {1e3 * m['solve_s']:.2f} | {1e3 * m['gradient_s']:.2f} "
            f"| {m['iterations']:.1f} | {m['residual']:.0e} |"
        )
    lines += [
        "",
        "| Algorithm 1, 100 iterations | forward [ms] | with gradient [ms] "
        "| grid of 15,625 candidates, two threads [s] | processor time a thread [s] |",
        "|---|---|---|---|---|",
    ]
    for solver in ("jacobi", "thomas"):
        m, g = data[solver]["compiled"], data["grid"][solver]
        mark = " (one slice of 25, scaled)" if g["scaled"] else ""
        lines.append(
            f"| {solver} | {1e3 * m['forward_s']:.2f} | {1e3 * m['gradient_s']:.2f} "
            f"| {g['seconds']:.0f}{mark} | {g['processor_s']:.0f} |"
        )
    up = data["start_up"]
    growth = a[str(NODES[-1])]["gradient_s"] / ours
    lines += [
        "",
        f"From 20 to 400 nodes the time grows {growth:.1f} times. From nothing imported to the",
        f"first solution, compiled code cached: {up['seconds']:.1f} s, of processor time "
        f"{up['processor_s']:.1f} s,",
        f"of which importing numpy and torch {up['libraries_s']:.1f} s.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the tables; write them where asked."""
    arguments = parser(__doc__)
    arguments.add_argument("--grid", action="store_true", help="the whole grid, not one slice")
    arguments.add_argument("--elastica", type=Path, help="a Python that has PyElastica")
    options = arguments.parse_args()
    one_thread()
    data = measure(options.grid, options.elastica)
    publish(options, "speed", table(data), data)


if __name__ == "__main__":
    main()
