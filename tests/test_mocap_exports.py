"""Exports of Motive, Qualisys and Vicon, and others with two header rows, as they are written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ropefit.errors import BadInput
from ropefit.importers.mocap import Mocap
from tests.factories import rope_points
from tests.test_importers import brought

NAMES = ["m1", "m2", "m3", "m4"]
FRAMES = 5


def points(frame: int) -> np.ndarray:
    return rope_points(frame, 4) + np.array([0.1, 0.2, 0.3])


def motive(path: Path, unit: str = "Millimeters") -> Path:
    """A take with a rigid body before the markers; m2 is hidden in frame 3."""
    scale = {"Millimeters": 1000.0, "Meters": 1.0}[unit]
    body = 4
    first = (
        "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,100.000000,Export Frame Rate,"
        f"100.000000,Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global"
    )
    rows = [
        first,
        "",
        ",Type," + "Rigid Body," * body + ",".join(["Marker"] * 12),
        ",Name," + "Gripper," * body + ",".join(f"rope:{n}" for n in NAMES for _ in range(3)),
        ",ID," + "1," * body + ",".join(f"2-{k}" for k in range(4) for _ in range(3)),
        ",," + "Rotation," + "Position," * 3 + ",".join(["Position"] * 12),
        "Frame,Time (Seconds),W,X,Y,Z," + ",".join("XYZ" * 4),
    ]
    for frame in range(FRAMES):
        x, y, z = points(frame).T * scale
        cells = [f"{v:.6f}" for v in np.stack([x, z, -y], axis=1).ravel()]  # Y up
        if frame == 3:
            cells[3:6] = ["", "", ""]
        rows.append(",".join([str(frame), f"{frame / 100:.6f}", "1", "9", "9", "9", *cells]))
    path.write_text("\n".join(rows) + "\n")
    return path


def qualisys(path: Path, lead: bool) -> Path:
    rows = [
        f"NO_OF_FRAMES\t{FRAMES}", "NO_OF_CAMERAS\t8", "NO_OF_MARKERS\t4", "FREQUENCY\t100",
        "DESCRIPTION\t--", "TIME_STAMP\t2026-01-01, 10:00:00\t5.1", "DATA_INCLUDED\t3D",
        "EVENT\tStart\t2\t0.02", "MARKER_NAMES\t" + "\t".join(NAMES),
        "TRAJECTORY_TYPES\t" + "\t".join(["Measured"] * 4),
    ]  # fmt: skip
    if lead:
        rows.append("Frame\tTime\t" + "\t".join(f"{n} {axis}" for n in NAMES for axis in "XYZ"))
    for frame in range(FRAMES):
        values = [f"{1000 * v:.3f}" for v in points(frame).ravel()]
        if frame == 3:
            values[3:6] = ["0.000"] * 3
        rows.append("\t".join(([str(frame + 1), f"{frame / 100:.5f}"] if lead else []) + values))
    path.write_text("\n".join(rows) + "\n")
    return path


def two_rows(path: Path, time_above: bool = False) -> Path:
    names, axes = ",".join(f"{n},," for n in NAMES), ",".join(["X (mm),Y (mm),Z (mm)"] * 4)
    rows = [f"Frame,Time,{names}", f",s,{axes}"] if time_above else [f",,{names}"]
    rows += [] if time_above else [f"Frame,Time,{axes}"]
    for frame in range(FRAMES):
        values = [f"{1000 * v:.3f}" for v in points(frame).ravel()]
        if frame == 3:
            values[3:6] = [""] * 3
        rows.append(",".join([str(frame), f"{frame / 100:.3f}", *values]))
    path.write_text("\n".join(rows) + "\n")
    return path


def vicon(path: Path) -> Path:
    rows = ["Trajectories", "100", ",," + ",".join(f"rope:{n},," for n in NAMES)]
    rows.append("Frame,Sub Frame," + ",".join(["X,Y,Z"] * 4))
    rows.append(",," + ",".join(["mm"] * 12))
    for frame in range(FRAMES):
        values = [f"{1000 * v:.3f}" for v in points(frame).ravel()]
        if frame == 3:
            values[3:6] = [""] * 3
        rows.append(",".join([str(frame + 1), "0", *values]))
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize(
    "make",
    [
        lambda path: motive(path / "take.csv"),
        lambda path: motive(path / "take.csv", "Meters"),
        lambda path: qualisys(path / "take.tsv", True),
        lambda path: qualisys(path / "take.tsv", False),
        lambda path: two_rows(path / "take.csv"),
        lambda path: two_rows(path / "take.csv", time_above=True),
        lambda path: vicon(path / "take.csv"),
    ],
    ids=[
        "motive mm",
        "motive m",
        "qualisys with time",
        "qualisys",
        "two rows",
        "time above",
        "vicon",
    ],
)
def test_exports_as_written(make, tmp_path: Path) -> None:
    source = make(tmp_path)
    listed = Mocap().contents(source)
    assert [entry.name.removeprefix("rope:") for entry in listed] == NAMES
    assert [entry.count for entry in listed] == [5, 4, 5, 5]
    recording = brought(source, "mocap")
    assert len(recording.frames) == FRAMES
    for frame in range(FRAMES):
        expected = points(frame)
        if frame == 3:
            expected[1] = np.nan
        sight = recording.source.sight(frame)
        assert sight.points is not None
        np.testing.assert_allclose(sight.points, expected, atol=2e-6)
        assert recording.source.time[frame] == pytest.approx(frame / 100)


def test_up_can_be_said(tmp_path: Path) -> None:
    source = motive(tmp_path / "take.csv")
    seen = brought(source, "mocap", up="z").source.sight(0).points
    assert seen is not None
    x, y, z = points(0).T
    np.testing.assert_allclose(seen, np.stack([x, z, -y], axis=1), atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Millimeters", "Furlongs", "no unit known"),
        ("rope:m3", "rope:m2", "occurs twice"),
        ("0.010000,1,9", "0.010000,what,9", "column W: 'what' is not a number"),
        (",Marker", ",Bone", "no marker"),
    ],
)
def test_exports_that_are_not_whole(old: str, new: str, words: str, tmp_path: Path) -> None:
    source = motive(tmp_path / "take.csv")
    source.write_text(source.read_text().replace(old, new))
    with pytest.raises(BadInput, match=words):
        brought(source, "mocap")


def test_rows_that_are_short_or_empty_are_markers_not_seen(tmp_path: Path) -> None:
    source = two_rows(tmp_path / "take.csv")
    rows = source.read_text().splitlines()
    rows[3] = ",".join(rows[3].split(",")[:8])  # m3 and m4 are cut off
    rows[4] = rows[4].rsplit(",", 3)[0] + ",NaN,null,"
    source.write_text("\n".join([*rows[:3], *rows[3:], "", "," * 13]) + "\n")
    recording = brought(source, "mocap")
    assert len(recording.frames) == FRAMES
    seen = [np.isfinite(recording.source.sight(f).points).all(axis=1) for f in range(FRAMES)]
    assert seen[1].tolist() == [True, True, False, False]
    assert seen[2].tolist() == [True, True, True, False]
    assert seen[4].all()


@pytest.mark.parametrize("at", [3, 60])
def test_rows_that_are_too_long(at: int, tmp_path: Path) -> None:
    source = two_rows(tmp_path / "take.csv")
    rows = source.read_text().splitlines()
    rows += [rows[-1]] * 60
    source.write_text("\n".join([*rows[:at], rows[at] + ",1.0,2.0", *rows[at + 1 :]]))
    with pytest.raises(BadInput, match=r"take\.csv: (a row has|.*saw) 16"):
        brought(source, "mocap")


def test_a_long_header_with_empty_lines_and_quotes(tmp_path: Path) -> None:
    source = motive(tmp_path / "take.csv")
    first, rest = source.read_text().split("\n", 1)
    source.write_text(first + ',Note,"two\nlines, one cell"\n\n\n\n' + rest)
    points_seen = brought(source, "mocap").source.sight(2).points
    np.testing.assert_allclose(points_seen, points(2), atol=2e-6)
