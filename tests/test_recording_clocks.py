"""Poses of the ends on another clock than the markers'."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ropefit.errors import BadInput
from ropefit.recordings import open_recording
from tests.factories import marker_recording

FRAMES = 3  # of markers, at 0, 0.5 and 1 s


def where_at(time: np.ndarray) -> np.ndarray:
    """(T, 3) [m] a smooth motion of end 0."""
    zero = 0 * time
    return np.stack([0.05 * np.sin(3 * time), zero, 0.02 * np.cos(2 * time) - 0.02], axis=1)


def turned_at(time: np.ndarray) -> np.ndarray:
    """(T, 4) a steady turn about y, w x y z, its sign changing from pose to pose."""
    half, zero = 0.2 * time, 0 * time
    sign = np.where(np.arange(len(time)) % 2, -1.0, 1.0)
    return sign[:, None] * np.stack([np.cos(half), zero, np.sin(half), zero], axis=1)


def recording(directory: Path, time: np.ndarray, first: int = 0) -> Path:
    where = marker_recording(directory, frames=FRAMES)
    rows = ["frame,time,end,x,y,z,qw,qx,qy,qz"]
    poses = zip(time, where_at(time), turned_at(time), strict=True)
    for frame, (t, x, q) in enumerate(poses, first):
        rows.append(",".join(f"{v:.9f}" for v in (frame, t, 0, *x, *q)))
        rows.append(f"{frame},{t:.9f},1,0.7,0,0,,,,")
    (where / "ends.csv").write_text("\n".join(rows))
    return where


@pytest.mark.parametrize("first", [0, 1000])  # frame numbers of the poses mean nothing then
def test_poses_are_interpolated_to_the_markers_times(first: int, tmp_path: Path) -> None:
    ends = open_recording(recording(tmp_path / "r", np.arange(-0.13, 1.2, 0.03), first)).ends
    assert ends is not None
    at = np.array([0.0, 0.5, 1.0])
    for frame, x, q in zip(range(FRAMES), where_at(at), turned_at(at), strict=True):
        np.testing.assert_allclose(ends[0].position[frame], x, atol=1e-6)
        assert abs(ends[0].orientation[frame] @ q) == pytest.approx(1, abs=1e-9)
        np.testing.assert_allclose(ends[1].position[frame], [0.7, 0, 0], atol=1e-12)


def test_a_constant_offset_is_left_as_it_is(tmp_path: Path) -> None:
    late = np.arange(0.0, 1.5, 0.02)
    where = recording(tmp_path / "r", late)
    text = (where / "ends.csv").read_text().splitlines()
    rows = [row.split(",") for row in text[1:]]
    moved = [",".join([r[0], f"{float(r[1]) - 0.1:.9f}", *r[2:]]) for r in rows]
    (where / "ends.csv").write_text("\n".join([text[0], *moved]))
    ends = open_recording(where).ends
    assert ends is not None
    expected = where_at(np.array([0.6]))[0]
    np.testing.assert_allclose(ends[0].position[1], expected, atol=1e-6)


def test_same_times_are_taken_by_frame(tmp_path: Path) -> None:
    time = np.array([0.0, 0.5, 1.0])
    ends = open_recording(recording(tmp_path / "r", time)).ends
    assert ends is not None
    np.testing.assert_array_equal(list(ends[0].position), range(FRAMES))
    np.testing.assert_allclose(list(ends[0].position.values()), where_at(time), atol=1e-9)


def test_marker_frames_without_poses_near_in_time_get_none(tmp_path: Path) -> None:
    time = np.arange(0.2, 1.3, 0.03)
    time = time[(time < 0.4) | (time > 0.7)]  # a gap in which frame 1 lies; frame 0 is before
    ends = open_recording(recording(tmp_path / "r", time)).ends
    assert ends is not None
    assert list(ends[0].position) == list(ends[0].orientation) == [2]


def test_clocks_that_do_not_meet_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"poses at 50 to .* markers are at 0 to 1 s.*one clock"):
        open_recording(recording(tmp_path / "r", np.arange(50.0, 52.0, 0.1)))
    with pytest.raises(BadInput, match="time does not increase"):
        open_recording(recording(tmp_path / "s", np.full(5, 0.2)))
