"""preprocess on the three sample recordings, against their known shapes. Bounds on both sides:
noise that is in the data must be in the observations too."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from ropefit.adapters.settings import PreprocessSettings
from ropefit.api.pipeline import PREPROCESS
from ropefit.artifacts import Observations
from ropefit.errors import BadInput
from ropefit.perception.camera import Camera
from ropefit.perception.tracing import Tracer
from ropefit.recordings import fingerprint, open_recording
from ropefit.recordings.clouds import read_cloud
from ropefit.runs.execute import execute
from ropefit.runs.protocol import Context
from tests.conftest import SAMPLES
from tests.factories import FRAMES, cloud_recording, edit, marker_recording
from tests.ropecloud import nearest

FINE = np.linspace(0, 1, 4001)  # arc length [m]


def observe(where: Path, directory: Path, **settings) -> Observations:
    """What preprocess makes of a recording."""
    recording = open_recording(where)
    context = Context(external={"recording": recording})
    external = {"recording": fingerprint(recording)}
    chosen = PreprocessSettings(**settings)
    return execute(PREPROCESS, directory, chosen, context, external).artifact


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory):
    """Observations of a sample, computed once."""
    kept: dict[str, Observations] = {}

    def get(name: str) -> Observations:
        if name not in kept:
            kept[name] = observe(SAMPLES / name, tmp_path_factory.mktemp(name))
        return kept[name]

    return get


def truth(name: str) -> np.ndarray:
    """(frames, 4001, 3) [m] true centrelines at FINE."""
    with np.load(SAMPLES / name / "truth.npz") as file:
        return CubicSpline(file["arc_length"], file["nodes"], axis=1)(FINE)


def in_plane(o: Observations, t: int, points: np.ndarray) -> np.ndarray:
    """(N, 3) points as frame t's observations show them: projected, or as they are."""
    if not o.projected:
        return points
    offset = (points - o.plane_origin[t]) @ o.plane_normal[t]
    return points - offset[:, None] * o.plane_normal[t]


def rows(start: np.ndarray, t: int) -> slice:
    return slice(start[t], start[t + 1])


@pytest.mark.parametrize(
    ("name", "median", "most", "arc_median", "arc_most"),
    [
        ("cloud", 0.4e-3, 3e-3, 1e-3, 3e-3),
        ("rgbd", 1.0e-3, 2e-3, 1e-3, 3e-3),
        ("markers", 0.7e-3, 2.5e-3, 1e-3, 2e-3),
    ],
)
def test_centreline_and_arc_length(
    sample, name: str, median: float, most: float, arc_median: float, arc_most: float
) -> None:
    o = sample(name)
    curves = truth(name)
    assert not o.dropped
    assert len(o.frames) == len(curves)
    assert (np.isfinite(o.centreline).all(axis=2).mean(axis=1) > 0.8).all()
    for t, frame in enumerate(o.frames):
        curve = in_plane(o, t, curves[frame])
        known = np.isfinite(o.centreline[t]).all(axis=1)
        away, index = nearest(curve, o.centreline[t][known])
        assert 2e-5 < np.median(away) < median
        assert away.max() < most
        assert abs(FINE[index] - o.node_arc[known]).max() < 1e-2
        points = rows(o.point_start, t)
        error = o.point_arc[points] - FINE[nearest(curve, o.points[points])[1]]
        assert np.median(abs(error)) < arc_median
        assert abs(error).max() < arc_most
        assert o.point_arc[points].min() >= 0
        assert o.point_arc[points].max() <= 1 + 1e-9
        lowest = curve[np.argmin(curve[:, 2])]
        assert abs(o.lowest[t, 2] - lowest[2]) < 3e-3


