"""The equilibrium: how accurate, how robust, how fast.

python -m benchmarks.accuracy.equilibrium [--write docs/results.md] [--json FILE]
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.document import parser, publish
from benchmarks.robustness.random_ropes import placements
from benchmarks.threads import use_threads
from reference_simulators.as_ropefit import guess_of, planar
from reference_simulators.closed_forms import catenary, helix
from reference_simulators.energy_balance import equilibrium_residual
from reference_simulators.planar_elastica import Planar, elastica
from ropefit.rod.rod import build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.stability import stability

NODES = (20, 40, 100)
COUNT = 10_000
WRONG = 1e-8  # imbalance of a state that is called converged

PINNED = Planar(1.0, 2e-4, 1.0, far=(0.65, 0.0))
CASES = {
    "hanging, pinned, EI = 2e-4 ρgL³, 0.65 L apart": PINNED,
    "the same, 0.35 L apart": Planar(1.0, 2e-4, 1.0, far=(0.35, 0.0)),
    "the same, 0.95 L apart": Planar(1.0, 2e-4, 1.0, far=(0.95, 0.0)),
    "cantilever": Planar(1.0, 0.02, 1.0, first=0.5),
    "two clamps": Planar(1.0, 0.02, 1.0, far=(0.5, -0.1), first=-1.2, last=0.7),
    "end force": Planar(1.0, 0.1, 0.5, first=0.5, force=(-0.3, 0.6)),
    "end moment": Planar(1.0, 0.1, 0.5, first=0.5, moment=0.1),
    "stretchy, sheared, bent at rest": Planar(
        1.0, 0.05, 1.0, axial=20.0, shear=8.0, curvature=1.5, first=0.5, force=(1.0, 0.0)
    ),
}


def deviation(p: Planar, segments: int) -> float:
    """Return the largest distance [m] of a node from the boundary-value solution at its arc length.

    Raises RuntimeError where either does not converge.
    """
    rod, conditions = planar(p, segments)
    solution = solve(rod, conditions)
    if not solution.converged.all():
        raise RuntimeError(f"not converged: {p}")
    expected, _ = elastica(p, guess_of(rod, solution), rod.arc)
    return float(np.linalg.norm(solution.x[0][:, [0, 2]] - expected, axis=1).max())


def from_catenary(segments: int) -> float:
    rod, conditions = planar(Planar(1.0, 1e-9, 1.0, axial=20.0, far=(0.6, 0.2)), segments)
    expected = catenary(1.0, (0.6, 0.2), rod.arc, stretch=0.05)
    return float(np.abs(solve(rod, conditions).x[0][:, [0, 2]] - expected).max())


def from_helix(segments: int) -> float:
    properties = uniform(length=1.0, segments=segments, bend=0.3, curvature=(4.0, 0.0, 6.0))
    rod = build(properties, np.zeros(3), (True, False))
    ends = np.zeros((1, 2, 3))
    ends[0, 1] = np.nan
    clamp = np.full((1, 2, 4), np.nan)
    clamp[0, 0] = [1.0, 0.0, 0.0, 0.0]
    x = solve(rod, Conditions(ends, clamp)).x[0]
    return float(np.abs(x - helix(4.0, 6.0, rod.arc)).max())


def accuracy() -> dict[str, Any]:
    """Return errors over the length by case and number of nodes, and the order that fits them."""
    errors: dict[str, Callable[[int], float]] = {
        name: lambda n, p=p: deviation(p, n) for name, p in CASES.items()
    }
    errors |= {"elastic catenary, no stiffness": from_catenary, "helix at rest": from_helix}
    out = {}
    for name, error in errors.items():
        found = [error(nodes - 1) for nodes in NODES]
        order = -np.polyfit(np.log([n - 1 for n in NODES]), np.log(found), 1)[0]
        out[name] = {"errors": found, "order": float(order)}
    return out


def robustness(clamped: bool) -> dict[str, float]:
    """Count outcomes over random placements, see `placements`."""
    p = placements(COUNT, clamped)
    start = time.perf_counter()
    s = solve(p.rod, p.conditions)
    seconds = time.perf_counter() - start
    wrong = equilibrium_residual(p.rod, p.conditions, s) > WRONG
    stable = stability(s) > 0
    return {
        "converged": int(s.converged.sum()),
        "marked": int((~s.converged).sum()),
        "wrong": int((s.converged & wrong).sum()),
        "unstable": int((s.converged & ~stable).sum()),
        "iterations_median": float(np.median(s.iterations)),
        "iterations_99": float(np.percentile(s.iterations, 99)),
        "iterations_most": int(s.iterations.max()),
        "microseconds": 1e6 * seconds / COUNT,
    }


def main() -> None:
    """Print the tables; write them where asked."""
    options = parser(__doc__).parse_args()
    use_threads(1)
    solve(*planar(PINNED, 19))  # compile
    data = {
        "accuracy": accuracy(),
        "robustness": {kind: robustness(kind == "clamped") for kind in ("pinned", "clamped")},
    }
    heads = " | ".join(f"K = {n}" for n in NODES)
    lines = [
        "Largest distance of a node from the reference (boundary-value solution by scipy to 1e-8,",
        "or a closed form) over the length; by `python -m benchmarks.accuracy.equilibrium`.",
        "",
        f"| case | {heads} | order |",
        "|---|" + "---|" * (len(NODES) + 1),
    ]
    for name, m in data["accuracy"].items():
        cells = " | ".join(f"{e:.1e}" for e in m["errors"])
        lines.append(f"| {name} | {cells} | {m['order']:.2f} |")
    lines += [
        "",
        f"{COUNT} random placements of inextensible ropes, K = 20: ends 0.02 to 0.999 L apart in",
        "any direction, EI/(ρgL³) from 1e-6 to 1e-1, clamps in any orientation; cold start.",
        "*Wrong*: reported as converged, but the energy (by automatic differentiation,",
        "independent of the solver) is not stationary.",
        "",
        "| ends | converged | marked unconverged | wrong | unstable "
        "| iterations: median, 99 %, most | time a frame [µs] |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, r in data["robustness"].items():
        lines.append(
            f"| {kind} | {r['converged']} | {r['marked']} | {r['wrong']} | {r['unstable']} "
            f"| {r['iterations_median']:.0f}, {r['iterations_99']:.0f}, {r['iterations_most']} "
            f"| {r['microseconds']:.0f} |"
        )
    publish(options, "equilibrium", "\n".join(lines) + "\n", data)


if __name__ == "__main__":
    main()
