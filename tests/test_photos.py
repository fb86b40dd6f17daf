"""Two photographs of wires against the points that a person clicked along them, without tuning."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from ropefit.artifacts import Observations
from ropefit.stages.report import write_report
from tests.ropecloud import nearest
from tests.test_perception_samples import observe

MANIFEST = """format = "ropefit-recording/1"
name = "{name}"
gravity = [0.0, 9.81, 0.0]
[rope]
length = 1.5
[rgbd]
color = "{{frame}}.jpg"
intrinsics = {{ width = 3000, height = 4000, fx = 3000.0, fy = 3000.0, cx = 1500.0, cy = 2000.0 }}
"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory):
    """Observations of a photograph as a colour-only recording, computed once."""
    kept: dict[str, tuple[Observations, Path]] = {}

    def get(photos: Path, name: str) -> tuple[Observations, Path]:
        if name not in kept:
            where = tmp_path_factory.mktemp(name)
            (where / "recording").mkdir()
            shutil.copy(photos / f"{name}.jpg", where / "recording" / "0.jpg")
            (where / "recording" / "recording.toml").write_text(MANIFEST.format(name=name))
            kept[name] = observe(where / "recording", where / "run"), where / "run"
        return kept[name]

    return get


@pytest.mark.parametrize("name", ["black0", "white0"])
def test_centreline_of_a_photograph(real: Path, seen, name: str) -> None:
    photos = real / "photos"
    if not photos.is_dir():
        pytest.skip(f"the photographs are not at {photos}")
    o, run = seen(photos, name)
    clicked = np.loadtxt(photos / f"{name}_centreline.csv", delimiter=",", skiprows=1)
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(clicked, axis=0), axis=1))])
    # Chords between the clicked points cut bends by up to 6 px: only the points are the truth.
    away, _ = nearest(o.pixels, clicked)
    assert 0.3 < np.median(away) <= 3.0
    assert np.percentile(away, 95) <= 10.0
    ends = o.pixels[[0, -1]]
    forward = np.linalg.norm(ends - clicked[[0, -1]], axis=1)
    backward = np.linalg.norm(ends[::-1] - clicked[[0, -1]], axis=1)
    assert min(forward.max(), backward.max()) <= 40.0
    # Nothing but the wire: neither fixture nor wrinkles.
    dense = np.column_stack(
        [np.interp(np.linspace(0, arc[-1], 4000), arc, column) for column in clicked.T]
    )
    off, _ = nearest(dense, o.pixels)
    assert np.percentile(off, 95) <= 12.0
    assert off.max() < 40.0
    assert not o.depth_measured
    assert o.length == pytest.approx(1.5, rel=0.02)
    page = write_report(run, lambda text: None).read_text()
    assert "data:image/jpeg;base64," in page
    assert "taken for the rope" in page
