"""The same numbers again: twice, with one thread and two, from single and double precision."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from ropefit.artifacts import Artifact, Control, Model, Observations, read
from ropefit.artifacts.store import leaves
from tests.conftest import SAMPLES, Command
from tests.factories import edit

STAGES = (
    ["preprocess", "recording"],
    ["identify", "--most-frames", "16"],
    ["control"],
)


def computed(folder: Path, threads: int) -> dict[str, Artifact]:
    """The artifacts of a run of its own."""
    command = Command(folder)
    run = f"run-{threads}-{len(list(folder.iterdir()))}"
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    with pytest.MonkeyPatch.context() as patch:
        for name in names:
            patch.setitem(os.environ, name, str(threads))
        for stage in STAGES:
            command(*stage, "--run", run, "--quiet")
    kinds = (Observations, Model, Control)
    return {kind.file_name: read(folder / run / kind.file_name, kind)[0] for kind in kinds}


def differences(first: dict[str, Artifact], second: dict[str, Artifact]) -> list[str]:
    """Texts that differ, arrays that differ by more than 1e-12 of their largest entry."""
    out = []
    for name in first:
        pairs = zip(leaves(first[name]), leaves(second[name]), strict=True)
        for (path, a, _), (other, b, _) in pairs:
            assert path == other
            if isinstance(a, str) and a != b and not path.startswith("provenance"):
                out.append(f"{name}: {path}: {a[:80]}, {b[:80]}")
            if isinstance(a, np.ndarray) and not np.allclose(
                a, b, rtol=0, atol=1e-12 * max(np.nanmax(np.abs(a), initial=0), 1), equal_nan=True
            ):
                out.append(f"{name}: {path} by {np.nanmax(np.abs(a - b)):.3g}")
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("same")
    shutil.copytree(SAMPLES / "markers", base / "recording")
    return base


@pytest.fixture(scope="module")
def once(folder: Path) -> dict[str, Artifact]:
    return computed(folder, 1)


def test_one_thread_and_two(folder: Path, once: dict[str, Artifact]) -> None:
    assert differences(once, computed(folder, 2)) == []


def test_twice(folder: Path, once: dict[str, Artifact]) -> None:
    again = computed(folder, 1)
    for name, artifact in once.items():
        for (path, a, _), (_, b, _) in zip(leaves(artifact), leaves(again[name]), strict=True):
            if path not in ("provenance/created", "provenance/seconds", "provenance/inputs"):
                np.testing.assert_array_equal(a, b, err_msg=f"{name}: {path}")


def test_single_precision_is_accepted(tmp_path: Path) -> None:
    found = {}
    for kind in (np.float32, np.float64):
        base = tmp_path / kind.__name__
        shutil.copytree(SAMPLES / "markers", base / "recording")
        where = base / "recording"
        rows = np.loadtxt(where / "markers.csv", delimiter=",", skiprows=1)
        frames, markers = int(rows[:, 0].max()) + 1, int(rows[:, 2].max()) + 1
        positions = rows[:, 3:].reshape(frames, markers, 3).astype(np.float32).astype(kind)
        time = rows[::markers, 1].astype(np.float32).astype(kind)
        np.savez(where / "markers.npz", positions=positions, time=time)
        edit(where / "recording.toml", "markers.csv", "markers.npz")
        Command(base)("preprocess", "recording", "--quiet")
        found[kind] = read(base / "run" / "observations.h5", Observations)[0]
    single, double = found.values()
    assert single.points.dtype == np.float64
    for name in ("points", "centreline", "time", "noise", "point_arc"):
        np.testing.assert_array_equal(getattr(single, name), getattr(double, name))
