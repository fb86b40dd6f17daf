"""Cameras, planes, markers, skeletons, and ropes in drawn pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ropefit.perception.camera import Camera, virtual_camera
from ropefit.perception.markers import marker_arc, marker_noise, trace_markers
from ropefit.perception.plane import hanging_plane
from ropefit.perception.rgbd import trace_rgbd
from ropefit.perception.segment import segment_rope
from ropefit.perception.trace import FrameRejected, polyline_arc
from tests.ropecloud import nearest, shapes

GRAVITY = np.array([0.0, 0.0, -9.81])
NOWHERE = np.full((2, 2), np.nan)
SIZE = (240, 360)
GROUND = (150, 152, 148)
ORANGE = (214, 96, 30)


def wave(start: float = 40, stop: float = 320, count: int = 2000) -> np.ndarray:
    """(count, 2) [px] the curve of the drawn rope."""
    u = np.linspace(start, stop, count)
    return np.column_stack([u, 120 + 60 * np.sin(u / 50)])


def draw(image: np.ndarray, curve: np.ndarray, colour, width: int) -> None:
    """A line along (N, 2) [px], in place."""
    points = np.round(curve * 16).astype(np.int32)[:, None]
    cv2.polylines(image, [points], False, colour, width, cv2.LINE_AA, shift=4)


def drawn_mask(*curves: np.ndarray, width: int = 5) -> np.ndarray:
    """(H, W) bool of lines along curves."""
    image = np.zeros(SIZE, np.uint8)
    for curve in curves:
        draw(image, curve, 255, width)
    return image > 127


@given(
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-5, 5)] * 3),
    st.floats(0.1, 10),
    st.floats(-500, 1500),
)
@settings(max_examples=30, derandomize=True, deadline=None)
def test_project_undoes_unproject(turn, place, depth: float, u: float) -> None:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), place
    camera = Camera(640, 480, 500.0, 510.0, 320.0, 250.0, pose)
    pixels, at = np.array([[u, 77.0], [3.0, u]]), np.array([depth, 2 * depth])
    points = camera.unproject(pixels, at)
    np.testing.assert_allclose(camera.project(points), pixels, atol=1e-7)
    np.testing.assert_allclose(camera.local(points)[:, 2], at, rtol=1e-9)
    beside = camera.project(pose[:3, 3][None] + pose[:3, 0])  # in the plane of the camera
    assert not (np.abs(beside) < 1e6).all()
    along = points - pose[:3, 3]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.rays(pixels), along, atol=1e-9)


@pytest.mark.parametrize("viewpoint", [None, [0.3, -2.5, 0.0], [0.5, 0.0, 3.0], [0.5, 0.0, -3.0]])
@pytest.mark.parametrize("name", [*shapes(), "ball"])
def test_virtual_camera_sees_all(name: str, viewpoint: list[float] | None) -> None:
    ball = np.random.default_rng(0).normal(size=(4000, 3))
    ball *= 0.5 / np.linalg.norm(ball, axis=1, keepdims=True)
    points = ball if name == "ball" else shapes()[name][1]
    where = None if viewpoint is None else np.array(viewpoint)
    for gravity in (GRAVITY, np.zeros(3)):
        camera = virtual_camera(points, gravity, where)
        assert camera.virtual
        rotation = camera.pose[:3, :3]
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        assert (camera.local(points)[:, 2] > 0).all()
        pixels = camera.project(points)
        assert (pixels >= 0).all()
        assert (pixels <= [1280, 720]).all()
        if where is not None:
            np.testing.assert_array_equal(camera.pose[:3, 3], where)
        elif name == "s-curve" and gravity.any():
            assert rotation[2, 1] < -0.99  # down in the image is down in the world


def test_hanging_plane() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)) * [0.1, 1.0, 1.0]
    ends = np.array([[0.0, 0.0, 1.0], [0.6, 0.8, 0.2]])
    origin, normal = hanging_plane(ends, GRAVITY, points)
    np.testing.assert_array_equal(origin, ends[0])
    np.testing.assert_allclose(abs(normal), [0.8, 0.6, 0], atol=1e-12)
    above = np.array([[0.0, 0.0, 1.0], [0.001, 0.0, 0.0]])  # the points decide: they spread in y
    _, normal = hanging_plane(above, GRAVITY, points)
    assert abs(normal[0]) > 0.99
    assert normal[2] == pytest.approx(0, abs=1e-12)
    for one in (0, 1):
        free = ends.copy()
        free[one] = np.nan
        origin, normal = hanging_plane(free, GRAVITY, points)
        np.testing.assert_array_equal(origin, ends[1 - one])
        assert normal[2] == pytest.approx(0, abs=1e-12)
    vertical = shapes()["vertical"][1]
    for down in np.eye(3):
        _, normal = hanging_plane(vertical[[0, -1]], 9.81 * down, vertical)
        assert np.linalg.norm(normal) == pytest.approx(1)
        assert normal @ down == pytest.approx(0, abs=1e-9)
    origin, normal = hanging_plane(np.full((2, 3), np.nan), np.zeros(3), points)
    np.testing.assert_allclose(origin, points.mean(axis=0))
    assert abs(normal[0]) > 0.9


def test_marker_arc_of_a_rope_that_bends_now_and_then() -> None:
    """Two pieces, 0.1 and 0.2 m; the second is bent in most of the frames, straight in some."""
    frames = 400
    turn = 1.25 * (1 - np.cos(np.arange(frames) * 2 * np.pi / 100)) + 1e-9
    chord = np.stack([np.full(frames, 0.1), 0.2 * np.sin(turn / 2) / (turn / 2)], axis=1)
    places = np.concatenate([np.zeros((frames, 1)), chord.cumsum(axis=1)], axis=1)
    noise = np.random.default_rng(0).normal(scale=1e-4, size=(frames, 3, 3))
    positions = noise + places[..., None] * np.array([1.0, 0, 0])
    unknown = np.full((frames, 2, 3), np.nan)
    few, _ = marker_arc(positions[:80], unknown[:80], None)
    assert few[2] - few[1] < 0.195  # of few frames the usual chord
    found, total = marker_arc(positions, unknown, None)
    np.testing.assert_allclose(found, [0, 0.1, 0.3], atol=5e-4)
    assert total == found[-1]


def test_marker_arc_with_markers_unseen() -> None:
    arc, curve = shapes()["helix"]
    at = np.linspace(0.05, 0.95, 19)
    markers = np.column_stack([np.interp(at, arc, c) for c in curve.T])
    positions = np.repeat(markers[None], 6, axis=0)
    rng = np.random.default_rng(0)
    positions[rng.random((6, 19)) < 0.2] = np.nan
    ends = np.repeat(curve[[0, -1]][None], 6, axis=0)
    found, length = marker_arc(positions, ends, None)
    np.testing.assert_allclose(found, at, atol=6e-3)  # chords are shorter than arcs
    assert 0.99 < length < 1
    found, length = marker_arc(positions, ends, 1.0)
    np.testing.assert_allclose(found, at, atol=5e-4)
    assert length == 1.0
    found, length = marker_arc(positions, np.full((6, 2, 3), np.nan), 1.0)
    assert found[0] == 0
    np.testing.assert_allclose(found, at - at[0], atol=6e-3)  # not stretched over the whole rope
    positions[:, 7] = np.nan  # never seen: its neighbours are as far from it as usual
    np.testing.assert_allclose(marker_arc(positions, ends, 1.0)[0], at, atol=2e-3)
    with pytest.raises(FrameRejected, match="coincide"):
        marker_arc(np.full((6, 19, 3), np.nan), ends, 1.0)
    with pytest.raises(FrameRejected, match="coincide"):
        marker_arc(np.zeros((6, 19, 3)), ends, None)


def test_trace_markers() -> None:
    arc, curve = shapes()["helix"]
    at = np.linspace(0.05, 0.95, 13)
    markers = np.column_stack([np.interp(at, arc, c) for c in curve.T])
    tangents = np.gradient(curve, arc, axis=0)[[0, -1]]
    markers[3] = np.nan
    worst = {}
    for clamped in (True, False):
        given_ = tangents if clamped else np.full((2, 3), np.nan)
        trace = trace_markers(markers, at, 1.0, curve[[0, -1]], given_)
        assert len(trace.points) == 12
        np.testing.assert_allclose(trace.centreline[[0, -1]], curve[[0, -1]], atol=1e-9)
        worst[clamped] = nearest(curve, trace.centreline)[0].max()
    assert worst[True] < 1e-3
    assert worst[True] <= worst[False] < 2e-3
    markers[1:] = np.nan
    with pytest.raises(FrameRejected, match="1 of 13 markers seen"):
        trace_markers(markers, at, 1.0, curve[[0, -1]], tangents)


@pytest.mark.parametrize("noise", [1e-5, 3e-4, 2e-3])
def test_marker_noise_fast(noise: float) -> None:
    time = np.arange(200) / 120
    sway = 0.1 * np.sin(2 * np.pi * 0.7 * time)
    positions = np.linspace(0, 1, 9)[None, :, None] * [1.0, 0, 0] + sway[:, None, None]
    rng = np.random.default_rng(0)
    seen = positions + noise * rng.normal(size=positions.shape)
    seen[rng.random(seen.shape[:2]) < 0.05] = np.nan
    found, how, known = marker_noise(seen, time, np.linspace(0, 1, 9))
    assert found == pytest.approx(noise, rel=0.3)
    assert how
    assert known or "upper bound" in how


def test_marker_noise_that_cannot_be_measured() -> None:
    found, how, known = marker_noise(np.zeros((3, 4, 3)), np.arange(3.0), np.arange(4.0))
    assert not known
    assert found == 1e-3
    assert "assumed" in how


def picture(shade: float = 0.0, noise: float = 1.5) -> np.ndarray:
    """A drawn orange rope over a grey ground, with things that are not the rope."""
    image = np.full((*SIZE, 3), GROUND, np.uint8)
    cv2.rectangle(image, (20, 190), (110, 235), (60, 70, 120), -1)  # a blue box
    cv2.circle(image, (300, 40), 26, ORANGE, -1)  # a blob of the rope's hue
    draw(image, np.array([[10.0, 215.0], [350.0, 180.0]]), (40, 60, 150), 4)  # a blue cable
    draw(image, wave(), ORANGE, 5)
    light = 1 - shade * np.linspace(0, 1, SIZE[1])[None, :, None]
    noisy = image * light + noise * np.random.default_rng(0).normal(size=image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shade", [0.0, 0.2, 0.4, 0.6])
def test_segmentation_among_distractors(shade: float) -> None:
    found = segment_rope(picture(shade), wave()[[0, -1]])
    away, index = nearest(wave(), found.path)
    assert np.median(away) < 0.5
    assert away.max() < 3
    assert np.ptp(index) > 1900
    assert (np.diff(index) >= -5).all()  # from end 0 to end 1
    assert 3 < found.width < 8
    truth = drawn_mask(wave())
    assert (found.mask & truth).sum() > 0.65 * truth.sum()
    with pytest.raises(FrameRejected, match="no long thin region"):
        segment_rope(np.full((*SIZE, 3), GROUND, np.uint8), NOWHERE)


def test_a_drawn_rope_in_space() -> None:
    """Depth with the wall behind, flying pixels at the edge and holes."""
    pose = np.eye(4)
    camera = Camera(SIZE[1], SIZE[0], 300.0, 300.0, 180.0, 120.0, pose)
    rng = np.random.default_rng(0)
    image = picture()
    front = 1.0 + 0.1 * np.arange(SIZE[1]) / SIZE[1] + np.zeros(SIZE)
    rope = drawn_mask(wave())
    edge = rope & ~cv2.erode(rope.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    depth = np.where(rope, front, 1.6) + 0.001 * rng.normal(size=SIZE)
    depth[edge] += 0.5 * rng.random(edge.sum())
    depth[rng.random(SIZE) < 0.05] = 0
    at = np.interp(wave()[:, 0], np.arange(SIZE[1]), front[0])
    curve = camera.unproject(wave(), at)
    length = float(polyline_arc(curve)[-1])
    trace, _ = trace_rgbd(image, depth, camera, curve[[0, -1]], length, None)
    away, index = nearest(curve, trace.points)
    assert 1e-4 < np.median(away) < 2e-3
    assert np.percentile(away, 95) < 6e-3
    assert np.median(abs(trace.point_arc - polyline_arc(curve)[index])) < 0.01 * length
    deep, _ = trace_rgbd(image, depth, camera, curve[[0, -1]], length, 0.01)
    moved = np.linalg.norm(deep.points, axis=1) - np.linalg.norm(trace.points, axis=1)
    # As far as the rope's front stands before its axis: a radius in the middle, less beside it.
    assert 0.008 < np.median(moved) <= 0.0101
    with pytest.raises(FrameRejected, match="depth at 0 of"):
        trace_rgbd(image, np.zeros(SIZE), camera, curve[[0, -1]], length, None)
