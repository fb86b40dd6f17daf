"""A rope in the cloud of a whole scene: floor, wall, table, a lump that holds it."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.errors import BadInput
from ropefit.perception.cloud import trace_cloud
from ropefit.perception.trace import FrameRejected
from ropefit.perception.whole_scene import is_scene, rope_in_scene
from ropefit.recordings import open_recording
from tests.factories import cloud_recording, edit
from tests.ropecloud import cloud, nearest, shapes

LINE, CURVE = shapes()["s-curve"]
UNKNOWN = np.full((2, 3), np.nan)


def surface(rng, count: int, low, high) -> np.ndarray:
    return rng.uniform(low, high, (count, 3)) + 0.001 * rng.normal(size=(count, 3))


def room(rng: np.random.Generator) -> np.ndarray:
    """Floor, wall and table of some metres, a box, and a gripper around the start of the rope."""
    return np.concatenate([
        surface(rng, 60_000, (-2, -2, -1), (3, 2, -1)),
        surface(rng, 50_000, (-2, 1.5, -1), (3, 1.5, 2)),
        surface(rng, 30_000, (-0.3, -0.5, -0.4), (1.3, 0.5, -0.4)),
        surface(rng, 4_000, (0.5, 0.2, -0.4), (0.6, 0.3, -0.3)),
        CURVE[0] + 0.03 * rng.normal(size=(3_000, 3)) - [0.06, 0, 0],
    ])  # fmt: skip


@pytest.fixture(scope="module")
def scene() -> np.ndarray:
    rng = np.random.default_rng(4)
    points, _ = cloud(LINE, CURVE, 4000, rng)
    return rng.permutation(np.concatenate([points, room(rng)]))


def test_the_rope_is_found(scene: np.ndarray) -> None:
    assert is_scene(scene, 1.0)
    trace = trace_cloud(scene, CURVE[[0, -1]], 1.0)
    away, _ = nearest(CURVE, trace.centreline)
    assert np.median(away) < 1.5e-3
    assert np.percentile(away, 95) < 4e-3
    assert trace.traced == pytest.approx(1.0, rel=0.02)
    again = trace_cloud(scene, CURVE[[0, -1]], 1.0)
    np.testing.assert_array_equal(trace.points, again.points)


def test_without_ends_a_crop_box_finds_it(scene: np.ndarray) -> None:
    inside = scene[((scene > (-0.02, -0.1, -0.36)) & (scene < (1.1, 0.1, 0.4))).all(axis=1)]
    thrice = np.concatenate(
        [inside + np.array([0, 0.0002 * k, 0]) for k in range(6)]
    )  # a denser sensor
    assert is_scene(thrice, 1.0)
    kept = rope_in_scene(thrice, UNKNOWN, 1.0)
    away, _ = nearest(CURVE, kept)
    assert np.percentile(away, 99) < 0.03
    covered, _ = nearest(kept, CURVE)
    assert np.percentile(covered, 95) < 0.01


def test_a_scene_without_a_rope_says_what_each_step_left() -> None:
    empty = room(np.random.default_rng(5))[:140_000]
    with pytest.raises(FrameRejected, match=r"140,000 points, [\d,]+ within reach .* off planes"):
        rope_in_scene(empty, CURVE[[0, -1]], 1.0)
    with pytest.raises(FrameRejected, match=r"give \[rope\] length"):
        rope_in_scene(empty, CURVE[[0, -1]], None)


def test_a_small_cloud_is_no_scene() -> None:
    points, _ = cloud(LINE, CURVE, 1400, np.random.default_rng(0))
    assert not is_scene(points, 1.0)
    assert not is_scene(np.zeros((0, 3)), 1.0)


def test_crop_is_read_and_checked(tmp_path) -> None:
    where = cloud_recording(tmp_path / "r")
    whole = open_recording(where).source.sight(0).points
    assert whole is not None
    middle = float(np.median(whole[:, 0]))
    edit(where / "recording.toml", "[clouds]", f"[clouds]\ncrop = [[{middle}, -9, -9], [9, 9, 9]]")
    cropped = open_recording(where).source.sight(0).points
    assert cropped is not None
    assert 0 < len(cropped) <= (len(whole) + 1) // 2
    assert (cropped[:, 0] > middle).all()
    edit(where / "recording.toml", "[9, 9, 9]]", "[-9, 9, 9]]")
    with pytest.raises(BadInput, match="lowest corner, highest corner"):
        open_recording(where)
