"""Recordings of single shapes at rest, which have no times: none are invented."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ropefit
from ropefit.api.inspect_recording import inspect_recording
from ropefit.errors import BadInput
from ropefit.recordings import open_recording
from ropefit.recordings.writer import About
from ropefit.stages.importing import import_recording
from tests.factories import marker_recording


def without_times(path: Path) -> None:
    """Take the column time from a table."""
    rows = [row.split(",") for row in path.read_text().splitlines()]
    at = rows[0].index("time")
    path.write_text("\n".join(",".join(row[:at] + row[at + 1 :]) for row in rows) + "\n")


@pytest.fixture
def still(tmp_path: Path) -> Path:
    where = marker_recording(tmp_path / "still", frames=8)
    for name in ("markers.csv", "ends.csv"):
        without_times(where / name)
    return where


def test_no_time_is_invented(still: Path) -> None:
    recording = open_recording(still)
    assert recording.times(recording.frames) is None
    assert ropefit.preprocess(still).time is None
    assert "no times" in str(inspect_recording(still))


def test_the_equilibrium_is_that_of_the_same_shapes_with_times(still: Path, tmp_path: Path) -> None:
    timed = ropefit.preprocess(marker_recording(tmp_path / "timed", frames=8))
    assert timed.time is not None
    rigidities = []
    for o in (ropefit.preprocess(still), timed):
        fitted = ropefit.fit(o, solver="equilibrium", free=["EI"]).nominal
        rigidities += [group.parameters["EI"].value for group in fitted.groups.values()]
    assert rigidities[0] == pytest.approx(rigidities[1], rel=1e-9)


def test_a_motion_needs_times(still: Path) -> None:
    with pytest.raises(BadInput, match="has no times"):
        ropefit.fit(ropefit.preprocess(still), solver="dynamics")


def test_ends_without_times_are_taken_by_frame(tmp_path: Path) -> None:
    where = marker_recording(tmp_path / "r", frames=3)
    without_times(where / "ends.csv")
    recording = open_recording(where)
    assert recording.ends is not None
    assert list(recording.ends[0].position) == [0, 1, 2]
    assert recording.times([0, 1, 2]) is not None


def test_a_table_of_positions_without_times_is_imported_as_it_is(tmp_path: Path) -> None:
    points = np.random.default_rng(3).normal(0, 0.1, (5, 4, 3))
    np.savez(tmp_path / "shapes.npz", positions=points)
    about = About(name="shapes")
    done = import_recording(tmp_path / "shapes.npz", "mocap", tmp_path / "out", {}, about)
    assert "no times" in str(done)
    recording = open_recording(tmp_path / "out")
    assert recording.times(recording.frames) is None
    shown = recording.source.sight(2).points
    assert shown is not None
    np.testing.assert_allclose(shown, points[2])
