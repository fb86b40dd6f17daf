"""Noise along the rope, clouds over tables, and pictures that contradict the recording."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ropefit.errors import BadInput
from ropefit.perception.background import foreground
from ropefit.perception.cloud import trace_cloud
from ropefit.perception.noise import measure
from ropefit.perception.trace import Trace
from ropefit.recordings import open_recording
from tests.conftest import SAMPLES
from tests.factories import edit, image_recording
from tests.ropecloud import cloud, nearest, shapes
from tests.test_perception_samples import observe

LINE, CURVE = shapes()["s-curve"]


def noisy(white: float, shared: float, length: float) -> list[Trace]:
    """Frames of a rope of one metre with noise of two kinds [m]."""
    rng = np.random.default_rng(0)
    out = []
    for _ in range(6):
        index = np.sort(rng.integers(0, len(LINE), 300))
        place = LINE[index]
        covariance = np.exp(-abs(place[:, None] - place) / length) + 1e-9 * np.eye(300)
        common = np.linalg.cholesky(covariance) @ rng.normal(size=(300, 3))
        points = CURVE[index] + white * rng.normal(size=(300, 3)) + shared * common
        out.append(Trace(points, place, CURVE, LINE, 1.0, 0.01))
    return out


@pytest.mark.parametrize("length", [0.01, 0.02, 0.05])
def test_white_and_shared_noise(length: float) -> None:
    found = measure(noisy(1e-3, 0.7e-3, length))
    assert found is not None
    assert np.nanmedian(found.white) == pytest.approx(1e-3, rel=0.1)
    assert 0.4e-3 < found.correlated < 1.1e-3
    assert length / 3 < found.length < 3 * length


def test_no_shared_noise_where_there_is_none() -> None:
    found = measure(noisy(1e-3, 0.0, 0.02))
    assert found is not None
    assert found.correlated < 0.25e-3
    assert np.nanmedian(found.white) == pytest.approx(1e-3, rel=0.05)
    assert measure([Trace(CURVE[:5], LINE[:5], CURVE, LINE, 1.0, 0.01)]) is None


def test_a_table_and_outliers() -> None:
    rng = np.random.default_rng(0)
    points, _ = cloud(LINE, CURVE, 1400, rng)
    points[:70] += 0.05 * rng.normal(size=(70, 3))
    table = np.column_stack([rng.uniform(-0.3, 1.3, (4000, 2)), np.full(4000, -0.4)])
    table[:, 2] += 0.002 * rng.normal(size=4000)
    everything = rng.permutation(np.concatenate([points, table]))
    trace = trace_cloud(everything, CURVE[[0, -1]], 1.0)
    away, _ = nearest(CURVE, trace.centreline)
    assert np.median(away) < 1e-3
    assert np.percentile(away, 95) < 2.5e-3
    kept = foreground(points, CURVE[[0, -1]], 1.0)  # a rope in a plane is no table
    assert len(kept) > 1380


@pytest.mark.parametrize(("scale", "times"), [("0.01", "10 times too large"), ("0.000001", "1000")])
def test_wrong_depth_scale_is_named(tmp_path: Path, scale: str, times: str) -> None:
    where = tmp_path / "r"
    where.mkdir()
    for path in (SAMPLES / "rgbd").iterdir():
        if path.is_file():
            (where / path.name).write_bytes(path.read_bytes())
    for name in ("color", "depth"):
        (where / name).mkdir()
        for path in sorted((SAMPLES / "rgbd" / name).iterdir())[:2]:
            (where / name / path.name).write_bytes(path.read_bytes())
    edit(where / "recording.toml", "depth_scale = 0.001", f"depth_scale = {scale}")
    with pytest.raises(BadInput, match=f"depth_scale is wrong, about {times}"):
        observe(where, tmp_path / "run")


def test_wrong_sizes_are_named(tmp_path: Path) -> None:
    where = image_recording(tmp_path / "r")
    for path in (where / "color").iterdir():
        image = cv2.imread(str(path))
        cv2.imwrite(str(path), cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE))
    with pytest.raises(BadInput, match="rotated"):
        open_recording(where).source.sight(0)
    where = image_recording(tmp_path / "q")
    edit(where / "recording.toml", "cx = 12", "cx = 23")
    with pytest.raises(BadInput, match="intrinsics of another resolution"):
        open_recording(where)