@pytest.mark.parametrize("name", ["cloud", "rgbd", "markers"])
def test_end_0_is_the_control_point(sample, name: str) -> None:
    o = sample(name)
    ends = truth(name)[o.frames][:, [0, -1]]
    away = np.linalg.norm(o.end_position - ends, axis=2)
    assert 1e-5 < np.median(away) < 5e-4  # 0.15 mm per axis
    assert away.max() < 1e-3
    for t in range(len(o.frames)):
        points = o.points[rows(o.point_start, t)]
        toward = np.linalg.norm(points - ends[t, 0], axis=1)
        assert np.argmin(toward) < 0.1 * len(points)  # the first of them are the nearest
        assert o.point_arc[o.point_start[t]] < 0.101  # gripper, or the first marker seen
    clamped = name == "markers"
    assert o.end_kind == (("clamped",) * 2 if clamped else ("pinned",) * 2)
    assert np.isfinite(o.end_orientation).all() == clamped
    assert not o.ends_assumed


def test_cloud_hidden_stretches_are_unseen(sample) -> None:
    o = sample("cloud")
    hidden = 0
    for t, frame in enumerate(o.frames):
        raw = read_cloud(SAMPLES / "cloud" / "clouds" / f"{frame:06d}.ply")
        away, index = nearest(truth("cloud")[frame], raw)
        at = FINE[index[away < 0.008]]
        for k, (a, b) in enumerate(zip(o.node_arc[:-1], o.node_arc[1:], strict=True)):
            if not ((at > a - 0.003) & (at < b + 0.003)).any():
                assert not o.seen[t, k]
                hidden += 1
            if ((at > a + 0.003) & (at < b - 0.003)).sum() > 15:
                assert o.seen[t, k]
        assert np.isnan(o.centreline[t, 0]).all()  # the gripper hides it
    assert hidden >= 5
    assert 0.9 < o.visibility.mean() < 0.99


def test_noise_is_what_the_points_scatter(sample) -> None:
    for name in ("cloud", "rgbd"):
        o = sample(name)
        curves = truth(name)
        for t, frame in enumerate(o.frames):
            points = rows(o.point_start, t)
            normal = o.point_offset[points, None] * o.plane_normal[t]
            away, _ = nearest(curves[frame], o.points[points] + normal)
            real = np.median(away) / 1.1774
            # In rgbd what all points of a stretch share (pixels, shading) is not noise about it.
            assert (0.9 if name == "cloud" else 0.2) * real < o.noise[t] < 1.15 * real
    assert 0.0015 < np.median(sample("cloud").noise) < 0.0025  # 1 mm and the rope's own width
    assert 3e-4 < sample("markers").noise[0] < 8e-4  # 0.3 mm, bounded from above
    assert "upper bound" in sample("markers").noise_source


def test_projection_keeps_what_it_removes(sample, tmp_path: Path) -> None:
    flat = sample("cloud")
    solid = observe(SAMPLES / "cloud", tmp_path, project="no")
    assert flat.projected
    assert not solid.projected
    owner = np.repeat(np.arange(len(flat.frames)), np.diff(flat.point_start))
    normal, origin = flat.plane_normal[owner], flat.plane_origin[owner]
    back = flat.points + flat.point_offset[:, None] * normal
    np.testing.assert_allclose(back, solid.points, atol=1e-12)
    np.testing.assert_allclose(((flat.points - origin) * normal).sum(axis=1), 0, atol=1e-12)
    np.testing.assert_allclose(flat.point_offset, solid.point_offset, atol=1e-12)
    assert 3e-4 < np.std(flat.point_offset) < 3e-3
    np.testing.assert_allclose(flat.plane_normal @ flat.gravity, 0, atol=1e-9)
    chord = flat.end_position[:, 1] - flat.end_position[:, 0]
    np.testing.assert_allclose((chord * flat.plane_normal).sum(axis=1), 0, atol=1e-12)


