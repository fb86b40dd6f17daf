"""How far an exported rope comes to rest from the exact shape, in each simulator.

    python -m benchmarks.accuracy.exporters [--setup] [--to TARGET ...] [--known FILE] [--json FILE]
                                   [--write docs/results.md]

--setup makes an environment a simulator under build/simulators (two of them cannot share one). The
exact shape is the planar elastica, solved as a boundary-value problem; a deviation is the largest
distance of a node from where it belongs, as a share of the rope's length.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
import venv
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import parser, publish
from reference_simulators.as_ropefit import describe
from ropefit.errors import StageFailed
from ropefit.exporters import RopeDescription, export, exporter, resimulate

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "build" / "simulators"
TARGETS = ("mujoco", "mujoco3", "pyelastica", "newton")
MORE = {"newton": ["usd-core", "newton-usd-schemas"]}  # to read the curves beside the script
RATIOS = (1e-4, 1e-3, 1e-2)  # EI / (rho g L^3)
NODES = 41


class NotInstalled(Exception):
    """The simulator's environment does not exist."""


@cache
def python_for(target: str) -> Path:
    """Return the interpreter that has the simulator. Raises NotInstalled."""
    for python in (FOLDER / target / "bin" / "python", Path(sys.executable)):
        try:
            if python.exists():
                resimulate.version(target, python)
                return python
        except StageFailed:
            continue
    raise NotInstalled(
        f"{target}: not installed; python -m benchmarks.accuracy.exporters --setup makes it"
    )


def setup(target: str) -> None:
    """Make the environment of a simulator, unless it is there."""
    if not (FOLDER / target / "bin" / "python").exists():
        venv.create(FOLDER / target, with_pip=True)
    pip = [FOLDER / target / "bin" / "python", "-m", "pip", "install", "--quiet"]
    packages = [resimulate.simulator_of(target).package, *MORE.get(target, [])]
    subprocess.run([*pip, *packages], check=True)


def settle(target: str, rope: RopeDescription, pose: int = 0, limit: float = 900) -> np.ndarray:
    """Return the nodes (K, 3) [m] at rest in the simulator; NaN at a clamped end's node."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"rope{exporter(target).suffix}"
        path.write_text(export(rope, target).text)
        return resimulate.settle(rope, target, path, pose, python_for(target), limit)


def deviation(target: str, rope: RopeDescription, limit: float = 900) -> float:
    """Return the largest distance of a node at rest from rope.x, as a share of the length."""
    away = np.linalg.norm(settle(target, rope, limit=limit) - rope.x[0], axis=1)
    return float(np.nanmax(away)) / rope.length


def measure(target: str, ends: str, ratio: float, limit: float) -> Any:
    """Return the deviation, or in words why there is none."""
    started = time.monotonic()
    try:
        told: Any = deviation(target, describe(ends, ratio, NODES), limit)
    except (NotInstalled, resimulate.NotSettled) as error:
        told = str(error)
    took = time.monotonic() - started
    print(f"{target} {ends} {ratio:g}: {told} in {took:.0f} s", file=sys.stderr, flush=True)
    return told


def table(data: dict[str, Any]) -> str:
    """Return deviations {"target ends ratio": share or why there is none} in Markdown."""
    cases = [f"{ends} {ratio:g}" for ends in ("pinned", "clamped") for ratio in RATIOS]
    lines = [
        f"Largest distance of a node from the exact elastica, in rope lengths, {NODES} nodes; "
        "pinned at both ends or clamped and free, by EI/(ρgL³). Written by "
        "`python -m benchmarks.accuracy.exporters`.",
        "",
        "| exported to | " + " | ".join(cases) + " |",
        "|---" * (len(cases) + 1) + "|",
    ]
    reasons = []
    for target in TARGETS:
        cells = []
        for case in cases:
            value = data.get(f"{target} {case}", "not run")
            cells.append("-" if isinstance(value, str) else f"{value:.3%}")
            if isinstance(value, str):
                reasons.append(f"`{target}`, {case}: {value}")
        lines.append(f"| `{target}` | " + " | ".join(cells) + " |")
    if reasons:
        lines += ["", "Not measured: " + "; ".join(reasons) + "."]
    return "\n".join(lines) + "\n"


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--setup", action="store_true", help="make the environments first")
    options.add_argument("--to", nargs="*", default=list(TARGETS), choices=list(TARGETS))
    options.add_argument("--known", type=Path, help="numbers of an earlier --json, kept")
    options.add_argument("--limit", type=float, default=900.0, help="s for a simulator to settle")
    given = options.parse_args()
    data = json.loads(given.known.read_text()) if given.known else {}
    for target in given.to:
        if given.setup:
            setup(target)
        for ends in ("pinned", "clamped"):
            for ratio in RATIOS:
                data[f"{target} {ends} {ratio:g}"] = measure(target, ends, ratio, given.limit)
    publish(given, "exporters", table(data), data)


if __name__ == "__main__":
    main()
