"""Real recordings with one false statement: the noise is real and the truth is exact."""

from __future__ import annotations

import csv
import re
import shutil
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.discovery.run import diagnose, kept
from benchmarks.discovery.score import VISIBLE, names_of
from ropefit.artifacts import Diagnosis
from ropefit.runs.loading import load

QUASI_STATIC = ("cable_black_unweighted", "wire_black")
TILT, CLAMP, SCALE, WEAK_GRAVITY = np.radians(3.0), np.radians(5.0), 0.01, 4.81


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


def tilted_gravity(folder: Path) -> None:
    turn = Rotation.from_rotvec([0.0, TILT, 0.0])
    gravity(folder, turn.apply)


def weak_gravity(folder: Path) -> None:
    gravity(folder, lambda old: old * WEAK_GRAVITY / np.linalg.norm(old))


def scaled(folder: Path) -> None:
    """Move markers 1 % farther from their common centre; the ends stay."""
    path = folder / "markers.npz"
    with np.load(path) as file:
        data = dict(file)
    points = data["positions"]
    centre = np.nanmean(points, axis=(0, 1))
    data["positions"] = centre + (1 + SCALE) * (points - centre)
    np.savez_compressed(path, **data)


def turned_clamp(folder: Path) -> None:
    """Turn the recorded clamp of end 0 by 5 degrees, across the rope."""
    path = folder / "ends.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        if int(row["end"]) != 0:
            continue
        x, y, z, w = (
            Rotation.from_quat([float(row[key]) for key in ("qx", "qy", "qz", "qw")])
            * Rotation.from_rotvec([CLAMP, 0.0, 0.0])
        ).as_quat()
        row |= {
            key: f"{v:.8f}" for key, v in zip(("qw", "qx", "qy", "qz"), (w, x, y, z), strict=True)
        }
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


# What is stated falsely, how, and the names that are right for it.
FALSEHOODS: dict[str, tuple[Callable[[Path], None], set[str]]] = {
    "gravity tilted by 3 degrees": (tilted_gravity, {"gravity_misalignment"}),
    "gravity of 4.81 m/s2": (weak_gravity, {"weight_error"}),
    "coordinates scaled by 1 %": (scaled, {"scale_error"}),
    "a clamp turned by 5 degrees": (turned_clamp, {"clamped_end", "end_offset"}),
}


# The rest shape that each is identified with; the nominal run determines it.
SHAPES: dict[str, tuple[str, ...]] = {
    "straight": (),
    "uniform curvature": ("--free", "EI,curvature_1,curvature_2"),
    "varying curvature": ("--free", "EI,rest_curve"),
}


def table(real: Path, out: Path) -> tuple[str, dict[str, Any]]:
    """Diagnose each falsehood on each recording, with the true run of the same rope as nominal."""
    folder, data, counts = out / "real", {}, Counter[str]()
    columns = [f"{what} ({' / '.join(sorted(right))})" for what, (_, right) in FALSEHOODS.items()]
    lines = [
        "Real recordings with one false statement each, diagnosed with the unchanged run of the",
        "same recording as `--nominal`; written by `python -m benchmarks.discovery --real-only`.",
        "In brackets: the right names. **Yes**: a right name is in a reported set. *Score*: signal",
        "to noise of the best right effect in the scan, after calibration and with what the",
        f"nominal rope misses in its own recording as noise; visible from {VISIBLE:g} on.",
        "",
        "| recording | rest shape | unchanged | " + " | ".join(columns) + " |",
        "|---" * (3 + len(columns)) + "|",
    ]
    for name in QUASI_STATIC:
        if not (real / name).is_dir():
            continue
        for number, (change, _) in enumerate(FALSEHOODS.values()):
            copied(real / name, folder / "recordings" / f"{name}-{number}", f"{name}-{number}")
            change(folder / "recordings" / f"{name}-{number}")
        for shape, free in SHAPES.items():
            case = f"{name}-{shape.split()[0]}"
            plain = folder / "runs" / case
            found = kept(
                folder / f"{case}.json",
                lambda s=real / name, r=plain, f=free: diagnose(s, r, identify=f),
            )
            data[f"{name}, {shape}"] = found
            cells = [_cell(set(), found)]
            for number, (what, (_, right)) in enumerate(FALSEHOODS.items()):
                source = folder / "recordings" / f"{name}-{number}"
                found = kept(
                    folder / f"{case}-{number}.json",
                    lambda s=source, r=folder / "runs" / f"{case}-{number}", f=free, p=plain: (
                        diagnose(s, r, nominal=p, identify=f)
                    ),
                )
                data[f"{name}, {shape}: {what}"] = found
                run = folder / "runs" / f"{case}-{number}"
                score = score_of(load(run, Diagnosis)[0], right) if found["answer"] else 0.0
                counts.update(outcome(right, score, found["answer"]))
                cells.append(f"{_cell(right, found)} (score {score:.3g})")
            lines.append(f"| {name} | {shape} | " + " | ".join(cells) + " |")
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
    if answer is None or score < VISIBLE:
        return ["all"]
    sets = [names_of(effect) for effect in answer["effects"]]
    if any(one & right for one in sets):
        return ["all", "visible", "named"]
    return ["all", "visible", *(["wrong"] if answer["verdict"] == "found" else [])]


def _cell(right: set[str], found: dict[str, Any]) -> str:
    """Return what was named, or the verdict, and whether a right name is among it."""
    answer = found["answer"]
    if answer is None:
        return "no answer: " + re.split("[,;]", found["error"].split("ropefit: ")[-1])[0]
    sets = [names_of(effect) for effect in answer["effects"]]
    named = ", ".join("/".join(sorted(one)) for one in sets) or f"`{answer['verdict']}`"
    if not right:
        return named
    return ("**yes**: " if any(one & right for one in sets) else "no: ") + named
