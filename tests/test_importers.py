"""What other formats hold arrives in the recording; the files are those of the formats' writers."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from ropefit.cli.parsing import named_texts
from ropefit.errors import BadInput, StageFailed, WrongUsage
from ropefit.importers import About, importers
from ropefit.recordings import Recording, open_recording
from ropefit.stages.importing import import_recording, list_source
from tests import sources
from tests.conftest import SAMPLES
from tests.factories import rope_points


def brought(source: Path, format: str, about: About | None = None, **given: str) -> Recording:
    """The recording that an import makes beside its source."""
    out = source.parent / "imported"
    import_recording(source, format, out, given, about or About("imported"))
    return open_recording(out)


def axis_of(quaternion: np.ndarray) -> np.ndarray:
    """R(q) e3."""
    w, x, y, z = quaternion
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


BAGS = [(1, ""), (2, "sqlite3"), (2, "mcap")]


@pytest.mark.parametrize(("version", "storage"), BAGS)
def test_clouds_of_a_bag(version: int, storage: str, tmp_path: Path) -> None:
    path = sources.bag(tmp_path / ("b.bag" if version == 1 else "b"), version, storage)
    recording = brought(
        path, "ros", clouds="/points", frame="world", end0="tf:gripper", end1="/far", axis1="+x"
    )
    assert recording.frames == [0, 1, 2, 3]
    for frame in recording.frames:
        points = recording.source.sight(frame).points
        np.testing.assert_allclose(points, sources.cloud_points(frame), atol=1e-6)
        time = recording.source.time[frame]
        assert time == pytest.approx(100 + 0.1 * frame)
    assert recording.ends is not None
    assert [end.kind for end in recording.ends] == ["pinned", "clamped"]
    for frame in recording.frames:
        line = rope_points(frame, 50)
        np.testing.assert_allclose(recording.ends[0].position[frame], line[0], atol=1e-6)
        np.testing.assert_allclose(recording.ends[1].position[frame], line[-1], atol=1e-6)
    np.testing.assert_allclose(axis_of(recording.ends[1].orientation[0]), [1, 0, 0], atol=1e-9)
    assert recording.manifest.clouds is not None
    np.testing.assert_allclose(recording.manifest.clouds.viewpoint, sources.CAMERA[0])


@pytest.mark.parametrize("axis", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_axis_of_a_gripper(axis: str, tmp_path: Path) -> None:
    path = sources.bag(tmp_path / "b.bag", 1)
    recording = brought(path, "ros", clouds="/points", frame="world", end0="/far", axis0=axis)
    assert recording.ends is not None
    expected = np.eye(3)["xyz".index(axis[1])] * (1 if axis[0] == "+" else -1)
    np.testing.assert_allclose(axis_of(recording.ends[0].orientation[0]), expected, atol=1e-9)


@pytest.mark.parametrize(("version", "storage"), BAGS)
def test_images_of_a_bag(version: int, storage: str, tmp_path: Path) -> None:
    path = sources.bag(tmp_path / ("b.bag" if version == 1 else "b"), version, storage)
    recording = brought(path, "ros", color="/color", depth="/depth", info="/info", frame="world")
    assert recording.manifest.rgbd is not None
    assert recording.manifest.rgbd.intrinsics.fx == sources.FOCAL
    pose = np.array(recording.manifest.rgbd.camera_pose)
    np.testing.assert_allclose(pose[:3, 3], sources.CAMERA[0])
    np.testing.assert_allclose(pose[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-9)
    for frame in recording.frames:
        sight = recording.source.sight(frame)
        color, depth = sources.rendered(frame)
        np.testing.assert_array_equal(sight.color, color)
        np.testing.assert_allclose(sight.depth, depth, atol=0.0006)


def test_depth_in_metres(tmp_path: Path) -> None:
    path = sources.bag(tmp_path / "b", 2)
    recording = brought(path, "ros", color="/color", depth="/depth_metres", info="/info")
    depth = recording.source.sight(2).depth
    np.testing.assert_allclose(depth, sources.rendered(2)[1], atol=0.0002)


def test_one_file_of_a_ros2_bag(tmp_path: Path) -> None:
    for storage, suffix in (("mcap", "mcap"), ("sqlite3", "db3")):
        folder = sources.bag(tmp_path / storage, 2, storage)
        path = next(folder.glob(f"*.{suffix}"))
        assert len(brought(path, "ros", clouds="/points", every="2").frames) == 2


def test_what_a_bag_holds_is_told(tmp_path: Path) -> None:
    path = sources.bag(tmp_path / "b.bag", 1)
    listed = {entry["name"]: entry for entry in list_source(path, "ros")["contents"]}
    assert listed["/points"] == {
        "name": "/points",
        "kind": "sensor_msgs/msg/PointCloud2",
        "count": 4,
    }
    assert listed["tf:gripper"] == {"name": "tf:gripper", "kind": "tf frame in world", "count": 4}
    assert "root" in listed["tf:world"]["kind"]
    for given in ({}, {"clouds": "/pionts"}, {"clouds": "/color"}, {"color": "/color"}):
        with pytest.raises(WrongUsage, match="PointCloud2") as told:
            brought(path, "ros", **given)
        assert "/points" in str(told.value) or "clouds=/color" in str(told.value)
    with pytest.raises(WrongUsage, match="camera, gripper, world"):
        brought(path, "ros", clouds="/points", frame="map")
    with pytest.raises(WrongUsage, match="need --set frame"):
        brought(path, "ros", clouds="/points", end0="tf:gripper")


def test_poses_between_samples() -> None:
    from ropefit.importers.numbers import pose_at

    half = np.sqrt(0.5)
    times, places = np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [1.0, 0, 0]])
    turns = np.array([[1.0, 0, 0, 0], [-half, 0, 0, -half]])  # a quarter turn, the long way round
    found = pose_at(times, places, turns, 0.5, 1.0)
    assert found is not None
    np.testing.assert_allclose(found[0], [0.5, 0, 0])
    np.testing.assert_allclose(found[1], [np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)])
    assert pose_at(times, places, turns, 2.0, 0.5) is None
    assert pose_at(times, places, turns, 1.3, 0.5) is not None


def test_chains_of_transforms() -> None:
    from ropefit.importers.tf import Transforms

    quarter = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # about z
    tree = Transforms()
    tree.add("world", "base", 0.0, (np.array([1.0, 0, 0]), quarter), True)
    tree.add("base", "tool", 0.0, (np.array([1.0, 0, 0]), np.array([1.0, 0, 0, 0])), False)
    found = tree.find("tool", "world", 0.0, 0.1)
    assert found is not None
    np.testing.assert_allclose(found[0], [1, 1, 0], atol=1e-12)
    back = tree.find("world", "tool", 0.0, 0.1)
    assert back is not None
    np.testing.assert_allclose(back[0], [-1, 1, 0], atol=1e-12)
    assert tree.find("tool", "world", 5.0, 0.1) is None
    with pytest.raises(WrongUsage, match="joins"):
        tree.find("tool", "elsewhere", 0.0, 0.1)
    tree.add("tool", "world", 0.0, (np.zeros(3), quarter), True)
    with pytest.raises(BadInput, match="circle"):
        tree.find("tool", "base", 0.0, 0.1)


def test_tum(tmp_path: Path) -> None:
    recording = brought(sources.tum(tmp_path / "tum"), "tum", intrinsics="200,200,80,60")
    sight = recording.source.sight(3)
    color, depth = sources.rendered(3)
    np.testing.assert_array_equal(sight.color, color)
    np.testing.assert_allclose(sight.depth, depth, atol=0.0002)
    assert recording.manifest.rgbd is not None
    pose = np.array(recording.manifest.rgbd.camera_pose)
    np.testing.assert_allclose(pose[:3, 3], sources.CAMERA[0], atol=1e-6)
    np.testing.assert_allclose(pose[:3, 2], [0, 1, 0], atol=1e-5)


def test_a_moving_camera_is_refused(tmp_path: Path) -> None:
    folder = sources.tum(tmp_path / "tum")
    truth = folder / "groundtruth.txt"
    truth.write_text(truth.read_text() + "2.0 0.5 0 0 0 0 0 1\n")
    with pytest.raises(BadInput, match="camera moves by"):
        brought(folder, "tum", intrinsics="200,200,80,60")


@pytest.mark.parametrize("scale", ["0.000001", "0.1"])
def test_a_wrong_depth_scale_is_told(scale: str, tmp_path: Path) -> None:
    source = sources.tum(tmp_path / "tum")
    with pytest.raises(BadInput, match=r"depth_scale=.*0\.0002"):
        brought(source, "tum", intrinsics="200,200,80,60", depth_scale=scale)
    assert not (tmp_path / "imported").exists()


@pytest.mark.parametrize("name", ["../rgb/x.png", "/etc/hostname", "a\0b"])
def test_names_outside_the_source_are_refused(name: str, tmp_path: Path) -> None:
    folder = sources.tum(tmp_path / "tum")
    (folder / "rgb.txt").write_text(f"1305031102.1 {name}\n")
    with pytest.raises(BadInput):
        brought(folder, "tum", intrinsics="200,200,80,60")


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_c3d(unit: str, tmp_path: Path) -> None:
    source = sources.c3d(tmp_path / "a.c3d", unit)
    recording = brought(source, "c3d", held0="B0,B1", held1="B6")
    assert recording.ends is not None
    assert [end.kind for end in recording.ends] == ["clamped", "pinned"]
    assert recording.source.time[2] == pytest.approx(2 / 50)
    for frame in recording.frames:
        points = recording.source.sight(frame).points
        expected = rope_points(frame, 7)
        if frame == 1:
            expected[2] = np.nan
        np.testing.assert_allclose(points, expected, atol=1e-6)


def test_csv_with_a_column_an_axis(tmp_path: Path) -> None:
    source = sources.wide_csv(tmp_path / "a.csv")
    order = "head,second,mid,tail"
    recording = brought(source, "mocap", markers=order, held0="head", held1="tail")
    points = recording.source.sight(2).points
    expected = rope_points(2, 4)
    expected[2] = np.nan
    np.testing.assert_allclose(points, expected, atol=1e-6)
    assert recording.source.time[3] == pytest.approx(0.06)


def test_other_motion_capture(tmp_path: Path) -> None:
    long, npz = tmp_path / "long.csv", tmp_path / "a.npz"
    rows = [
        f"{frame};{m};" + ";".join(str(v) for v in point)
        for frame in range(3)
        for m, point in enumerate(rope_points(frame, 4))
    ]
    long.write_text("\n".join(["frame;marker;x;y;z", *rows]))
    positions = np.stack([rope_points(frame, 4) for frame in range(3)])
    np.savez(npz, positions=1000 * positions, time=np.arange(3) / 10)
    first = brought(long, "mocap", rate="10")
    np.testing.assert_allclose(first.source.sight(1).points, positions[1])
    (tmp_path / "imported").rename(tmp_path / "first")
    second = brought(npz, "mocap", scale="0.001")
    np.testing.assert_allclose(second.source.sight(1).points, positions[1])
    assert second.source.time == first.source.time


@pytest.mark.parametrize("format", ["clouds", "mocap"])
def test_millimetres_are_told(format: str, tmp_path: Path) -> None:
    make = sources.cloud_folder if format == "clouds" else sources.wide_csv
    source = make(tmp_path / "source", 1000.0)
    with pytest.raises(BadInput, match=r"--set scale=0\.001 would fit"):
        brought(source, format)
    assert len(brought(source, format, scale="0.001").frames) == 4


def test_cloud_folder(tmp_path: Path) -> None:
    source = sources.cloud_folder(tmp_path / "scans")
    recording = brought(source, "clouds", viewpoint="0.3,-1.2,0")
    for frame in recording.frames:  # scan_9 comes before scan_10
        points = recording.source.sight(frame).points
        np.testing.assert_allclose(points, sources.cloud_points(frame), atol=1e-6)


def test_what_the_user_knows_arrives(tmp_path: Path) -> None:
    about = About('a "rope"\n', (0.0, -9.81, 0.0), 1.1, 0.007, 0.04)
    recording = brought(sources.wide_csv(tmp_path / "a.csv"), "mocap", about)
    assert recording.name == 'a "rope"\n'
    assert recording.manifest.rope.model_dump(exclude_none=True) == {
        "length": 1.1,
        "diameter": 0.007,
        "mass": 0.04,
    }
    np.testing.assert_array_equal(recording.gravity, [0, -9.81, 0])


def test_all_or_nothing(tmp_path: Path) -> None:
    source = sources.wide_csv(tmp_path / "a.csv")
    with pytest.raises(BadInput, match="rope"):
        brought(source, "mocap", About("short", length=-1.0))
    with pytest.raises(WrongUsage, match="no marker 'nobody'"):
        brought(source, "mocap", markers="nobody,tail")
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
    (tmp_path / "imported").mkdir()
    (tmp_path / "imported" / "mine").write_text("")
    with pytest.raises(StageFailed, match="exists already"):
        brought(source, "mocap")


def test_too_many_frames_are_not_taken_unasked(tmp_path: Path) -> None:
    source = sources.wide_csv(tmp_path / "a.csv")
    with pytest.raises(WrongUsage, match="every=2"):
        brought(source, "mocap", most_frames="2")
    assert len(brought(source, "mocap", most_frames="2", every="2").frames) == 2


@pytest.mark.parametrize(("items", "words"), [(["clouds"], "NAME=VALUE"), (["=a"], "NAME=VALUE")])
def test_settings_that_are_none(items: list[str], words: str) -> None:
    with pytest.raises(WrongUsage, match=words):
        named_texts(items)


def test_unknown_names(tmp_path: Path) -> None:
    source = sources.wide_csv(tmp_path / "a.csv")
    with pytest.raises(WrongUsage, match="clouds, kinect, lerobot, mocap, realsense, ros, tum"):
        brought(source, "vicon")
    with pytest.raises(WrongUsage, match=r"has no such option; one of .*held0"):
        brought(source, "mocap", topic="/points")
    for format in importers():
        with pytest.raises(BadInput, match="no such file"):
            brought(tmp_path / "missing", format)


def test_command_line(ropefit, tmp_path: Path) -> None:
    """From the packaged sample's clouds to observations."""
    clouds = SAMPLES / "cloud" / "clouds"
    assert "*.ply" in ropefit("import", clouds, "--from", "clouds", "--list").stdout
    told = ropefit.json(
        "import", clouds, "--from", "clouds", "--out", "rec", "--length", 1.0, "--set",
        "viewpoint=0.1,-1.35,0.5", "--set", "every=6",
    )  # fmt: skip
    assert told["frames"] == 6
    assert ropefit.json("preprocess", "rec", "--nodes", 8)["frames"] >= 5
    for arguments, code in (
        (["--from", "clouds"], 2),
        (["--from", "nothing", "--out", "x"], 2),
        (["--from", "ros", "--out", "x"], 3),
        (["--from", "clouds", "--out", "rec"], 1),
        (["--from", "clouds", "--out", "x", "--gravity", "1,2"], 2),
    ):
        failed = ropefit("import", clouds, *arguments, code=code)
        assert len(failed.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "x").exists()


