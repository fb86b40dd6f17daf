"""An exported rope, let come to rest by the simulator it was written for.

Simulators run in a Python of their own, which need not be ours: two of them cannot share one.
"""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from ropefit.errors import StageFailed, WrongUsage
from ropefit.exporters import exporter
from ropefit.exporters.base import Simulator
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.layout import lay_out

LONGEST = 900.0  # s, for one pose


class NotSettled(StageFailed):
    """The simulator ran and brought no shape."""


def simulator_of(target: str) -> Simulator:
    """Return where texts for `target` run. Raises WrongUsage where nothing runs them."""
    simulator = exporter(target).simulator
    if simulator is None:
        raise WrongUsage(
            f"--check: {target} names no simulator that could run it (Exporter.simulator); leave "
            "--check out"
        )
    return simulator


def version(target: str, python: Path) -> str:
    """Name and version of the simulator that `python` has. Raises StageFailed, WrongUsage."""
    s = simulator_of(target)
    name = re.split("[=<>]", s.package)[0]
    code = (
        f"import importlib.metadata as d, json, {s.module} as m; "
        f"print(json.dumps(getattr(m, '__version__', '') or d.version({name!r})))"
    )
    try:
        run = subprocess.run(
            [str(python), "-c", code], capture_output=True, text=True, timeout=120, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        raise StageFailed(f"--python {python}: is no Python that runs")
    remedy = f"pip install '{s.package}' there, or give the Python that has it: --python PATH"
    if run.returncode:
        raise StageFailed(f"--check: {python} has no {s.module} for {target}; {remedy}")
    found = str(json.loads(run.stdout.splitlines()[-1]))
    digits = tuple(int(part) for part in found.split(".")[:3] if part.isdigit())
    if not s.least <= digits < s.below:
        raise StageFailed(f"--check: {python} has {s.module} {found}, not for {target}; {remedy}")
    return f"{s.module} {found}"


def settle(
    rope: RopeDescription, target: str, text: Path, pose: int, python: Path, limit: float = LONGEST
) -> np.ndarray:
    """Return (K, 3) [m] the nodes at rest, from a pose of the exported text; NaN at a clamped end's
    node.

    Raises NotSettled with what the simulator said.
    """
    runner = simulator_of(target).runner
    command = [str(python), str(text.resolve())]
    if runner:
        command.insert(1, str(Path(__file__).parent / "runners" / runner))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "shape.csv"
        command += ["--pose", str(pose), "--out", str(out)]
        try:
            run = subprocess.run(
                command, capture_output=True, text=True, timeout=limit, cwd=folder, check=False
            )
        except subprocess.TimeoutExpired:
            raise NotSettled(f"not at rest after {limit:g} s of computing")
        if run.returncode or not out.exists():
            raise NotSettled((run.stderr.strip().splitlines() or ["it said nothing"])[-1])
        vertices = np.loadtxt(out, delimiter=",", skiprows=1)
    layout = lay_out(rope)
    nodes = np.full((rope.segments + 1, 3), np.nan)
    nodes[layout.node[layout.node >= 0]] = vertices[layout.node >= 0]
    return nodes