def test_rgbd_pixels_lie_on_the_rope(sample) -> None:
    o = sample("rgbd")
    camera = Camera(**vars(o.view))
    assert not camera.virtual
    assert (o.visibility > 0.9).all()
    for t, frame in enumerate(o.frames):
        image = camera.project(truth("rgbd")[frame])
        pixels = rows(o.pixel_start, t)
        away, index = nearest(image, o.pixels[pixels])
        assert 0.02 < np.median(away) < 0.5
        assert away.max() < 3  # no background, post or gripper
        assert abs(o.pixel_arc[pixels] - FINE[index]).max() < 8e-3
        known = np.isfinite(o.centreline_px[t]).all(axis=1)
        assert nearest(image, o.centreline_px[t][known])[0].max() < 1.5
        # From end to end, but for the gripper.
        assert o.pixel_arc[pixels].min() < 0.08
        assert o.pixel_arc[pixels].max() > 0.98


def test_markers_stay_in_3d(sample) -> None:
    o = sample("markers")
    assert not o.projected
    assert "hide shape" in o.projection_reason
    recording = open_recording(SAMPLES / "markers")
    missing = 0
    for t, frame in enumerate(o.frames):
        sight = recording.source.sight(int(frame))
        assert sight.points is not None
        assert sight.arc_length is not None
        there = np.isfinite(sight.points).all(axis=1)
        np.testing.assert_allclose(o.points[rows(o.point_start, t)], sight.points[there])
        np.testing.assert_allclose(o.point_arc[rows(o.point_start, t)], sight.arc_length[there])
        missing += int((~there).sum())
    assert 3 <= missing <= 25  # about 2 % of 520


def test_marker_arcs_estimated(tmp_path: Path) -> None:
    where = tmp_path / "recording"
    shutil.copytree(SAMPLES / "markers", where)
    toml = (where / "recording.toml").read_text().splitlines()
    told = next(line for line in toml if line.startswith("arc_length"))
    arc = np.array([float(x) for x in told.split("[")[1].rstrip("]").split(",")])
    (where / "recording.toml").write_text(
        "\n".join(line for line in toml if not line.startswith(("arc_length", "length"))) + "\n"
    )
    tracer = Tracer(open_recording(where))
    assert tracer.total == pytest.approx(1.0, abs=0.01)
    assert 1e-6 < abs(tracer.arc - arc).max() < 0.01
    (where / "recording.toml").write_text(
        "\n".join(line for line in toml if not line.startswith("arc_length")) + "\n"
    )
    tracer = Tracer(open_recording(where))
    assert tracer.total == 1.0
    assert 1e-6 < abs(tracer.arc - arc).max() < 0.005


def test_coinciding_markers_are_told(tmp_path: Path) -> None:
    where = marker_recording(tmp_path / "r")
    lines = (where / "markers.csv").read_text().splitlines()
    points = {(row.split(",")[0], row.split(",")[2]): row.split(",")[3:] for row in lines[1:]}
    same = [
        ",".join([*row.split(",")[:3], *points[row.split(",")[0], "4"]])
        if row.split(",")[2] == "5"
        else row
        for row in lines[1:]
    ]
    (where / "markers.csv").write_text("\n".join([lines[0], *same, ""]))
    with pytest.raises(BadInput, match="coincide"):
        Tracer(open_recording(where))


def test_without_ends_they_are_assumed(tmp_path: Path) -> None:
    where = cloud_recording(tmp_path / "r", rope="")
    with_ends = observe(where, tmp_path / "a")
    edit(where / "recording.toml", '[ends]\nfile = "ends.csv"\n', "")
    o = observe(where, tmp_path / "b")
    assert o.ends_assumed
    assert o.end_kind == ("pinned", "pinned")
    assert len(o.frames) == FRAMES
    assert o.length == pytest.approx(with_ends.length, rel=0.01)
    near = np.linalg.norm(o.end_position - with_ends.end_position, axis=2).max()
    swapped = np.linalg.norm(o.end_position[:, ::-1] - with_ends.end_position, axis=2).max()
    assert min(near, swapped) < 0.01  # the same order in every frame
