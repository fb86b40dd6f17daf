"""Blind benchmark of `ropefit diagnose` in motion: MuJoCo's rope, shaken, with one thing concealed.

    python -m benchmarks.discovery.motions [--cases standard|forces|contact|laws|gripped]
        [--seeds FIRST:LAST] [--out DIR] [--json FILE] [--write docs/results.md]
        [--elastica PYTHON]

Every seed draws a rope, its motion and what is concealed (`CAUSES` in turn, among them nothing).
With `--cases forces` the medium's drag grows as a power of the speed, or a tether pulls the rope;
with `--cases contact` it swings against a table or a thick bar, without friction.
The ends are pinned, but with `--cases gripped`: grippers hold both, and one of them turns. MuJoCo's
rope does not twist, so that these are filmed by PyElastica; so can be the standard ones.
What is told is diagnosed by `ropefit run --solver dynamics`. Finished seeds are kept in DIR.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery.motion_causes import CAUSES, GRIPPED, Concealed
from benchmarks.discovery.motion_scenes import CLIPS, FRAMES, MARKERS, Scene, record, staged
from benchmarks.discovery.motion_score import score
from benchmarks.discovery.run import kept, read_json, stages
from benchmarks.discovery.score import VISIBLE
from benchmarks.document import parser, publish

MOST_FRAMES = "8"  # hundreds of frames in motion: all clips


def make(folder: Path, seed: int, cases: str) -> tuple[str, Concealed | None]:
    """Write a recording; return what is concealed in it."""
    scene = staged(seed, cases)
    record(folder, f"motion-{seed}", scene)
    return scene.cause, scene.concealed


def diagnosed(recording: Path, run: Path) -> dict[str, Any]:
    """Run the three stages on a recording in motion."""
    return stages(
        ("preprocess", recording, "--run", run),
        ("identify", "--solver", "dynamics", "--holdout", "0", "--run", run),
        ("diagnose", "--most-frames", MOST_FRAMES, "--run", run),
    )


def one(seed: int, out: Path, cases: str, elastica: Path | None) -> dict[str, Any]:
    """Make, run and judge a seed, unless that is done."""
    recording, run, result = out / f"recording-{seed}", out / f"run-{seed}", out / f"{seed}.json"
    scene = staged(seed, cases)
    if not (result.exists() and (recording / "markers.npz").exists()):
        record(recording, f"motion-{seed}", scene, elastica)
    done = kept(result, lambda: diagnosed(recording, run))
    judged = judge(scene.concealed, done["answer"])
    seen = {"score": visibility(scene, recording, run, out / f"score-{seed}.json", elastica)}
    return {"seed": seed, "cause": scene.cause, **judged, **seen, **done}


def visibility(
    scene: Scene, recording: Path, run: Path, stored: Path, elastica: Path | None = None
) -> float | None:
    """Return the score of what is concealed, kept in a file; None of nothing, or of a recording
    that was not identified."""
    if scene.concealed is None or not (run / "model.h5").exists():
        return None
    if not stored.exists():
        stored.write_text(json.dumps({"score": score(scene, recording, run, elastica)}) + "\n")
    return read_json(stored)["score"]


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


def table(found: list[dict[str, Any]], cases: str, elastica: bool = False) -> str:
    seeds = [row["seed"] for row in found]
    asked = "" if cases == "standard" else f"--cases {cases} "
    command = f"motions {asked}--seeds {min(seeds)}:{max(seeds) + 1}"
    command += " --elastica PYTHON" * elastica
    shaken = "shaken between grippers, one of which turns" if cases == GRIPPED else "shaken"
    rows = [
        f"{len(found)} recordings of {'PyElastica' if elastica else 'MuJoCo'}'s rope, {shaken}: "
        f"{CLIPS} clips of {FRAMES} frames, {MARKERS} markers; by",
        f"`python -m benchmarks.discovery.{command}`. Errors (rms of held-out markers) and times "
        "are medians, as are scores: signal over noise, without what stiffness and dampings "
        f"explain; *visible* is a score of at least {VISIBLE:.0f} (`motion_score.py`).",
        "",
        "| concealed | score | recordings | named first | in the set | size in its 95 % interval "
        "| error before → after [mm] | time of `diagnose` [s] |",
        "|---" * 8 + "|",
    ]
    causes = list(dict.fromkeys(cause.__name__ for cause in CAUSES[cases]))
    causes = [name for name in causes if any(row["cause"] == name for row in found)]
    rows += [_row(name, [row for row in found if row["cause"] == name]) for name in causes]
    wrong = [f"{row['seed']} ({_what(row)}): {_said(row)}" for row in found if not row["right"]]
    outside = [f"{row['seed']} ({row['cause']})" for row in found if row["size"] is False]
    with_cause = [row for row in found if row["cause"] != "nothing"]
    visible = [row for row in with_cause if (row["score"] or 0.0) >= VISIBLE]
    rows.append(_row("all with a cause", with_cause))
    if visible:
        rows.append(_row("visible, all", visible))
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
    scores = [row["score"] for row in found if row["score"] is not None]
    return (
        f"| {name} | {f'{np.median(scores):.0f}' if scores else '-'} | {len(found)} "
        f"| {sum(row['first'] for row in found)} "
        f"| {sum(row['in_set'] for row in found)} "
        f"| {f'{sum(sized)} of {len(sized)}' if sized else '-'} "
        f"| {before:.2f} → {after:.2f} | {seconds:.0f} |"
    )


def _what(row: dict[str, Any]) -> str:
    """Return in words what is concealed."""
    return row["cause"] + (f", score {row['score']:.0f}" if row["score"] is not None else "")


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
    arguments.add_argument("--elastica", type=Path, help="a Python that has PyElastica")
    options = arguments.parse_args()
    if options.cases == GRIPPED and not options.elastica:
        arguments.error("MuJoCo's rope does not twist: give --elastica PYTHON")
    first, last = (int(part) for part in options.seeds.split(":"))
    found = []
    for seed in range(first, last):
        found.append(one(seed, options.out, options.cases, options.elastica))
        print(seed, found[-1]["cause"], "right" if found[-1]["right"] else "WRONG", flush=True)
    section = "discovery-motions" + (f"-{options.cases}" * (options.cases != "standard"))
    section += "-elastica" * (bool(options.elastica) and options.cases != GRIPPED)
    rows = table(found, options.cases, bool(options.elastica))
    publish(options, section, rows, {"found": found})


if __name__ == "__main__":
    main()
