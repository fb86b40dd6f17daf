"""Motions without ceremony, and recordings that are no motion, through processes of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.factories import rope_points
from tests.test_bad_input import DATA, in_a_process, one_line

MANIFEST = (
    'format = "ropefit-recording/1"\nname = "{name}"\ngravity = [0, 0, -9.81]\n'
    '[rope]\nlength = {length}\n[markers]\nfile = "markers.npz"\n[ends]\nmarkers = [[0], [-1]]\n'
)


def recorded(
    folder: Path, frames: int = 30, sway: float = 0.0, span: float = 0.7, length: float = 1.1
) -> Path:
    """Markers of an arc that is moved as a whole by `sway` m in a second."""
    folder.mkdir(parents=True)
    time = 0.02 * np.arange(frames)
    lines = np.stack([rope_points(3, 9) for _ in time]) * [span / 0.7, 1, 1]
    lines += np.sin(3 * time)[:, None, None] * [0, sway, 0]
    arc = np.linspace(0, length, 9)
    np.savez(folder / "markers.npz", positions=lines, time=time, arc_length=arc)
    (folder / "recording.toml").write_text(MANIFEST.format(name=folder.name, length=length))
    return folder


def preprocessed(folder: Path, **given: Any) -> str:
    run = str(folder.with_name(f"run-{folder.name}"))
    recording = recorded(folder, **given)
    assert in_a_process("preprocess", recording, "--run", run, "--quiet")[0] == 0
    return run


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sway": 0.0}, ("no motion", "--solver equilibrium")),
        ({"sway": 0.2, "frames": 12}, ("20 frames", "--solver equilibrium")),
    ],
    ids=["still", "short"],
)
def test_no_motion_is_said(tmp_path, given, words):
    run = preprocessed(tmp_path / "clip", **given)
    one_line(in_a_process("identify", "--solver", "dynamics", "--run", run), DATA, *words)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"span": 0.6}, ("ends of simulation and recording", "recorded motion")),
        ({"frames": 24}, ("24 frames", "every frame")),
        ({"length": 1.2}, ("1.2 m long", "1.1 m", "same length")),
    ],
    ids=["ends", "frames", "length"],
)
def test_a_simulation_of_another_motion_is_refused(tmp_path, given, words):
    real = preprocessed(tmp_path / "real", sway=0.05)
    other = preprocessed(tmp_path / "other", **{"sway": 0.05, **given})
    result = in_a_process("diagnose", "--run", real, "--simulation", other, "--quiet")
    one_line(result, DATA, *words)
