"""`ropefit diagnose --simulation` in motion: a simulation that lacks a cause, beside a recording.

    python -m benchmarks.discovery.moving_simulators --elastica PYTHON [--seeds FIRST:LAST]
        [--out DIR] [--json FILE] [--write docs/another-simulator.md]

The recording is MuJoCo's rope, shaken, with one thing concealed (`motions.py`, the standard cases);
the simulation is PyElastica's rope, moved as recorded, without what is concealed, and with a
rigidity and a drag of the user's own: other than the rope's. Asked is what the simulation lacks,
and which rope it is. Finished seeds are kept in DIR.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery import motion_scenes as scenes
from benchmarks.discovery.motions import judge
from benchmarks.discovery.run import kept, stages
from benchmarks.discovery.simulators import lacks_and_has
from benchmarks.document import parser, publish

NODES = 31  # that the user's simulation tells
OWN = (0.7, 1.4)  # times the rope's: the user's rigidity, and drag


def users(scene: scenes.Scene, seed: int) -> tuple[scenes.Scene, float]:
    """Return the scene as its user simulates it, and the drag [1/s]."""
    rng = np.random.default_rng([seed, 78])
    told = scenes.as_told(scene)
    rod, factor = told.world.rod, float(rng.uniform(*OWN))
    rod = replace(rod, bending=factor * rod.bending, torsion=factor * rod.torsion)
    return replace(told, world=replace(told.world, rod=rod)), scene.rate * float(rng.uniform(*OWN))


def one(seed: int, out: Path, elastica: Path) -> dict[str, Any]:
    """Make, run and judge a seed, unless that is done."""
    recording, simulation = out / f"recording-{seed}", out / f"simulation-{seed}"
    real, own = out / f"run-{seed}", out / f"sim-{seed}"
    scene = scenes.staged(seed, "standard")
    told, drag = users(scene, seed)

    def work() -> dict[str, Any]:
        scenes.record(recording, f"motion-{seed}", scene)
        # Filmed as told: its ends, late or not, are those of the recording.
        film = scenes.filmed(told, drag, elastica, NODES)
        scenes.write(simulation, f"simulation-{seed}", scene, film)
        return stages(
            ("preprocess", recording, "--run", real),
            ("preprocess", simulation, "--run", own),
            ("identify", "--solver", "dynamics", "--holdout", "0", "--run", real),
            ("diagnose", "--run", real, "--simulation", own),
        )

    done = kept(out / f"{seed}.json", work)
    found = judged(scene, told.world.rod.bending, done["answer"])
    return {"seed": seed, "cause": scene.cause, **found, **done}


def judged(scene: scenes.Scene, rigidity: float, answer: dict[str, Any] | None) -> dict[str, Any]:
    """Return whether what is missing is named, with its size, and whether the simulation's rigidity
    [N m²] is in its interval."""
    if answer is None:
        return judge(scene.concealed, None) | {"rope": None, "own": None}
    missing = answer["simulation"]["missing"]
    lacked = answer | {"effects": [e for e in answer["effects"] if e["name"] in missing]}
    told = answer["simulation"]["rope"]["EI"]
    low, high = told["ci95"]
    return judge(scene.concealed, lacked) | {
        "rope": bool(low <= rigidity <= high), "own": told["value"] / rigidity,
    }  # fmt: skip


def table(found: list[dict[str, Any]]) -> str:
    seeds = [row["seed"] for row in found]
    rows = [
        "MuJoCo's rope, shaken, with one thing concealed, and PyElastica's, moved alike, without"
        " it, of another rigidity and drag: `ropefit diagnose --simulation` of a motion; by",
        "`python -m benchmarks.discovery.moving_simulators --elastica PYTHON --seeds "
        f"{min(seeds)}:{max(seeds) + 1}`. *EI*: the simulation's as found, over what it was given.",
        "",
        "| concealed | seed | simulation lacks (equivalent to) | named | size in its 95 % interval "
        "| what the simulation has | EI, in its interval | rms [mm]: simulation, nominal, "
        "explained | time of `diagnose` [s] |",
        "|---" * 9 + "|",
    ]
    rows += [_row(row) for row in found]
    causes = [row for row in found if row["cause"] != "nothing"]
    named, known = sum(row["in_set"] for row in causes), sum(bool(row["rope"]) for row in found)
    rows += ["", f"Named: {named} of {len(causes)}. EI in its interval: {known} of {len(found)}."]
    return "\n".join(rows) + "\n"


def _row(row: dict[str, Any]) -> str:
    a = row["answer"]
    if a is None:
        return f"| {row['cause']} | {row['seed']} | {row['error']} | no" + " | -" * 5 + " |"
    s, held = a["simulation"], a["heldout"]
    lacks, has = lacks_and_has(a)
    steps = (s["rms_m"], s["rms_converged_m"], held["rms_after_m"])
    size = {None: "-", True: "yes", False: "no"}
    return (
        f"| {row['cause']} | {row['seed']} | {lacks} "
        f"| {'yes' if row['in_set'] else 'no'} | {size[row['size']]} | {has} "
        f"| {row['own']:.2f}, {size[row['rope']]} "
        f"| {', '.join(f'{1e3 * v:.2f}' for v in steps)} | {row['seconds']['diagnose']:.0f} |"
    )


def main() -> None:
    """Make, run, judge, print."""
    arguments = parser(__doc__)
    arguments.add_argument("--seeds", default="500:508", help="FIRST:LAST")
    arguments.add_argument("--out", type=Path, default=Path("moving"), help="results' folder")
    arguments.add_argument("--elastica", type=Path, required=True, help="that has PyElastica")
    options = arguments.parse_args()
    first, last = (int(part) for part in options.seeds.split(":"))
    found = []
    for seed in range(first, last):
        found.append(one(seed, options.out, options.elastica))
        row = found[-1]
        print(seed, row["cause"], "right" if row["in_set"] else "WRONG", row["rope"], flush=True)
    publish(options, "discovery-moving-simulators", table(found), {"found": found})


if __name__ == "__main__":
    main()
