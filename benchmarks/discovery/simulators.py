"""`ropefit diagnose --simulation`: a simulation from which a cause is withheld, beside a recording.

    python -m benchmarks.discovery.simulators [--seeds FIRST:LAST] [--out DIR] [--json FILE]
                                              [--only PATTERN] [--write docs/another-simulator.md]
                                              [--elastica PYTHON]

The recording is of a rod with one cause of a known score (`reference_simulators/`, solved as
Kirchhoff's equations); the simulation is MuJoCo's rope in the recorded poses, without that cause,
or PyElastica's, if a Python that has it is given. Asked is what the simulation lacks. Finished
cases are kept in DIR.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery import elastica_rope
from benchmarks.discovery.concealed import NEEDS_CLAMPS, NEEDS_PINS
from benchmarks.discovery.elastica_rope import STIFF
from benchmarks.discovery.made import Made, write
from benchmarks.discovery.make import Implausible, make
from benchmarks.discovery.run import kept, stages
from benchmarks.discovery.score import names_of, same_quantity
from benchmarks.document import parser, publish
from reference_simulators import mujoco_rope
from reference_simulators.kirchhoff_rod import CLAMPED, Ends
from ropefit.adapters.motion_of import times_of
from ropefit.artifacts import Observations, read

WITHHELD = (
    "nothing", "point_mass", "mass_section", "stiff_section", "tether", "support_plane", "kink",
    "clamped_end",
)  # fmt: skip
SCORE = 25.0  # signal over noise of what is withheld


def simulated(folder: Path, run: Path, made: Made, elastica: Path | None) -> None:
    """Write a recording of MuJoCo's rope, or PyElastica's, as it hangs in the poses that a run has
    observed."""
    o, _ = read(run / Observations.file_name, Observations)
    time = times_of(o)
    turns = np.nan_to_num(o.end_orientation, nan=0.5)  # of pinned ends: say nothing
    held = Ends(o.end_position, turns, made.setting.held.kinds)
    rod = made.setting.rod
    if elastica:
        arc, x = elastica_rope.shapes(elastica, rod, held)
    else:
        arc, x = mujoco_rope.shapes(rod, held, made.setting.diameter)
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "markers.npz", positions=x, time=time, arc_length=arc)
    clamped = held.kinds[0] == CLAMPED
    rows = ["frame,time,end,x,y,z" + ",qw,qx,qy,qz" * clamped]
    for f, now in enumerate(time):
        for end in range(2):
            pose = [*o.end_position[f, end], *(o.end_orientation[f, end] if clamped else ())]
            rows.append(f"{f},{now:.9g},{end}," + ",".join(f"{v:.9g}" for v in pose))
    (folder / "ends.csv").write_text("\n".join(rows) + "\n")
    (folder / "recording.toml").write_text(
        'format = "ropefit-recording/1"\nname = "simulation"\n'
        f"gravity = {[float(v) for v in rod.gravity]}\n"
        f"[rope]\nlength = {rod.length:.9g}\nmass = {rod.density * rod.length:.9g}\n"
        '[ends]\nfile = "ends.csv"\n[markers]\nfile = "markers.npz"\n'
    )


def one(cause: str, seed: int, out: Path, elastica: Path | None) -> dict[str, Any] | None:
    """Make, run and judge a case; None where no plausible size reaches the score."""
    name = f"{cause}-{seed}"
    names = [] if cause == "nothing" else [cause]
    clamped = cause in NEEDS_CLAMPS or (cause not in NEEDS_PINS and bool(seed % 2))
    try:
        made = make(names, [SCORE] * len(names), seed, clamped=clamped)
    except Implausible:
        return None
    real, sim = out / f"run-{name}", out / f"sim-{name}"
    truth = write(out / f"recording-{name}", out / f"{name}.truth", name, made, seed, "single")

    def work() -> dict[str, Any]:
        first = stages(
            ("preprocess", out / f"recording-{name}", "--run", real), ("identify", "--run", real)
        )
        if first["error"]:
            return first
        simulated(out / f"simulation-{name}", real, made, elastica)
        return stages(
            ("preprocess", out / f"simulation-{name}", "--run", sim),
            ("diagnose", "--run", real, "--simulation", sim),
        )

    done = kept(out / f"{name}.json", work)
    return {"cause": cause, "seed": seed, **judge(truth, done["answer"]), **done}


def judge(truth: dict[str, Any], answer: dict[str, Any] | None) -> dict[str, Any]:
    """Return whether what the simulation lacks is named, with its size in the interval."""
    if answer is None:
        return {"right": False, "size": None}
    missing = answer["simulation"]["missing"]
    found = [e for e in answer["effects"] if e["name"] in missing]
    if not truth["effects"]:
        return {"right": not missing and answer["verdict"] == "none", "size": None}
    (true,) = truth["effects"]
    right = any(true["name"] in names_of(effect) for effect in found)
    own = next((e for e in found if e["name"] == true["name"]), None)
    told, value = same_quantity(true, own["parameters"]) if own else (None, 0.0)
    size = None
    if told:
        low, high = told["ci95"]
        size = bool(low <= value <= high)
    return {"right": right, "size": size}


def table(found: list[dict[str, Any]], elastica: bool) -> str:
    name, asked = ("PyElastica", " --elastica PYTHON") if elastica else ("MuJoCo", "")
    yields = (
        f"PyElastica's elements yield: EA and GA are {STIFF:g} weights."
        if elastica
        else "MuJoCo's edges are constraints that yield: its rope stretches a little."
    )
    rows = [
        f"A rod with one cause (score {SCORE:g}), and {name}'s rope in its poses without it:",
        f"`ropefit diagnose --simulation`; by `python -m benchmarks.discovery.simulators{asked}`.",
        "*rms*: the simulation from the recording, then a rope in equilibrium, then with what is",
        f"missing; the noise. {yields}",
        "",
        "| withheld | seed | simulation lacks (equivalent to) | named | size in its 95 % interval "
        "| what the simulation has | rms [mm] |",
        "|---" * 7 + "|",
    ]
    for row in found:
        a = row["answer"]
        if a is None:
            rows.append(f"| {row['cause']} | {row['seed']} | {row['error']} | no | - | - | - |")
            continue
        s, held = a["simulation"], a["heldout"]
        lacks, has = lacks_and_has(a)
        steps = (s["rms_m"], s["rms_converged_m"], held["rms_after_m"], held["noise_m"])
        size = {None: "-", True: "yes", False: "no"}[row["size"]]
        rows.append(
            f"| {row['cause']} | {row['seed']} | {lacks} "
            f"| {'yes' if row['right'] else 'no'} | {size} | {has} "
            f"| {' → '.join(f'{1e3 * v:.2f}' for v in steps[:3])}; {1e3 * steps[3]:.2f} |"
        )
    causes = [row for row in found if row["cause"] != "nothing"]
    named = sum(row["right"] for row in causes)
    return "\n".join([*rows, "", f"Named: {named} of {len(causes)}."]) + "\n"


def lacks_and_has(answer: dict[str, Any]) -> tuple[str, str]:
    """Return in words what a simulation lacks of a recording's effects, and what it has."""
    s = answer["simulation"]
    lacks = ", ".join(
        e["name"] + f" ({', '.join(e['equivalent_to'])})" * bool(e["equivalent_to"])
        for e in answer["effects"]
        if e["name"] in s["missing"]
    )
    has = ", ".join(e["name"] for e in s["effects"])
    return lacks or answer["verdict"], has or s["verdict"]


def main() -> None:
    """Make, run, judge, print."""
    arguments = parser(__doc__)
    arguments.add_argument("--seeds", default="80:82", help="FIRST:LAST")
    arguments.add_argument("--out", type=Path, default=Path("simulators"), help="results' folder")
    arguments.add_argument("--only", default="", help="pattern of causes")
    arguments.add_argument("--elastica", type=Path, help="a Python that has PyElastica")
    options = arguments.parse_args()
    first, last = (int(part) for part in options.seeds.split(":"))
    found = []
    for seed in range(first, last):
        for cause in (c for c in WITHHELD if re.search(options.only, c)):
            case = one(cause, seed, options.out, options.elastica)
            if case is None:
                print(cause, seed, "cannot be made", flush=True)
                continue
            found.append(case)
            print(cause, seed, "right" if case["right"] else "WRONG", flush=True)
    section = "discovery-simulators" + "-elastica" * bool(options.elastica)
    publish(options, section, table(found, bool(options.elastica)), {"found": found})


if __name__ == "__main__":
    main()
