"""Measured ropes: identification, prediction and diagnosis of real recordings.

    python -m benchmarks.real [--real DIR] [--clips N] [--only PART] [--write docs/real.md]
                              [--keep DIR] [--json FILE]

DIR holds the real recordings (default: ../shared/real). Parts: motion (ropes in motion, fitted to N
of their training clips and scored on the clips that their authors score on), named (what the
diagnosis in motion names in them, and how it then predicts those clips), withheld (one cause at a
time withheld from them), cable (a cable that was changed), wire (is it straight at rest?),
softening (that cable with a law of bending; into docs/laws.md). Each part writes its own section of
the document. Models of ropes in motion in the folder of --keep are not fitted again, nor are its
finished cases of withheld causes diagnosed again.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import parser, publish
from benchmarks.real.motion import Score, prove
from benchmarks.real.named import name_motion, named_table
from benchmarks.real.shapes import cable_table, cables, estimate, wire, wire_table
from benchmarks.real.softening import predicted, softening_table
from benchmarks.real.withheld import withheld, withheld_table

ROPES = ("mocap_dlo1", "mocap_dlo2")
# Gravity as it is told falsely of each.
GRAVITY = {"mocap_dlo1": "gravity tilted by 3°", "mocap_dlo2": "gravity of 4.81 m/s²"}
# Mean absolute error [mm] of other predictions on the same eval clips, as published with them: the
# first shape held, the nearest training shape, a discrete elastic rod with a learned residual.
PUBLISHED = {"mocap_dlo1": (59.7, 20.5, 10.3), "mocap_dlo2": (48.0, 17.4, 10.2)}


def table(scores: dict[str, Score], clips: int) -> str:
    lines = [
        "Motion capture of two cables moved by two arms; each model starts from two true frames of",
        "an eval clip and predicts its 5 s open loop. Mean absolute error per coordinate [mm];",
        f"fitted by `ropefit identify --solver dynamics` to {clips} training clips; written by",
        "`python -m benchmarks.real`. The last three columns are published values, not run here.",
        "",
        "| rope | all markers | free markers | worst clip | second by second | marker by marker "
        "| shape held | nearest neighbour | elastic rod + learned residual |",
        "|---" * 9 + "|",
    ]
    for name, s in scores.items():
        published = " | ".join(f"{v:g}" for v in PUBLISHED[name])
        seconds = ", ".join(f"{1e3 * p.mean():.1f}" for p in np.array_split(s.by_time, 5))
        markers = ", ".join(f"{1e3 * v:.0f}" for v in s.by_marker)
        lines.append(
            f"| {name} | {1e3 * s.clip.mean():.1f} | {1e3 * s.free.mean():.1f} "
            f"| {1e3 * s.clip.max():.1f} | {seconds} | {markers} | {published} |"
        )
    # The ten points of the rest curve are in --json only.
    told = {
        name: {k: p for k, p in s.parameters.items() if "_at_" not in k}
        for name, s in scores.items()
    }
    heads = [f"{key} [{p['unit']}]" for key, p in next(iter(told.values())).items()]
    lines += [
        "",
        "Parameters with 95 % intervals; the rest curve's ten values are in `--json`:",
        "",
    ]
    lines += ["| rope | " + " | ".join(heads) + " |", "|---" * (1 + len(heads)) + "|"]
    for name, parameters in told.items():
        lines.append(f"| {name} | " + " | ".join(map(estimate, parameters.values())) + " |")
    return "\n".join(lines) + "\n"


def motion(real: Path, folder: Path, clips: int) -> tuple[str, dict[str, Any]]:
    """Return the table of ropes in motion, and its numbers."""
    scores = {name: prove(real / name, folder / name, clips) for name in ROPES}
    numbers = {
        name: {
            "clip_m": s.clip.tolist(), "free_m": s.free.tolist(), "by_time_m": s.by_time.tolist(),
            "by_marker_m": s.by_marker.tolist(), "parameters": s.parameters,
        }
        for name, s in scores.items()
    }  # fmt: skip
    return table(scores, clips), numbers


def named(real: Path, folder: Path, clips: int) -> tuple[str, dict[str, Any]]:
    """Return the table of the diagnosis in motion, and its numbers."""
    found = {name: name_motion(real / name, folder / name, clips) for name in ROPES}
    numbers = {
        name: one.answer | {"clip_before_m": one.before.clip.tolist(),
                            "clip_after_m": one.after.clip.tolist()}
        for name, one in found.items()
    }  # fmt: skip
    return named_table(found, clips), numbers


def causes(real: Path, folder: Path, clips: int) -> tuple[str, dict[str, Any]]:
    """Return the table of withheld causes, and what was answered."""
    found = {name: withheld(real / name, folder / name, GRAVITY[name]) for name in ROPES}
    return withheld_table(found), found


def cable(real: Path, folder: Path, clips: int) -> tuple[str, dict[str, Any]]:
    """Return the table of the changed cable, and its numbers."""
    found = cables(real, folder)
    return cable_table(found), {told: answer for told, (_, answer) in found.items()}


def wires(real: Path, folder: Path, clips: int) -> tuple[str, dict[str, Any]]:
    """Return the table of the wire, and its numbers."""
    found = wire(real, folder / "run")
    names = ("straight", "curved", "pose by pose")
    told = dict(zip(names, found, strict=True))
    return wire_table(*found), {
        name: {"by_frame_m": i.by_frame.tolist(), "parameters": i.parameters}
        for name, i in told.items()
    }


def softening(real: Path, folder: Path, clips: int) -> tuple[str, dict[str, Any]]:
    """Return the table of the cable with a law of bending, and its numbers."""
    found = predicted(real, folder)
    numbers = {name: {"known": p.known, "changed": p.changed} for name, p in found.items()}
    return softening_table(found), numbers


PARTS = {
    "motion": motion, "named": named, "withheld": causes, "cable": cable, "wire": wires,
    "softening": softening,
}  # fmt: skip


def main() -> None:
    arguments = parser(__doc__)
    root = Path(__file__).parents[2]
    arguments.add_argument("--real", type=Path, default=root.parent / "shared" / "real")
    arguments.add_argument("--clips", type=int, default=12, help="training clips for each rope")
    arguments.add_argument("--only", choices=PARTS, default=None, help="one part")
    arguments.add_argument("--keep", type=Path, default=None, help="folder of the runs")
    options = arguments.parse_args()
    if not options.real.is_dir():
        raise SystemExit(f"no real recordings at {options.real}; give --real DIR")
    every = {}
    for name in [options.only] if options.only else PARTS:
        with tempfile.TemporaryDirectory() as scratch:
            folder = (options.keep or Path(scratch)) / name
            text, every[name] = PARTS[name](options.real, folder, options.clips)
        publish(options, f"real-{name}", text, every)


if __name__ == "__main__":
    main()