def test_images_reach_the_observations(ropefit, tmp_path: Path) -> None:
    """The sample's images through a ROS bag: the same rope comes out."""
    import cv2

    from ropefit.recordings.manifest import read_manifest

    table = read_manifest(SAMPLES / "rgbd").rgbd
    assert table is not None
    ros = sources.Ros(2)
    camera = table.intrinsics
    info = ros.info(1.0)
    info.width, info.height = camera.width, camera.height
    info.k[:] = [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]
    pose = np.array(table.camera_pose)
    turn = _quaternion(pose[:3, :3])
    messages = [
        ("/tf_static", 1.0, ros.tree(ros.tf(1.0, "world", "camera", pose[:3, 3], turn))),
        ("/info", 1.0, info),
    ]
    for frame in (0, 5):
        color = cv2.imread(str(SAMPLES / "rgbd" / table.color.format(frame=frame)))
        depth = cv2.imread(str(SAMPLES / "rgbd" / table.depth.format(frame=frame)), -1)
        messages += [
            ("/color", 1.0 + frame, ros.image(1.0 + frame, color, "bgr8")),
            ("/depth", 1.0 + frame, ros.image(1.0 + frame, depth, "16UC1")),
        ]
    bag = ros.write(tmp_path / "bag", messages, "mcap")
    ropefit(
        "import", bag, "--from", "ros", "--out", "rec", "--set", "color=/color", "--set",
        "depth=/depth", "--set", "info=/info", "--set", "frame=world",
    )  # fmt: skip
    told = ropefit.json("preprocess", "rec", "--nodes", 8)
    assert told["frames"] == 2
    assert 0.6 < told["length_m"] < 1.05


def _quaternion(matrix: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(matrix).as_quat(), 1)


def test_nothing_heavy_for_help() -> None:
    import subprocess

    code = (
        "import sys; import ropefit.cli; "
        "bad = {'rosbags', 'numpy', 'ezc3d', 'pydantic'} & set(sys.modules); assert not bad, bad"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
