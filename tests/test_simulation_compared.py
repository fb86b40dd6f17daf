"""A simulation is compared with a recording only if it is of the same motion."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.artifacts import Observations
from ropefit.errors import BadInput
from ropefit.fitting.simulation import NOISE, as_markers, check_same_motion
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
