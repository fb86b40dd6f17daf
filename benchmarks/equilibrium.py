"""The equilibrium: how accurate, how robust, how fast.

python -m benchmarks.equilibrium [--write docs/results.md] [--json FILE]
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from benchmarks.document import parser, publish
from benchmarks.placements import imbalance, placements
from benchmarks.references import Guess, Planar, catenary, elastica, helix
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution
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


def upright(angle: float) -> torch.Tensor:
    """(4,) frame whose third director is (cos θ, 0, sin θ)."""
    half = 0.5 * (math.pi / 2 - angle)
    return torch.tensor([math.cos(half), 0.0, math.sin(half), 0.0], dtype=torch.float64)


def planar(p: Planar, segments: int, density: float = 1.0) -> tuple[Rod, Conditions]:
    """The discrete rope of a planar reference, one frame; its weight is density times gravity."""
    clamped = (p.first is not None, p.last is not None)
    properties = uniform(
        length=p.length,
        segments=segments,
        bend=p.bend,
        axial=p.axial,
        shear=p.shear,
        density=density,
        curvature=(0.0, -p.curvature, 0.0),  # a turn about y lowers θ
    )
    down = torch.tensor([0.0, 0.0, -p.weight / density], dtype=torch.float64)
    rod = build(properties, down, clamped)
    load, moment = rod.load.clone(), rod.moment.clone()
    load[-1] += torch.tensor([p.force[0], 0.0, p.force[1]])
    moment[1, 1] = -p.moment
    ends = torch.zeros(1, 2, 3, dtype=torch.float64)
    ends[0, 1] = torch.nan
    if p.far is not None:
        ends[0, 1] = torch.tensor([p.far[0], 0.0, p.far[1]])
    clamp = torch.full((1, 2, 4), torch.nan, dtype=torch.float64)
    for end, angle in enumerate((p.first, p.last)):
        if angle is not None:
            clamp[0, end] = upright(angle)
    return rod._replace(load=load, moment=moment), Conditions(ends, clamp)


def guess_of(rod: Rod, solution: Solution) -> Guess:
    """Start of a reference solution: only the branch and speed depend on it, not the answer."""
    arc, x, n = rod.arc.numpy(), solution.x[0], solution.force[0]
    edge = np.diff(x, axis=0)
    angle = np.unwrap(np.arctan2(edge[:, 2], edge[:, 0]))
    middle = 0.5 * (arc[1:] + arc[:-1])
    slope = np.array([0.0, np.diff(n[:, 2]).mean() * len(n) / arc[-1]])
    force = n[0, [0, 2]] - slope * middle[0]
    return Guess(arc, np.interp(arc, middle, angle), x[:, 0], x[:, 2], force)


def deviation(p: Planar, segments: int) -> float:
    """Largest distance [m] of a node from where the boundary-value solution has its arc length.

    Raises RuntimeError where either does not converge.
    """
    rod, conditions = planar(p, segments)
    solution = solve(rod, conditions)
    if not solution.converged.all():
        raise RuntimeError(f"not converged: {p}")
    expected, _ = elastica(p, guess_of(rod, solution), rod.arc.numpy())
    return float(np.linalg.norm(solution.x[0][:, [0, 2]] - expected, axis=1).max())


def from_catenary(segments: int) -> float:
    rod, conditions = planar(Planar(1.0, 1e-9, 1.0, axial=20.0, far=(0.6, 0.2)), segments)
    expected = catenary(1.0, (0.6, 0.2), rod.arc.numpy(), stretch=0.05)
    return float(np.abs(solve(rod, conditions).x[0][:, [0, 2]] - expected).max())


def from_helix(segments: int) -> float:
    properties = uniform(length=1.0, segments=segments, bend=0.3, curvature=(4.0, 0.0, 6.0))
    rod = build(properties, torch.zeros(3, dtype=torch.float64), (True, False))
    ends = torch.zeros(1, 2, 3, dtype=torch.float64)
    ends[0, 1] = torch.nan
    clamp = torch.full((1, 2, 4), torch.nan, dtype=torch.float64)
    clamp[0, 0] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    x = solve(rod, Conditions(ends, clamp)).x[0]
    return float(np.abs(x - helix(4.0, 6.0, rod.arc.numpy())).max())


def accuracy() -> dict[str, Any]:
    """Errors over the length for each case and number of nodes, and the order that fits them."""
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
    """Counts over random placements, see `placements`."""
    p = placements(COUNT, clamped)
    start = time.perf_counter()
    s = solve(p.rod, p.conditions)
    seconds = time.perf_counter() - start
    wrong = imbalance(p, s) > WRONG
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
    torch.set_num_threads(1)
    solve(*planar(PINNED, 19))  # compile
    data = {
        "accuracy": accuracy(),
        "robustness": {kind: robustness(kind == "clamped") for kind in ("pinned", "clamped")},
    }
    heads = " | ".join(f"K = {n}" for n in NODES)
    lines = [
        "Largest distance of a node from the reference (boundary-value solution, scipy, 1e-8, or a",
        "closed form) over the length; written by `python -m benchmarks.equilibrium`.",
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
        "*Wrong*: called converged, but the energy (by autograd, apart from the solver) is not",
        "stationary.",
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
