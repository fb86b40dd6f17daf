"""C3D motion capture, read by ezc3d in a process of its own.

ezc3d is compiled code that trusts what it reads: a damaged file may end the process. So it runs in
another one, which leaves its arrays in a file without pickles.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import ClassVar

import numpy as np

from ropefit.errors import BadInput, StageFailed
from ropefit.importers.base import Entry, Importer, Options, exists, readable
from ropefit.importers.draft import Draft
from ropefit.importers.markers import MarkerOptions, deliver

MAX_BYTES = 2 << 30
MEMORY, GROWTH = 2 << 30, 8  # bytes of addresses for the reader; more for each of the file's
PATIENCE = 5.0  # s, besides what the size of the file needs; a damaged one never ends
SPEED = 1e6  # bytes/s, slower than any machine reads
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "dm": 0.1, "in": 0.0254}
MISSING = 7  # exit code of the other process where ezc3d is not installed

READ = """
import sys
try:
    import resource
    most = int(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    # Should ropefit be killed meanwhile, this process ends by itself.
    soon = int(sys.argv[4])
    resource.setrlimit(resource.RLIMIT_CPU, (soon, soon))
except (ImportError, ValueError):
    pass
try:
    import ezc3d
except ImportError:
    sys.exit(7)  # MISSING
import numpy as np
file = ezc3d.c3d(sys.argv[1])
point = file["parameters"]["POINT"]
np.savez(
    sys.argv[2],
    points=np.asarray(file["data"]["points"], dtype=float),
    names=np.array([str(name) for name in point["LABELS"]["value"]], dtype=str),
    rate=np.asarray(point["RATE"]["value"], dtype=float),
    units=np.array([str(unit) for unit in point["UNITS"]["value"]], dtype=str),
)
"""


class C3d(Importer):
    """Points of a C3D file. Its units are used; a point that was not seen is NaN."""

    format: ClassVar[str] = "c3d"
    options: ClassVar[type[Options]] = MarkerOptions

    def contents(self, source: Path) -> list[Entry]:
        names, _, positions, _ = _read(source)
        seen = np.isfinite(positions).all(axis=2).sum(axis=0)
        return [Entry(n, "marker", int(c)) for n, c in zip(names, seen, strict=True)]

    def read(self, source: Path, options: MarkerOptions, draft: Draft) -> None:
        names, rate, positions, unit = _read(source)
        rate = options.rate or rate
        if not (np.isfinite(rate) and rate > 0):
            raise BadInput(f"{source}: has no frame rate; give --set rate=...")
        if options.scale is None and unit not in UNITS:
            raise BadInput(f"{source}: unit {unit!r}; give --set scale=... in metres per unit")
        time = np.arange(len(positions)) / rate
        deliver(source, options, draft, names, time, positions, UNITS.get(unit, 1.0))


def _read(source: Path) -> tuple[list[str], float, np.ndarray, str]:
    """Return names, frames a second, positions (F, M, 3) in the file's unit, and that unit."""
    exists(source)
    if not source.is_file() or source.stat().st_size > MAX_BYTES:
        raise BadInput(f"{source}: not a file of at most 2 GiB")
    limit = PATIENCE + source.stat().st_size / SPEED
    with readable(source, "C3D"), source.open("rb") as file:
        if file.read(2)[1:] != b"P":  # the format's mark is its second byte
            raise BadInput(f"{source}: not a C3D file")
    with tempfile.TemporaryDirectory() as folder, readable(source, "C3D"):
        out = Path(folder) / "points.npz"
        most = str(MEMORY + GROWTH * source.stat().st_size)
        soon = str(int(limit) + 1)
        command = [sys.executable, "-c", READ, str(source.resolve()), str(out), most, soon]
        alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each thread takes addresses
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=limit, env=alone)
        except subprocess.TimeoutExpired:
            raise BadInput(f"{source}: not readable as C3D (no answer after {limit:.0f} s)")
        if done.returncode == MISSING:
            raise StageFailed("C3D files need ezc3d; run pip install 'ropefit[c3d]'")
        if done.returncode or not out.exists():
            why = (done.stderr.strip().splitlines() or ["the reader crashed"])[-1]
            raise BadInput(f"{source}: not readable as C3D ({why[:200]})")
        with np.load(out, allow_pickle=False) as arrays:
            points, names, rate, units = (arrays[k] for k in ("points", "names", "rate", "units"))
    if points.ndim != 3 or points.shape[0] < 3 or points.shape[1] < 1 or points.shape[2] < 1:
        raise BadInput(f"{source}: holds no points")
    count = points.shape[1]
    labels = [str(name).strip() for name in names[:count]]
    if len(labels) < count or len(set(labels)) < count or "" in labels:
        labels = [str(index) for index in range(count)]  # names that are missing or not unique
    unit = str(units[0]).strip().lower() if len(units) else ""
    positions = np.moveaxis(points[:3], 0, 2).swapaxes(0, 1).astype(float)
    return labels, float(rate[0]) if rate.size else float("nan"), positions, unit
