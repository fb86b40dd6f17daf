"""How far an exported rope comes to rest from the exact shape, in each simulator.

    python -m benchmarks.exporters [--setup] [--to TARGET ...] [--write docs/results.md]

--setup makes an environment a simulator under build/simulators (two of them cannot share one). The
exact shape is the planar elastica, solved as a boundary-value problem; a deviation is the largest
distance of a node from where it belongs, as a share of the rope's length.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import parser, publish
from benchmarks.elastica import describe
from ropefit.exporters import RopeDescription, export, exporters
from ropefit.exporters.layout import lay_out

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "build" / "simulators"
NEEDS = {
    "mujoco": ["mujoco-core>=4.0.1"],
    "mujoco3": ["mujoco==3.17.*"],
    "pyelastica": ["pyelastica==1.0.0"],
    "newton": ["newton==1.8.0", "usd-core", "newton-usd-schemas"],
}
RATIOS = (1e-4, 1e-3, 1e-2)  # EI / (rho g L^3)
NODES = 41


class NotInstalled(Exception):
    """The simulator's environment does not exist."""


def python_for(target: str) -> Path:
    """The interpreter that has the simulator. Raises NotInstalled."""
    own = FOLDER / target / "bin" / "python"
    if own.exists():
        return own
    if target == "mujoco":
        found = subprocess.run(
            [sys.executable, "-c", "import mujoco as m; assert m.__version__ >= '4.0.1'"],
            capture_output=True,
        )
        if found.returncode == 0:
            return Path(sys.executable)
    raise NotInstalled(f"{target}: not installed; python -m benchmarks.exporters --setup makes it")


def setup(target: str) -> None:
    """Make the environment of a simulator, unless it is there."""
    if not (FOLDER / target / "bin" / "python").exists():
        venv.create(FOLDER / target, with_pip=True)
    pip = [FOLDER / target / "bin" / "python", "-m", "pip", "install", "--quiet"]
    subprocess.run([*pip, *NEEDS[target]], check=True)


def settle(target: str, rope: RopeDescription, pose: int = 0, limit: float = 900) -> np.ndarray:
    """(K, 3) [m] the nodes at rest in the simulator; NaN at a clamped end's node."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"rope{exporters()[target].suffix}"
        out = Path(folder) / "shape.csv"
        path.write_text(export(rope, target).text)
        if target.startswith("mujoco"):
            runner = ROOT / "benchmarks" / "settle_mujoco.py"
            command = [python_for(target), runner, path, out, pose]
        else:
            command = [python_for(target), path, "--pose", pose, "--out", out]
        run = subprocess.run(
            [str(part) for part in command], capture_output=True, text=True, timeout=limit
        )
        if run.returncode:
            raise RuntimeError(f"{target}: {run.stderr.strip()[-2000:]}")
        vertices = np.loadtxt(out, delimiter=",", skiprows=1)
    layout = lay_out(rope)
    nodes = np.full((rope.segments + 1, 3), np.nan)
    nodes[layout.node[layout.node >= 0]] = vertices[layout.node >= 0]
    return nodes


def deviation(target: str, rope: RopeDescription) -> float:
    """Largest distance of a node at rest from rope.x, as a share of the length."""
    away = np.linalg.norm(settle(target, rope) - rope.x[0], axis=1)
    return float(np.nanmax(away)) / rope.length


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--setup", action="store_true", help="make the environments first")
    options.add_argument("--to", nargs="*", default=list(NEEDS), choices=list(NEEDS))
    given = options.parse_args()
    data: dict[str, Any] = {}
    cases = [(ends, ratio) for ends in ("pinned", "clamped") for ratio in RATIOS]
    head = " | ".join(f"{ends} {ratio:g}" for ends, ratio in cases)
    lines = [f"| exported to | {head} |", "|---" * (len(cases) + 1) + "|"]
    for target in given.to:
        if given.setup:
            setup(target)
        cells = []
        for ends, ratio in cases:
            started = time.monotonic()
            try:
                value: Any = deviation(target, describe(ends, ratio, NODES))
                cells.append(f"{value:.3%}")
            except (NotInstalled, RuntimeError, subprocess.TimeoutExpired) as error:
                value = str(error)
                cells.append("-")
                print(error, file=sys.stderr)
            data[f"{target} {ends} {ratio:g}"] = value
            took = time.monotonic() - started
            print(f"{target} {ends} {ratio:g}: {cells[-1]} in {took:.0f} s", file=sys.stderr)
        lines.append(f"| `{target}` | " + " | ".join(cells) + " |")
    text = (
        f"Largest distance of a node from the exact elastica, in rope lengths, {NODES} nodes; "
        "pinned at both ends or clamped and free, by EI/(ρgL³).\n\n" + "\n".join(lines) + "\n"
    )
    publish(given, "exporters", text, data)


if __name__ == "__main__":
    main()
