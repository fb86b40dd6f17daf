"""A simulation is compared with a recording only if it is of the same motion."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.artifacts import Observations
from ropefit.artifacts.causes import Cause, Size
from ropefit.errors import BadInput
from ropefit.fitting.simulation import (
    NOISE,
    as_markers,
    beside,
    check_same_motion,
    check_same_times,
)
from ropefit.runs.loading import load
from tests.factories import marker_recording
from tests.test_checkpoints import compute


@pytest.fixture(scope="module")
def seen(tmp_path_factory) -> Observations:
    folder = tmp_path_factory.mktemp("seen")
    marker_recording(folder / "recording", frames=4)
    compute(folder / "run", "preprocess")
    return load(folder / "run", Observations)[0]


def test_a_simulation_is_a_recording_without_noise(seen):
    x = np.nan_to_num(seen.centreline)
    shapes = as_markers(seen, x)
    frames, nodes = x.shape[:2]
    assert shapes.source == "markers"
    assert len(shapes.points) == frames * (nodes - 2) == shapes.point_start[-1]
    assert shapes.points[nodes - 2] == pytest.approx(x[1, 1])
    assert shapes.noise == pytest.approx(np.full(frames, NOISE * seen.length))
    check_same_motion(seen, shapes)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"frames": np.arange(3)}, "3 frames"),
        ({"length": 2.0}, "long"),
        ({"end_kind": ("pinned", "free")}, "held|hold"),
        ({"node_arc": np.linspace(0, 1, 33)}, "--nodes"),
        ({"end_position": np.full((4, 2, 3), 5.0)}, "mm apart"),
    ],
)
def test_another_motion_is_refused(seen, change, said):
    with pytest.raises(BadInput, match=said):
        check_same_motion(
            seen, as_markers(seen, np.nan_to_num(seen.centreline)).model_copy(update=change)
        )


def test_other_times_are_refused(seen):
    moving = seen.model_copy(update={"time": 0.01 * np.arange(4.0)})
    check_same_times(moving, moving.model_copy(update={"time": 5 + moving.time}))
    slower = moving.model_copy(update={"time": np.array([0, 0.01, 0.03, 0.04])})
    with pytest.raises(BadInput, match=r"frame 1 to the next pass 0.01 s .* 0.02 s"):
        check_same_times(moving, slower)
    with pytest.raises(BadInput, match="no times"):
        check_same_times(moving, moving.model_copy(update={"time": None}))


def cause(name: str, size: float, at: float | None = None, half: float = 0.001) -> Cause:
    place = None if at is None else (at - 0.01, at + 0.01)
    told = Size(value=size, unit="kg", ci95=(size - half, size + half))
    return Cause(
        name=name, kind="physics", variant=name, arc_length=place, frames=np.arange(2),
        parameters={"mass": told}, values=np.array([size]), value_names=["mass"], equivalent_to=[],
        log_evidence=20.0, p_value=1e-6, heldout_gain=np.ones(5), sentence="",
    )  # fmt: skip


def test_what_the_simulation_has_is_not_missing():
    real = {"a": cause("point_mass", 0.02, 0.4), "b": cause("kink", 0.3, 0.7)}
    assert beside(real, {}, 1.0) == (["point_mass", "kink"], [])
    assert beside(real, {"x": cause("point_mass", 0.0205, 0.41)}, 1.0) == (["kink"], [])
    missing, differences = beside(real, {"x": cause("point_mass", 0.01, 0.41)}, 1.0)
    assert missing == ["kink"]
    assert len(differences) == 1
    assert "0.02 kg in the recording and 0.01 kg in the simulation" in differences[0]
    elsewhere = {"x": cause("point_mass", 0.02, 0.8)}
    assert beside(real, elsewhere, 1.0)[0] == ["point_mass", "kink"]
