"""Real recordings with one false statement: the noise is real and the truth is exact."""

from __future__ import annotations

import csv
import re
import shutil
import tomllib
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.discovery.run import diagnose, kept, stages
from benchmarks.discovery.score import VISIBLE, names_of
from ropefit.artifacts import Diagnosis
from ropefit.runs.loading import load

TILT, CLAMP, SCALE, WEAK_GRAVITY = np.radians(3.0), np.radians(5.0), 0.01, 4.81
# Multiples of these errors: the smallest are hidden by what the nominal model leaves unexplained.
# Gravity is stated as that value, half of it and a quarter.
TIMES = (1, 3, 9)


def copied(source: Path, folder: Path, name: str) -> None:
    """Copy a recording under another name."""
    if folder.exists():
        shutil.rmtree(folder)
    shutil.copytree(source, folder)
    text = (folder / "recording.toml").read_text().splitlines()
    text = [f'name = "{name}"' if line.startswith("name") else line for line in text]
    (folder / "recording.toml").write_text("\n".join(text) + "\n")


def gravity(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Change gravity in recording.toml."""
    path = folder / "recording.toml"
    old = np.array(tomllib.loads(path.read_text())["gravity"], dtype=float)
    row = "gravity = [" + ", ".join(f"{value:.6f}" for value in change(old)) + "]"
    lines = [row if line.startswith("gravity") else line for line in path.read_text().splitlines()]
    path.write_text("\n".join(lines) + "\n")


def tilted_gravity(folder: Path, tilt: float = TILT) -> None:
    turn = Rotation.from_rotvec([0.0, tilt, 0.0])
    gravity(folder, turn.apply)


def weak_gravity(folder: Path, size: float = WEAK_GRAVITY) -> None:
    gravity(folder, lambda old: old * size / np.linalg.norm(old))


def scaled(folder: Path, share: float = SCALE) -> None:
    """Move markers a share farther from their common centre; the ends stay."""
    path = folder / "markers.npz"
    with np.load(path) as file:
        data = dict(file)
    points = data["positions"]
    centre = np.nanmean(points, axis=(0, 1))
    data["positions"] = centre + (1 + share) * (points - centre)
    np.savez_compressed(path, **data)


def turned_clamp(folder: Path, angle: float = CLAMP) -> None:
    """Turn the recorded clamp of end 0 by an angle [rad], across the rope."""
    path = folder / "ends.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        if int(row["end"]) != 0:
            continue
        x, y, z, w = (
            Rotation.from_quat([float(row[key]) for key in ("qx", "qy", "qz", "qw")])
            * Rotation.from_rotvec([angle, 0.0, 0.0])
        ).as_quat()
        row |= {
            key: f"{v:.8f}" for key, v in zip(("qw", "qx", "qy", "qz"), (w, x, y, z), strict=True)
        }
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


Falsehoods = dict[str, tuple[Callable[[Path], None], set[str]]]


def _falsehoods() -> Falsehoods:
    """Return what is stated falsely, how, and the names that are right for it."""
    out: Falsehoods = {}
    for times in TIMES:
        tilt = partial(tilted_gravity, tilt=times * TILT)
        out[f"gravity tilted by {3 * times} degrees"] = tilt, {"gravity_misalignment"}
    for part in (1, 2, 4):
        weak = partial(weak_gravity, size=WEAK_GRAVITY / part)
        out[f"gravity of {WEAK_GRAVITY / part:.2f} m/s2"] = weak, {"weight_error"}
    for times in TIMES:
        out[f"coordinates scaled by {times} %"] = (
            partial(scaled, share=times * SCALE),
            {"scale_error"},
        )
    for times in TIMES:
        turn = partial(turned_clamp, angle=times * CLAMP)
        out[f"a clamp turned by {5 * times} degrees"] = turn, {"clamped_end", "end_offset"}
    return out


FALSEHOODS = _falsehoods()

# The rest shape that each is identified with: what its markers still determine.
SHAPES: dict[str, tuple[str, tuple[str, ...]]] = {
    "cable_black_unweighted": ("varying curvature", ("--free", "EI,rest_curve")),
    "wire_black": ("uniform curvature", ("--free", "EI,curvature_1,curvature_2")),
}


def table(real: Path, out: Path) -> tuple[str, dict[str, Any]]:
    """Diagnose each falsehood on each recording, with the true run of the same rope as nominal."""
    folder, data, counts = out / "real", {}, Counter[str]()
    lines = [
        "Real recordings with one false statement each, diagnosed with the unchanged run of the",
        "same recording, as identified, for `--nominal`; written by `python -m",
        "benchmarks.discovery --real-only`. *Score*: signal to noise of the best right effect in",
        "the scan, after calibration and with what the nominal rope misses in its own recording as",
        f"noise; visible from {VISIBLE:g} on. *Time*: of `diagnose`, two cores shared by many.",
        "",
        "| recording | stated falsely (right answer) | score | named | answer | time [s] |",
        "|---|---|---|---|---|---|",
    ]
    for name, (shape, free) in SHAPES.items():
        if not (real / name).is_dir():
            continue
        plain = folder / "runs" / name
        kept(
            folder / f"{name}.json",
            lambda s=real / name, r=plain, f=free: stages(
                ("preprocess", s, "--run", r), ("identify", "--run", r, *f)
            ),
        )
        for number, (what, (change, right)) in enumerate(FALSEHOODS.items()):
            case = f"{name}-{number}"
            source, run = folder / "recordings" / case, folder / "runs" / case
            if not source.exists():
                copied(real / name, source, case)
                change(source)
            found = kept(
                folder / f"{case}.json",
                lambda s=source, r=run, f=free, p=plain: diagnose(s, r, nominal=p, identify=f),
            )
            data[f"{name}, {shape}: {what}"] = found
            score = score_of(load(run, Diagnosis)[0], right) if found["answer"] else 0.0
            counts.update(outcome(right, score, found["answer"]))
            lines.append(
                f"| {name}, {shape} | {what} ({' / '.join(sorted(right))}) | {score:.3g} "
                f"| {_cell(right, found)} | {_told(found)} "
                f"| {found['seconds'].get('diagnose', 0):.0f} |"
            )
    lines += [
        "",
        f"Visible: {counts['visible']}, of these named: {counts['named']}, named wrongly with "
        f"confidence: {counts['wrong']}; of {counts['all']} in all.",
    ]
    return "\n".join(lines) + "\n", data


def score_of(found: Diagnosis, right: set[str]) -> float:
    """Return the signal to noise of the best right effect in the scan of the nominal model."""
    return max((one.score for one in found.scan.values() if one.name in right), default=0.0)


def outcome(right: set[str], score: float, answer: dict[str, Any] | None) -> list[str]:
    """Return what a falsehood counts as."""
    sets = [names_of(effect) for effect in answer["effects"]] if answer else []
    named = any(one & right for one in sets)
    wrong = answer is not None and answer["verdict"] == "found" and not named
    visible = ["visible", *(["named"] if named else [])] if answer and score >= VISIBLE else []
    return ["all", *visible, *(["wrong"] if wrong else [])]


def _cell(right: set[str], found: dict[str, Any]) -> str:
    """Return whether a right name was given, alone or in a tie."""
    if found["answer"] is None:
        return "-"
    sets = [names_of(effect) for effect in found["answer"]["effects"]]
    return "**yes**" if any(one & right for one in sets) else "no"


def _told(found: dict[str, Any]) -> str:
    """Return the effects that were named with their equivalents, or the verdict."""
    answer = found["answer"]
    if answer is None:
        return "no answer: " + re.split("[,;]", found["error"].split("ropefit: ")[-1])[0]
    sets = [
        "/".join([effect["name"], *effect["equivalent_to"]]) + f" ({_size(effect)})"
        for effect in answer["effects"]
    ]
    return ", ".join(sets) or f"`{answer['verdict']}`"


def _size(effect: dict[str, Any]) -> str:
    """Return the first quantity of an effect with its interval."""
    key, size = next(iter(effect["parameters"].items()))
    low, high = size["ci95"]
    return f"{key} {size['value']:.3g}, {low:.3g} .. {high:.3g}"
