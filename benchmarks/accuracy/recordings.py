"""The paper's method, defaults only, on the samples and on real recordings.

    python -m benchmarks.accuracy.recordings [--real DIR] [--write docs/paper.md] [--json FILE]

DIR holds the real recordings (default: ../shared/real); without it the samples alone are run.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import ropefit
from benchmarks.document import parser, publish
from ropefit.recordings import sample_path

SAMPLES = ("cloud", "rgbd", "markers")
REAL = ("cable_black_unweighted", "wire_black", "mocap_dlo1/eval_054")


def measure(recording: Path, solver: str) -> dict[str, Any]:
    """Run `ropefit run` once: return the numbers of a row."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        found = ropefit("run", recording, "--run", Path(folder) / "run", "--solver", solver)
        seconds = time.perf_counter() - start
    fit, control = found["identify"], found["control"]
    group = fit["groups"]["group_0"]
    verdicts = [p["verdict"] for p in group["parameters"].values()]
    return {
        "frames": found["preprocess"]["frames"],
        "noise_m": found["preprocess"]["noise_m"],
        "rms_fit_m": fit["rms_fit_m"],
        "rms_heldout_m": fit["rms_heldout_m"],
        "drift": fit["drift"],
        "search_converged": group["converged"],
        "determined": verdicts.count("determined"),
        "deviation_median_m": float(np.median(np.array(control["deviation_m"], dtype=float))),
        "control_converged": int(np.sum(control["converged"])),
        "seconds": seconds,
    }


def main() -> None:
    """Print the table; write it where asked."""
    arguments = parser(__doc__)
    root = Path(__file__).parents[2]
    arguments.add_argument("--real", type=Path, default=root.parent / "shared" / "real")
    options = arguments.parse_args()
    recordings = {f"sample {name}": sample_path(name) for name in SAMPLES}
    if options.real.is_dir():
        recordings |= {name: options.real / name for name in REAL}
    else:
        print(f"no real recordings at {options.real}: samples only")
    lines = [
        "`ropefit run` with default settings; written by",
        "`python -m benchmarks.accuracy.recordings`. *Drift*: how far particles move, over the",
        "length, when the solver iterates twice as long: none of these states is an equilibrium.",
        "",
        "| recording | solver | frames | noise [mm] | rms fit [mm] | held out [mm] | drift "
        "| determined | control point, median [mm] | searches converged | time [s] |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    data = {}
    for name, path in recordings.items():
        for solver in ("thomas", "jacobi"):
            m = data[f"{name} {solver}"] = measure(path, solver)
            held = "-" if m["rms_heldout_m"] is None else f"{m['rms_heldout_m'] * 1e3:.2f}"
            fitted = "" if m["search_converged"] else " (not converged)"
            lines.append(
                f"| {name} | {solver} | {m['frames']} | {m['noise_m'] * 1e3:.2g} "
                f"| {m['rms_fit_m'] * 1e3:.2f}{fitted} | {held} | {m['drift']:.2%} "
                f"| {m['determined']}/6 | {m['deviation_median_m'] * 1e3:.2f} "
                f"| {m['control_converged']}/{m['frames']} | {m['seconds']:.0f} |"
            )
            print(lines[-1], flush=True)
    text = "\n".join(lines) + "\n"
    publish(options, "recordings", text, data)


if __name__ == "__main__":
    main()
