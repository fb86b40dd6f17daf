"""Control-point estimation by all nine losses on the cloud sample (the paper's comparison).

    python -m benchmarks.accuracy.losses [--write docs/results.md] [--recording DIR] [--json FILE]

Runs the command line itself: preprocess, `identify --solver thomas --loss OBJ1`, then `control`
once a loss; and once more with the Jacobi solver for the comparison of rope lengths.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import ropefit
from benchmarks.document import parser, publish
from ropefit.recordings import sample_path

LOSSES = [f"OBJ{i}" for i in range(1, 10)]
MEANING = {
    "OBJ1": "3D point to line",
    "OBJ2": "2D point to line",
    "OBJ3": "2D point to line + lowest",
    "OBJ4": "3D segment to particle",
    "OBJ5": "2D segment to particle",
    "OBJ6": "2D segment to particle + lowest",
    "OBJ7": "3D segment to line",
    "OBJ8": "2D segment to line",
    "OBJ9": "2D segment to line + lowest",
}


def measure(recording: Path) -> dict[str, Any]:
    """All numbers of the tables."""
    out: dict[str, Any] = {"recording": recording.name, "losses": {}, "solvers": {}}
    with tempfile.TemporaryDirectory() as folder:
        for solver in ("jacobi", "thomas"):
            run = Path(folder) / solver
            ropefit("preprocess", recording, "--run", run)
            found = ropefit("identify", "--run", run, "--solver", solver, "--loss", "OBJ1")
            control = ropefit("control", "--run", run, "--loss", "OBJ1")
            out["solvers"][solver] = {
                "rms_fit_m": found["rms_fit_m"],
                "rms_heldout_m": found["rms_heldout_m"],
                "length_error": found["length_error"],
                "drift": found["drift"],
                "converged": found["groups"]["group_0"]["converged"],
                **_deviation(control),
            }
        for loss in LOSSES:
            out["losses"][loss] = _deviation(ropefit("control", "--run", run, "--loss", loss))
    return out


def _deviation(control: dict[str, Any]) -> dict[str, Any]:
    metres = np.array(control["deviation_m"], dtype=float)
    pixels = np.array(control["deviation_px"], dtype=float)
    return {
        "frames": len(metres),
        "searches_converged": int(np.sum(control["converged"])),
        "deviation_median_m": float(np.median(metres)),
        "deviation_mean_m": float(metres.mean()),
        "deviation_max_m": float(metres.max()),
        "deviation_mean_px": float(pixels.mean()),
        "obj1_mean_m": float(np.mean(control["obj1_m"])),
        "control_length_error": float(np.mean(np.abs(control["length_error"]))),
    }


def tables(data: dict[str, Any]) -> str:
    """Markdown."""
    lines = [
        f"Recording `{data['recording']}`; written by `python -m benchmarks.accuracy.losses`.",
        "",
        "Control point estimated by each loss (Thomas, weights identified by OBJ1). *OBJ1* is the",
        "mean over frames of the 3D point-to-line sum of the resulting rope, as in the paper.",
        "",
        "| loss | meaning | median [mm] | mean [mm] | max [mm] | [px] | OBJ1 [m] | converged |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for loss, row in data["losses"].items():
        lines.append(
            f"| {loss} | {MEANING[loss]} | {row['deviation_median_m'] * 1e3:.2f} "
            f"| {row['deviation_mean_m'] * 1e3:.2f} | {row['deviation_max_m'] * 1e3:.2f} "
            f"| {row['deviation_mean_px']:.2f} | {row['obj1_mean_m']:.3f} "
            f"| {row['searches_converged']}/{row['frames']} |"
        )
    lines += [
        "",
        "The two solvers, each with its own identified weights; *drift* is how far particles move",
        "when the solver iterates twice as long, over the rope's length.",
        "",
        "| solver | rms fit [mm] | rms held out [mm] | length error | drift | control point [mm] |",
        "|---|---|---|---|---|---|",
    ]
    for solver, row in data["solvers"].items():
        lines.append(
            f"| {solver} | {row['rms_fit_m'] * 1e3:.2f} | {row['rms_heldout_m'] * 1e3:.2f} "
            f"| {row['length_error']:.3%} | {row['drift']:.2%} "
            f"| {row['deviation_mean_m'] * 1e3:.2f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the tables; write them where asked."""
    arguments = parser(__doc__)
    arguments.add_argument("--recording", type=Path, default=None)
    options = arguments.parse_args()
    data = measure(options.recording or sample_path("cloud"))
    text = tables(data)
    publish(options, "losses", text, data)


if __name__ == "__main__":
    main()
