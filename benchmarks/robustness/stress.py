"""Random ropes in random motions: how many states are found, marked, or wrong.

python -m benchmarks.robustness.stress [--ropes 10800] [--write docs/robustness.md] [--json FILE]
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from benchmarks.document import parser, publish
from benchmarks.robustness.quasi_static import (
    FINER,
    SHARP,
    concatenated,
    distance_to_reference,
    follow_random_paths,
    largest_joint_angle,
    rope,
    whole_turns,
)
from benchmarks.robustness.random_ropes import motions
from benchmarks.threads import use_threads
from reference_simulators.energy_balance import energy_gain, equilibrium_residual, step_residual
from ropefit.solvers.dynamics import solve as dynamics
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.stability import stability

ROPES = 10_800
NODES = (20, 30, 40)
FRAMES = 6  # of a rope that is led
STEPS = 40  # of a rope in motion
WRONG = 1e-8  # imbalance of a state that is called converged
OFF_STEP = 1e-6  # of a step; forces of a rope that hardly stretches come from tiny strains
COMPARED = 40  # frames of a kind that are compared with the boundary-value solution
OTHER = 0.02  # of the length: farther from it the refined state is another one
GAINED = 0.02  # of the energy in motion and in height: more is gained out of nothing
FAR = 0.01  # of the length that an end moves in a step: a fifth of a segment

STILL = f"""\
Moved quasi-statically in {FRAMES} frames, each started from the one before: EI 1e-6 to 1e-1 ρgL³,
ends 0.02 to 0.999 L apart. *Wrong*: reported as converged, but the energy (by automatic
differentiation, independent of the solver) is not stationary. *Wound up*: by a
whole turn since the frame before, where no joint is bent beyond a right angle (*sharp*: frames
where one is; there a turn may slip through). *Reference*: distance of the nodes from the
boundary-value solution over the length, of {COMPARED} frames drawn at random, median and largest;
*refined*: of a rope of {FINER} times the segments started from the same state; *elsewhere*: beyond
{OTHER:g}."""
MOVED = f"""\
In motion with inertia, {STEPS} implicit steps of 1 to 50 ms: ends on random paths of up to half a
radian and a quarter of a length at up to 3 Hz, then still; EA 10 to 1e5 N where stretchy. *No
start*: no initial equilibrium, and reported so. *Marked*: a step did not converge, and is reported
so; *far* where an end moves more than {FAR:g} L in a step. *Wrong*: steps reported as converged
with a residual beyond {OFF_STEP:g} of the largest force. *Gained*: ropes whose energy grows, once
their ends are still, by more than {GAINED:g} of their weight times length plus
largest kinetic energy."""


def quasi_static(count: int, clamped: bool, nodes: int, seed: int) -> dict[str, Any]:
    """Count over frames of ropes that are moved quasi-statically, each from the one before."""
    m = follow_random_paths(count, clamped, nodes, FRAMES, seed)
    held = Conditions(
        np.concatenate([c.ends for c in m.conditions]),
        np.concatenate([c.clamp for c in m.conditions]),
    )
    each = rope(np.repeat(m.bend, FRAMES), nodes - 1, clamped)
    s = concatenated(m.states, each, held)
    off = equilibrium_residual(each, held, s) > WRONG
    unstable = ~(stability(s) > 0)
    rng = np.random.default_rng(seed)
    drawn = rng.choice(np.flatnonzero(s.converged), min(COMPARED, int(s.converged.sum())), False)
    far = [distance_to_reference(m, *divmod(int(k), FRAMES), clamped) for k in drawn]
    return {
        "ropes": count,
        "frames": len(s.x),
        "converged": int(s.converged.sum()),
        "marked": int((~s.converged).sum()),
        "wrong": int((s.converged & off).sum()),
        "unstable": int((s.converged & unstable).sum()),
        "wound": int(whole_turns(m).sum()),
        "sharp": int((largest_joint_angle(held, s) > SHARP).sum()),
        "compared": len(far),
        "distance": [d for d, _ in far],
        "refined": [d for _, d in far],
        "elsewhere": sum(d > OTHER for _, d in far),
    }


def in_motion(count: int, ends: str, stretchy: bool, nodes: int, seed: int) -> dict[str, Any]:
    """Count over ropes in motion, those whose ends go far in a step apart."""
    m = motions(count, ends, stretchy, nodes, STEPS, seed)
    found = dynamics.solve(m.rope, m.drive, m.start)
    off = np.nan_to_num(step_residual(m.rope, m.drive, m.start, found))
    there = np.isfinite(found.x.sum((-1, -2)))
    gain = energy_gain(m.rope, m.drive, m.start, found, m.rest)
    moves = np.nan_to_num(np.diff(m.drive.ends, axis=1))
    stride = np.linalg.norm(moves, axis=-1).max((1, 2))
    near = stride <= FAR
    ok = found.converged
    return {
        "ropes": count,
        "no start": count - len(ok),
        "converged": int(ok.sum()),
        "marked near": [int((~ok & near).sum()), int(near.sum())],
        "marked far": [int((~ok & ~near).sum()), int((~near).sum())],
        "silent": int((ok & ~there.all(axis=-1)).sum()),
        "steps": int(there[:, 1:].sum()),
        "wrong": int((off > OFF_STEP).sum()),
        "worst": float(off.max()),
        "gained": int((ok & (gain > GAINED)).sum()),
        "most gained": float(gain[ok].max()),
    }


def main() -> None:
    """Print the tables; write them where asked. Exit 1 when something is wrong."""
    p = parser(__doc__)
    p.add_argument("--ropes", type=int, default=ROPES, help="in all, over twelve kinds")
    options = p.parse_args()
    use_threads(1)
    every = options.ropes // 12
    still = {}
    for seed, (clamped, nodes) in enumerate(product((False, True), NODES)):
        name = f"{'clamped' if clamped else 'pinned'}, K = {nodes}"
        still[name] = quasi_static(every, clamped, nodes, seed)
        print(name, flush=True)
    moved = {}
    for seed, (ends, stretchy) in enumerate(product(("pinned", "clamped", "hung"), (False, True))):
        name = f"{ends}, {'stretchy' if stretchy else 'inextensible'}"
        moved[name] = in_motion(every, ends, stretchy, NODES[seed % 3], 100 + seed)
        print(name, flush=True)
    publish(options, "stress", table(still, moved), {"still": still, "moved": moved})
    wrong = sum(r["wrong"] for r in [*still.values(), *moved.values()])
    wrong += sum(r["elsewhere"] for r in still.values())
    wrong += sum(r["silent"] for r in moved.values())
    raise SystemExit(wrong > 0)


def table(still: dict[str, dict[str, Any]], moved: dict[str, dict[str, Any]]) -> str:
    ropes = sum(r["ropes"] for r in [*still.values(), *moved.values()])
    rows = [
        f"{ropes} random ropes in random motions; written by",
        "`python -m benchmarks.robustness.stress`.",
        "",
        STILL,
        "",
        "| ends | ropes | frames | converged | marked | wrong | unstable | wound up | sharp "
        "| references found | reference | refined | elsewhere |",
        "|---" * 13 + "|",
    ]
    for name, r in still.items():
        known = np.isfinite(r["refined"])
        near, fine = (np.array(r[key])[known] for key in ("distance", "refined"))
        rows.append(
            f"| {name} | {r['ropes']} | {r['frames']} | {r['converged']} | {r['marked']} "
            f"| {r['wrong']} | {r['unstable']} | {r['wound']} | {r['sharp']} "
            f"| {known.sum()} of {r['compared']} | {np.median(near):.1e}, {near.max():.1e} "
            f"| {np.median(fine):.1e}, {fine.max():.1e} | {r['elsewhere']} |"
        )
    rows += [
        "",
        MOVED,
        "",
        "| ends | ropes | no start | converged | marked, near | marked, far | steps | wrong "
        "| worst | gained | most gained |",
        "|---" * 11 + "|",
    ]
    for name, r in moved.items():
        near, far = (f"{a} of {b}" for a, b in (r["marked near"], r["marked far"]))
        rows.append(
            f"| {name} | {r['ropes']} | {r['no start']} | {r['converged']} | {near} | {far} "
            f"| {r['steps']} | {r['wrong']} | {r['worst']:.0e} "
            f"| {r['gained']} | {r['most gained']:.0e} |"
        )
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    main()
