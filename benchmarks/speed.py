"""Algorithm 1, reference (torch) against compiled: the same ropes, the same run, one thread.

python -m benchmarks.speed [--write docs/results.md] [--json FILE]
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import torch

from benchmarks.document import parser, publish
from ropefit.inference.rope import Ends, build_rope
from ropefit.solvers.compiled import simulate_compiled
from ropefit.solvers.xpbd import SOLVERS, Eta, Settings, State, simulate

CASES = [(20, 10, 30), (40, 10, 100)]  # particles, steps, iterations
FRAMES = 36
WEIGHTS = (0.04, 0.9, 0.8, 0.7, 0.6, 0.9)


def measure(solver: str, nodes: int, steps: int, iterations: int) -> dict[str, float]:
    """Best of three [s], forward and forward with gradient of six weights, both implementations."""
    position = np.zeros((FRAMES, 2, 3))
    position[:, 0, 0] = np.linspace(0.35, 0.95, FRAMES)
    settings = Settings(steps, iterations)
    rope = build_rope(
        length=1.0,
        nodes=nodes,
        gravity=np.array([0.0, 0.0, -9.81]),
        ends=Ends(position, np.full((FRAMES, 2, 4), np.nan)),
        solver=solver,
        settings=settings,
    )

    def run(implementation: Callable[..., State], gradient: bool) -> tuple[float, torch.Tensor]:
        weights = [torch.tensor(w, dtype=torch.float64, requires_grad=gradient) for w in WEIGHTS]
        start = time.perf_counter()
        state = implementation(
            rope.start,
            rope.rest,
            rope.chain,
            Eta(*weights),
            SOLVERS[solver],
            rope.gravity,
            settings,
        )
        if gradient:
            torch.autograd.grad((state.x**2).sum(), weights)
        return time.perf_counter() - start, state.x.detach()

    out: dict[str, float] = {}
    answers = []
    for name, implementation in (("reference", simulate), ("compiled", simulate_compiled)):
        run(implementation, True)  # compile, fill caches
        out[name] = min(run(implementation, False)[0] for _ in range(3))
        out[f"{name}_gradient"] = min(run(implementation, True)[0] for _ in range(3))
        answers.append(run(implementation, False)[1])
    out["difference_m"] = float((answers[0] - answers[1]).abs().max())
    return out


def main() -> None:
    """Print the table; write it where asked."""
    arguments = parser(__doc__)
    options = arguments.parse_args()
    torch.set_num_threads(1)
    lines = [
        f"{FRAMES} ropes, float64, one thread, best of three; written by",
        "`python -m benchmarks.speed`.",
        "",
        "| solver | K | iterations | reference [s] | + gradient [s] | compiled [s] "
        "| + gradient [s] | faster | largest difference [m] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    data = {}
    for solver in ("jacobi", "thomas"):
        for nodes, steps, iterations in CASES:
            m = measure(solver, nodes, steps, iterations)
            data[f"{solver}-{nodes}-{steps}x{iterations}"] = m
            gain = m["reference_gradient"] / m["compiled_gradient"]
            lines.append(
                f"| {solver} | {nodes} | {steps} x {iterations} | {m['reference']:.3f} "
                f"| {m['reference_gradient']:.2f} | {m['compiled']:.4f} "
                f"| {m['compiled_gradient']:.3f} | {gain:.0f} x | {m['difference_m']:.0e} |"
            )
    text = "\n".join(lines) + "\n"
    publish(options, "speed", text, data)


if __name__ == "__main__":
    main()
