"""Diagnose measured ropes in motion, given a model of the same rope at rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import ropefit
from benchmarks.real.motion import clips_of, join
from benchmarks.real.shapes import cause_cells, refused

FRAMES = "24"  # of them that the diagnosis uses
CLIPS = 4  # training clips, evenly spread


def name_motion(source: Path, folder: Path) -> dict[str, Any]:
    """Diagnose training clips with the model of their calmest frames at rest as `--nominal`."""
    train = clips_of(source, "train")
    few = [train[k] for k in np.linspace(0, len(train) - 1, CLIPS).round().astype(int)]
    join(source, few, folder / "clips")
    for run in ("nominal", "run"):
        ropefit("preprocess", folder / "clips", "--run", folder / run)
        ropefit("identify", "--run", folder / run)
    return ropefit(
        "diagnose", "--run", folder / "run", "--nominal", folder / "nominal",
        "--most-frames", FRAMES,
    )  # fmt: skip


def named_table(found: dict[str, dict[str, Any]]) -> str:
    rows = [
        "What `ropefit diagnose --nominal` accepts in training clips of the same cables, given a",
        f"model at rest that `ropefit identify` fitted to the calmest frames of {CLIPS} of them;",
        "written by `python -m benchmarks.real`.",
        "",
        "| rope | verdict | accepted | size (95 %) | equivalent to | log Bayes factor "
        "| held out before → after [mm] |",
        "|---" * 7 + "|",
    ]
    for rope, d in found.items():
        held = d["heldout"]
        change = f"{1e3 * held['rms_before_m']:.1f} → {1e3 * held['rms_after_m']:.1f}"
        if not d["effects"]:
            rows.append(f"| {rope} | {d['verdict']} | - | - | - | - | {change} |")
        for effect in d["effects"]:
            name, _, size, same, nats = cause_cells(effect)
            rows.append(
                f"| {rope} | {d['verdict']} | {name} | {size} | {same} | {nats} | {change} |"
            )
    said = "; ".join(f"{rope}: {refused(d)}" for rope, d in found.items())
    rows += ["", f"Refused: {said}."]
    return "\n".join(rows) + "\n"
