"""Blind benchmark of `ropefit diagnose` in motion: MuJoCo's rope, shaken, with one thing concealed.

    python -m benchmarks.discovery.motions [--cases standard|forces|contact|laws]
        [--seeds FIRST:LAST] [--out DIR] [--json FILE] [--write docs/results.md]

Every seed draws a rope, its motion and what is concealed (`CAUSES` in turn, among them nothing).
With `--cases forces` the medium's drag grows as a power of the speed, or a tether pulls the rope;
with `--cases contact` it swings against a table or a thick bar, without friction.
The ends are pinned: between clamps clean ropes of ropefit and MuJoCo were 3 to 7 mm (rms) apart,
for a reason that is not known (MuJoCo's rope does not twist).
What is told is diagnosed by `ropefit run --solver dynamics`. Finished seeds are kept in DIR.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.discovery.motion_causes import CAUSES, FIRST_POSES, Concealed, Told
from benchmarks.discovery.run import kept, stages
from benchmarks.discovery.setting import Setting, World, draw
from benchmarks.document import parser, publish
from reference_simulators import mujoco_rope
from reference_simulators.rod_equations import Array

CLIPS, FRAMES, STEP = 3, 150, 0.01  # s
PAUSE = 10.0  # s between clips
MARKERS = 11
NOISE = (5e-5, 2e-4)  # m per coordinate
DRAG = (0.1, 0.8)  # 1/s, of the medium
LAW_DRAG, LAW_SPEED = 4.0, 0.5  # times that, at a speed [m/s], where it is not linear
RISE = 0.3  # s, until the sway is at its height
FARTHEST = 0.985  # of the rope's length: no farther are the ends ever apart
MOST_FRAMES = "8"  # hundreds of frames in motion: all clips


def make(folder: Path, seed: int, cases: str) -> tuple[str, Concealed | None]:
    """Write a recording; return what is concealed in it."""
    rng = np.random.default_rng([seed, 77])
    cause = CAUSES[cases][seed % len(CAUSES[cases])]
    setting = draw(False, rng, count=12)
    world, told, concealed = cause(setting, rng)
    rate, noise = float(rng.uniform(*DRAG)), float(rng.uniform(*NOISE))
    power = concealed.drag if concealed else 1.0
    law = rate if power == 1 else _powered(rate, power)
    lines, ends = [], []
    times = np.arange(0.0, STEP * (FRAMES - 0.5), STEP)
    for clip in range(CLIPS):
        pose = sway(world, FIRST_POSES[clip], rng)
        rope = mujoco_rope.Rope(world.rod, world.held, setting.diameter)
        rope.rest(pose(0.0))
        seen = rope.filmed(pose, times, law)
        at = np.linspace(0, world.rod.length, MARKERS)
        lines.append(CubicSpline(rope.arc_length, seen, axis=1)(at))
        late = times - told.lag
        ends.append(np.stack([[pose(t)[0], world.held.positions[0, 1]] for t in late]))
    markers = np.concatenate(lines)
    markers += noise * rng.standard_normal(markers.shape)
    path = np.concatenate(ends)
    _write(folder, f"motion-{seed}", setting, told, path, markers)
    if concealed is not None and concealed.above_ends:
        concealed = replace(concealed, size=concealed.size - float(path[..., 2].mean()))
    return cause.__name__, concealed


def _powered(rate: float, power: float) -> mujoco_rope.Drag:
    """Return a drag per mass and speed that grows with the speed, LAW_DRAG times `rate` at
    LAW_SPEED."""
    return lambda speeds: LAW_DRAG * rate * np.maximum(speeds / LAW_SPEED, 0.01) ** (power - 1)


def sway(world: World, frame: int, rng: np.random.Generator) -> Callable[[float], Any]:
    """Return place (3,) [m] and direction (3,) of end 0 at a time [s]: shaken about a pose."""
    first, other = world.held.positions[frame, :2]
    way = np.array([1.0, 0.0, 0.0])  # of a pinned end: says nothing
    first = first + 0.1 * (other - first)  # room to be shaken in
    reach: Array = 0.07 * world.rod.length * rng.uniform(0.7, 1.2, 3)
    rate, phase = rng.uniform(4, 9, 3), rng.uniform(0, 2 * np.pi, 3)

    def shaken(time: float) -> Array:
        grown = min(max(time, 0.0) / RISE, 1.0) ** 2
        return grown * reach * (np.sin(rate * time + phase) - np.sin(phase))

    times = np.arange(-0.1, STEP * FRAMES + 0.1, STEP / 2)
    size = 1.0
    while _apart(first + size * np.stack([shaken(t) for t in times]), other) > (
        FARTHEST * world.rod.length
    ):
        size *= 0.9
    return lambda time: (first + size * shaken(time), way)


def _apart(ends: Array, other: Array) -> float:
    """Return the largest distance [m] of ends (T, 3) from the other end (3,)."""
    return float(np.linalg.norm(ends - other, axis=-1).max())


def _write(
    folder: Path, name: str, setting: Setting, told: Told, ends: Array, markers: Array
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    time = np.concatenate(
        [STEP * np.arange(FRAMES) + k * (PAUSE + STEP * FRAMES) for k in range(CLIPS)]
    )
    rod, length = setting.rod, told.length * setting.rod.length
    arc = np.linspace(0, length, MARKERS)
    np.savez(folder / "markers.npz", positions=markers, time=time, arc_length=arc)
    rows = ["frame,time,end,x,y,z"]
    for f, now in enumerate(time):
        for end in range(2):
            rows.append(f"{f},{now:.9g},{end}," + ",".join(f"{v:.9g}" for v in ends[f, end]))
    (folder / "ends.csv").write_text("\n".join(rows) + "\n")
    size, tilt = told.gravity * 9.81, told.gravity_tilt
    gravity = [size * np.sin(tilt), 0.0, -size * np.cos(tilt)]
    mass = rod.density * rod.length
    (folder / "recording.toml").write_text(
        f'format = "ropefit-recording/1"\nname = "{name}"\n'
        f"gravity = {[round(float(v), 9) for v in gravity]}\n"
        f"[rope]\nlength = {length:.9g}\nmass = {mass:.9g}\n"
        '[ends]\nfile = "ends.csv"\n[markers]\nfile = "markers.npz"\n'
    )


def diagnosed(recording: Path, run: Path) -> dict[str, Any]:
    """Run the three stages on a recording in motion."""
    return stages(
        ("preprocess", recording, "--run", run),
        ("identify", "--solver", "dynamics", "--holdout", "0", "--run", run),
        ("diagnose", "--most-frames", MOST_FRAMES, "--run", run),
    )


def one(seed: int, out: Path, cases: str) -> dict[str, Any]:
    """Make, run and judge a seed."""
    recording, run = out / f"recording-{seed}", out / f"run-{seed}"
    kind, concealed = make(recording, seed, cases)
    done = kept(out / f"{seed}.json", lambda: diagnosed(recording, run))
    return {"seed": seed, "cause": kind, **judge(concealed, done["answer"]), **done}


def judge(concealed: Concealed | None, answer: dict[str, Any] | None) -> dict[str, Any]:
    """Return whether an answer is right, names the cause first, or at all, and has its size."""
    effects = answer["effects"] if answer else []
    if concealed is None:
        right = answer is not None and answer["verdict"] == "none"
        return {"right": right, "first": right, "in_set": right, "size": None}
    named = [{e["name"], *e["equivalent_to"]} for e in effects]
    first = bool(effects) and effects[0]["name"] in concealed.names
    in_set = any(n & set(concealed.names) for n in named)
    size = None
    own = next((e for e in effects if e["name"] in concealed.names), None)
    told = None
    if own:
        of_law = (own.get("law") or {}).get("parameters", {})
        told = (own["parameters"] | of_law).get(concealed.key)
    if told:
        low, high = told["ci95"]
        size = bool(low <= concealed.size <= high)
    return {"right": first, "first": first, "in_set": in_set, "size": size, "true": concealed.size}


def table(found: list[dict[str, Any]], cases: str) -> str:
    seeds = [row["seed"] for row in found]
    asked = "" if cases == "standard" else f"--cases {cases} "
    command = f"motions {asked}--seeds {min(seeds)}:{max(seeds) + 1}"
    rows = [
        f"{len(found)} recordings of MuJoCo's rope, shaken: {CLIPS} clips of {FRAMES} frames, "
        f"{MARKERS} markers; by",
        f"`python -m benchmarks.discovery.{command}`. Errors (rms of held-out markers) and times "
        "are medians.",
        "",
        "| concealed | recordings | named first | in the set | size in its 95 % interval "
        "| error before → after [mm] | time of `diagnose` [s] |",
        "|---" * 7 + "|",
    ]
    causes = list(dict.fromkeys(cause.__name__ for cause in CAUSES[cases]))
    causes = [name for name in causes if any(row["cause"] == name for row in found)]
    rows += [_row(name, [row for row in found if row["cause"] == name]) for name in causes]
    wrong = [f"{row['seed']} ({row['cause']}): {_said(row)}" for row in found if not row["right"]]
    outside = [f"{row['seed']} ({row['cause']})" for row in found if row["size"] is False]
    rows.append(_row("all with a cause", [row for row in found if row["cause"] != "nothing"]))
    rows += ["", f"Not right: {'; '.join(wrong) or 'none'}."]
    rows += [f"Size outside its interval: {', '.join(outside) or 'none'}."]
    return "\n".join(rows) + "\n"


def _row(name: str, found: list[dict[str, Any]]) -> str:
    """Return a line of the table, of the recordings with one cause."""
    sized = [row["size"] for row in found if row["size"] is not None]
    held = [row["answer"]["heldout"] for row in found if row["answer"]]
    before, after = (
        1e3 * float(np.median([one[key] for one in held])) if held else np.nan
        for key in ("rms_before_m", "rms_after_m")
    )
    seconds = float(np.median([row["seconds"].get("diagnose", np.nan) for row in found]))
    return (
        f"| {name} | {len(found)} | {sum(row['first'] for row in found)} "
        f"| {sum(row['in_set'] for row in found)} "
        f"| {f'{sum(sized)} of {len(sized)}' if sized else '-'} "
        f"| {before:.2f} → {after:.2f} | {seconds:.0f} |"
    )


def _said(row: dict[str, Any]) -> str:
    """Return in words what was answered."""
    answer = row["answer"]
    if answer is None:
        return row["error"]
    names = ", ".join(
        effect["name"]
        + (f" ({', '.join(effect['equivalent_to'])})" * bool(effect["equivalent_to"]))
        for effect in answer["effects"]
    )
    return names or answer["verdict"]


def main() -> None:
    """Make, run, score, print."""
    arguments = parser(__doc__)
    arguments.add_argument("--cases", choices=list(CAUSES), default="standard")
    arguments.add_argument("--seeds", default="100:127", help="FIRST:LAST")
    arguments.add_argument("--out", type=Path, default=Path("motions"), help="results' folder")
    options = arguments.parse_args()
    first, last = (int(part) for part in options.seeds.split(":"))
    found = []
    for seed in range(first, last):
        found.append(one(seed, options.out, options.cases))
        print(seed, found[-1]["cause"], "right" if found[-1]["right"] else "WRONG", flush=True)
    section = "discovery-motions" + (f"-{options.cases}" * (options.cases != "standard"))
    publish(options, section, table(found, options.cases), {"found": found})


if __name__ == "__main__":
    main()
