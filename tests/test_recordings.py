"""Readers on valid recordings, and what they make of the ends, the clock and the hash."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ropefit.errors import BadInput
from ropefit.recordings import fingerprint, open_recording, sample_path
from ropefit.recordings.clouds import read_cloud
from ropefit.recordings.ends import quaternion_along
from ropefit.recordings.patterns import list_frames
from ropefit.rod.quaternion import director
from tests.conftest import ROOT, SAMPLES
from tests.factories import (
    FRAMES,
    cloud_recording,
    edit,
    image_recording,
    marker_recording,
    rope_points,
    write_manifest,
)


def third_director(quaternion: np.ndarray) -> np.ndarray:
    """(3,) R(q) e3."""
    w, x, y, z = quaternion
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z])


def npz_recording(directory: Path, **arrays: np.ndarray) -> Path:
    """A recording of markers in an npz file."""
    directory.mkdir()
    write_manifest(directory, '[markers]\nfile = "m.npz"', ends="")
    np.savez(directory / "m.npz", **arrays)
    return directory


def test_markers_csv_with_gaps(tmp_path: Path) -> None:
    where = marker_recording(tmp_path / "r", ends="markers = [[0], []]")
    rows = (where / "markers.csv").read_text().splitlines()
    kept = [row for row in rows[1:] if not row.startswith("1,") and not row.startswith("2,1.0,4,")]
    moved = [f"107{row[1:]}" if row[0] == "2" else row for row in kept]
    (where / "markers.csv").write_text("\n".join([rows[0], *reversed(moved), ""]))
    recording = open_recording(where)
    assert recording.frames == [0, 107]
    assert recording.source.time == {0: 0.0, 107: 1.0}
    sight = recording.source.sight(107)
    assert sight.ordered
    assert sight.points is not None
    assert np.isnan(sight.points[4]).all()
    np.testing.assert_allclose(
        np.delete(sight.points, 4, 0), np.delete(rope_points(2, 9), 4, 0), atol=1e-6
    )


def test_markers_npz(tmp_path: Path) -> None:
    positions = np.stack([rope_points(frame, 5) for frame in range(FRAMES)])
    positions[1, 2] = np.nan
    arc = np.array([0.0, 0.2, 0.5, 0.8, 1.0])
    where = npz_recording(
        tmp_path / "r", positions=positions, time=np.arange(3), arc_length=arc, other=np.ones(2)
    )
    recording = open_recording(where)
    assert recording.frames == [0, 1, 2]
    assert recording.ends is None
    np.testing.assert_array_equal(recording.source.sight(1).points, positions[1])
    np.testing.assert_array_equal(recording.source.sight(1).arc_length, arc)
    edit(where / "recording.toml", '"m.npz"', '"m.npz"\narc_length = [0, 0.1, 0.2, 0.3, 0.4]')
    told = open_recording(where).source.sight(0).arc_length
    np.testing.assert_allclose(told, [0, 0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("colours", [False, True])
@pytest.mark.parametrize("count", [1, 500])
@pytest.mark.parametrize("kind", ["ascii.ply", "binary.ply", "ascii.pcd", "binary.pcd", "lzf.pcd"])
def test_clouds_that_open3d_wrote(tmp_path: Path, kind: str, count: int, colours: bool) -> None:
    import open3d as o3d

    points = np.random.default_rng(1).normal(size=(count, 3)).round(3)
    points[count // 2 :] = 0.125  # repetitions, so that LZF has something to refer to
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if colours:
        cloud.colors = o3d.utility.Vector3dVector(np.full((count, 3), 0.5))
        cloud.normals = o3d.utility.Vector3dVector(np.full((count, 3), 0.5))
    path = tmp_path / kind
    ascii_, packed = kind.startswith("ascii"), kind.startswith("lzf")
    written = o3d.io.write_point_cloud(str(path), cloud, write_ascii=ascii_, compressed=packed)
    assert written
    np.testing.assert_allclose(read_cloud(path), points, atol=1e-6)


def test_other_valid_clouds(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(
        b"ply\r\nformat binary_big_endian 1.0\r\ncomment x\r\nelement camera 2\r\n"
        b"property uchar a\r\n"
        b"element vertex 2\r\nproperty short id\r\nproperty float z\r\nproperty float y\r\n"
        b"property double x\r\nelement face 1\r\nproperty list uchar int i\r\nend_header\r\nab"
        + np.array([(1, 3, 2, 1), (2, np.nan, 2, 1)], ">i2,>f4,>f4,>f8").tobytes()
        + b"rest"
    )
    np.testing.assert_array_equal(read_cloud(path), [[1, 2, 3]])
    path = tmp_path / "a.pcd"
    path.write_text(
        "# x\nVERSION .7\nFIELDS rgb _ x y z\nSIZE 4 1 4 4 4\nTYPE F U F F F\nCOUNT 1 3 1 1 1\n"
        "WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n9 0 0 0 1 2 3\n9 0 0 0 nan nan nan\n"
    )
    np.testing.assert_array_equal(read_cloud(path), [[1, 2, 3]])


def test_images_that_opencv_wrote(tmp_path: Path) -> None:
    import cv2

    recording = open_recording(image_recording(tmp_path / "r"))
    assert recording.frames == [0, 1, 2]
    for frame in recording.frames:
        sight = recording.source.sight(frame)
        color = cv2.imread(str(tmp_path / f"r/color/{frame}.png"))
        depth = cv2.imread(str(tmp_path / f"r/depth/{frame}.png"), cv2.IMREAD_UNCHANGED)
        assert color is not None
        assert depth is not None
        np.testing.assert_array_equal(sight.color, color[..., ::-1])
        np.testing.assert_allclose(sight.depth, depth * 0.001)


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("{frame}.ply", ["0.ply", "12.ply", "012.ply"]),
        ("a{frame:04d}b.ply", ["a0000b.ply", "a0012b.ply", "a12b.ply", "xa0001b.ply"]),
        ("in/{frame:02d}.ply", ["in/00.ply", "in/12.ply"]),
    ],
)
def test_patterns(tmp_path: Path, pattern: str, names: list[str]) -> None:
    (tmp_path / "in").mkdir()
    for name in names:
        (tmp_path / name).touch()
    assert list(list_frames(tmp_path, pattern, "key")) == [0, 12]


@pytest.mark.parametrize(
    "pattern",
    [
        *("", "a", "{frame}{frame}", "{frame}/{frame}", "{frame}/a", "{frame}/b/c", "{frame:x}"),
        *(
            "{{frame}}",
            "{frame:099999999d}",
            "{frame!r}",
            "{frame.real}",
            "\0{frame}",
            "../{frame}",
        ),
        "a}{frame}",
    ],
)
def test_patterns_that_are_none(tmp_path: Path, pattern: str) -> None:
    (tmp_path / "a}0").touch()
    (tmp_path / "0").touch()
    with pytest.raises(BadInput):
        list_frames(tmp_path, pattern, "key")


def test_free_and_pinned_ends(tmp_path: Path) -> None:
    where = cloud_recording(tmp_path / "r")
    lines = (where / "ends.csv").read_text().splitlines()
    (where / "ends.csv").write_text("\n".join([line for line in lines if ",1,0.7" not in line]))
    recording = open_recording(where)
    assert recording.ends is not None
    assert [end.kind for end in recording.ends] == ["pinned", "free"]
    np.testing.assert_array_equal(recording.ends[0].position[2], [0, 0, 0])
    assert not recording.ends[0].orientation
    # Clouds have no clock of their own.
    assert recording.source.time == {0: 0.0, 1: 0.5, 2: 1.0}


def test_clamped_and_pinned_ends(tmp_path: Path) -> None:
    where = cloud_recording(tmp_path / "r")
    rows = ["frame,time,end,x,y,z,qw,qx,qy,qz"]
    for frame in range(FRAMES):
        rows += [f"{frame},{frame},0,0,0,0,0.6,0,0.8,0", f"{frame},{frame},1,0.7,0,0,,,,"]
    (where / "ends.csv").write_text("\n".join(rows))
    ends = open_recording(where).ends
    assert ends is not None
    assert [end.kind for end in ends] == ["clamped", "pinned"]
    np.testing.assert_allclose(third_director(ends[0].orientation[1]), [0.96, 0, -0.28], atol=1e-12)


def test_without_a_clock_there_are_no_times(tmp_path: Path) -> None:
    where = image_recording(tmp_path / "r")
    edit(where / "recording.toml", '[ends]\nfile = "ends.csv"\n', "")
    recording = open_recording(where)
    assert recording.ends is None
    assert recording.times(recording.frames) is None


def test_held_markers_clamp_along_the_rope(tmp_path: Path) -> None:
    where = marker_recording(tmp_path / "r", ends="markers = [[0, 1], [-2, -1]]")
    ends = open_recording(where).ends
    assert ends is not None
    for frame in range(FRAMES):
        points = rope_points(frame, 9)
        for end, outer, first in ((ends[0], 0, 0), (ends[1], 8, 7)):
            assert end.kind == "clamped"
            np.testing.assert_allclose(end.position[frame], points[outer], atol=1e-6)
            along = points[first + 1] - points[first]  # from end 0 to end 1, at both ends
            tangent = third_director(end.orientation[frame])
            np.testing.assert_allclose(tangent, along / np.linalg.norm(along), atol=1e-4)


def test_marker_held_but_unseen_has_no_pose(tmp_path: Path) -> None:
    where = marker_recording(tmp_path / "r", ends="markers = [[0, 1], []]")
    rows = (where / "markers.csv").read_text().splitlines()
    (where / "markers.csv").write_text("\n".join(r for r in rows if not r.startswith("1,0.5,1,")))
    ends = open_recording(where).ends
    assert ends is not None
    assert sorted(ends[0].position) == [0, 2]
    assert ends[1].kind == "free"


@given(st.tuples(*[st.floats(-1e3, 1e3)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-6))
@settings(max_examples=100, derandomize=True, deadline=None)
def test_quaternion_along(direction: tuple[float, float, float]) -> None:
    tangent = np.array(direction)
    quaternion = quaternion_along(tangent)
    assert np.linalg.norm(quaternion) == pytest.approx(1)
    want = tangent / np.linalg.norm(tangent)
    np.testing.assert_allclose(third_director(quaternion), want, atol=1e-6)


def test_quaternion_along_the_axes() -> None:
    for tangent in np.vstack([np.eye(3), -np.eye(3), [[1e-9, 0, -1]]]):
        quaternion = quaternion_along(tangent)
        np.testing.assert_allclose(third_director(quaternion), tangent, atol=1e-8)
        agreed = director(quaternion[None])[0]
        np.testing.assert_allclose(agreed, tangent, atol=1e-8)


@pytest.mark.parametrize("make", [cloud_recording, marker_recording, image_recording])
def test_fingerprint_follows_every_file(tmp_path: Path, make) -> None:
    where = make(tmp_path / "r")
    recording = open_recording(where)
    seen = {fingerprint(recording)}
    files = [path for path in sorted(where.rglob("*")) if path.is_file()]
    assert set(files) == set(recording.files)
    for path in files:
        with path.open("ab") as file:
            file.write(b"\n")
        seen.add(fingerprint(open_recording(where)))
    assert len(seen) == len(files) + 1
    (where / "notes.txt").write_text("not part of the recording")
    shutil.copytree(where, tmp_path / "copy")
    assert fingerprint(open_recording(tmp_path / "copy")) in seen


@pytest.mark.parametrize("name", ["cloud", "rgbd", "markers"])
def test_samples(name: str) -> None:
    assert sample_path(name) == SAMPLES / name
    recording = open_recording(sample_path(name))
    assert recording.name == f"sample-{name}"
    assert len(recording.frames) >= 8
    sight = recording.source.sight(recording.frames[0])
    assert sight.points is not None or sight.depth is not None


@pytest.mark.parametrize(
    ("name", "markers"),
    [
        *(("wire_black", 51), ("cable_black_unweighted", 3), ("cable_black_weighted", 3)),
        *(("mocap_dlo1/eval_054", 13), ("mocap_dlo2", 12)),
    ],
)
def test_real_recordings(real: Path, name: str, markers: int) -> None:
    where = real / name
    if not (where / "recording.toml").exists():
        where = next(path.parent for path in sorted(where.glob("*/recording.toml")))
    recording = open_recording(where)
    points = recording.source.sight(recording.frames[0]).points
    assert points is not None
    assert points.shape == (markers, 3)
    assert recording.ends is not None
    assert len(fingerprint(recording)) == 64


def test_a_signalling_nan_is_a_missing_point() -> None:
    path = ROOT / "benchmarks" / "robustness" / "fuzz" / "found" / "warning-signalling-nan.pcd"
    with warnings.catch_warnings(action="error"):
        points = read_cloud(path)
    assert points.shape[1] == 3
