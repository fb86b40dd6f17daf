"""Speed: all contenders on the same work, in the same run, on one thread.

python -m benchmarks.speed [--write docs/results.md] [--json FILE] [--grid] [--elastica PYTHON]
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import parser, publish
from benchmarks.speed import contenders
from benchmarks.speed.workloads import FRAMES, GRID, SLICE, algorithm, equilibrium, grid
from benchmarks.threads import use_threads

NODES = (20, 40, 100, 400)
START_UP = """
import time; start, before = time.perf_counter(), time.process_time()
import numpy as np
numpy_s = time.process_time() - before
from ropefit.rod.rod import build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve
ends = np.array([[[0, 0, 0], [0.6, 0, 0]]])
down = np.array([0, 0, -9.81])
rod = build(uniform(length=1.0, segments=19, bend=1e-3), down, (False, False))
found = solve(rod, Conditions(ends, np.full((1, 2, 4), np.nan)))
assert found.converged.all()
print(time.perf_counter() - start, time.process_time() - before, numpy_s)
"""


def start_up() -> dict[str, float]:
    """Return the time [s] from nothing imported to the first solution, compiled code in the cache.

    Processor time of the same, and of importing numpy alone.
    """
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
    use_threads(1)


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
    use_threads(2)
    slices = GRID // SLICE if full_grid else 1
    data["grid"] = {s: {**grid(s, slices), "scaled": not full_grid} for s in ("jacobi", "thomas")}
    use_threads(1)
    data["start_up"] = start_up()
    return data


def attempt(work: Callable[[], float]) -> float | str:
    """Return the seconds, or in words why there are none."""
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
        f"of which importing numpy {up['libraries_s']:.1f} s.",
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
