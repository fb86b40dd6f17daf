"""Clouds: order, centreline, arc length; gaps, outliers, rejections; invariances."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ropefit.perception.assemble import _ends_seen
from ropefit.perception.cloud import remove_outliers, scatter, trace_cloud
from ropefit.perception.graph import MOST_PIECES
from ropefit.perception.trace import FrameRejected, Trace, project_to_polyline
from tests.ropecloud import bent, cloud, nearest, shapes

SHAPES = shapes()
UNKNOWN = np.full((2, 3), np.nan)
PHASES = [Phase.explicit, Phase.generate]  # a failing example is small as it is
EYE = np.array([0.3, -1.5, 0.1])


def ends_of(curve: np.ndarray, known: str) -> np.ndarray:
    """(2, 3) [m] ends of a curve; `known` is "both", "first", "last" or "none"."""
    ends = curve[[0, -1]].copy()
    ends[{"both": [], "first": [1], "last": [0], "none": [0, 1]}[known]] = np.nan
    return ends


def errors(trace: Trace, arc: np.ndarray, curve: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(centreline's distances from the truth, arc errors of the points as shares) of a trace."""
    away, _ = nearest(curve, trace.centreline)
    _, index = nearest(curve, trace.points)
    return away, trace.point_arc / trace.length - arc[index] / arc[-1]


@pytest.mark.parametrize("known", ["both", "first", "last", "none"])
@pytest.mark.parametrize("name", SHAPES)
def test_shapes(name: str, known: str) -> None:
    arc, curve = SHAPES[name]
    points, _ = cloud(arc, curve, 1000, np.random.default_rng(0))
    trace = trace_cloud(points, ends_of(curve, known), 1.0)
    away, error = errors(trace, arc, curve)
    if known == "none" and np.median(abs(error)) > 0.2:  # either end may come first
        error = 1 - trace.point_arc / trace.length - arc[nearest(curve, trace.points)[1]]
    assert 5e-5 < np.median(away) < 1.2e-3
    assert away.max() < 6e-3
    assert np.median(abs(error)) < 4e-3
    assert abs(error).max() < 1.1e-2
    assert trace.length == pytest.approx(1.0, abs=0.015)
    assert (np.diff(trace.point_arc) >= 0).all()
    assert 0.0015 < scatter(trace.points, trace.centreline) < 0.0035  # radius 3 mm, noise 1 mm
    if known in ("both", "first"):
        np.testing.assert_allclose(trace.centreline[0], curve[0])
    if known in ("both", "last"):
        np.testing.assert_allclose(trace.centreline[-1], curve[-1])


@pytest.mark.parametrize("count", [60, 150, 400])
@pytest.mark.parametrize("name", ["helix", "s-curve", "vertical"])
def test_sparse_clouds_keep_their_tips(name: str, count: int) -> None:
    _, curve = SHAPES[name]
    points = curve[np.linspace(0, len(curve) - 1, count).astype(int)]
    trace = trace_cloud(points, UNKNOWN, None)
    assert trace.length == pytest.approx(1.0, abs=0.012)
    assert len(trace.points) >= count - 2


@pytest.mark.parametrize(("radius", "bias"), [(0.05, 1.5e-3), (0.1, 0.7e-3), (0.15, 0.5e-3)])
def test_bends_are_not_cut(radius: float, bias: float) -> None:
    arc, curve = bent(radius, np.pi)
    centre = curve[len(curve) // 2] + [0, 0, radius]
    found = []
    for seed in range(3):
        points, _ = cloud(arc, curve, 1400, np.random.default_rng(seed))
        line = trace_cloud(points, curve[[0, -1]], 1.0).centreline
        place, _ = project_to_polyline(line, curve)
        inside = abs(place / (len(curve) - 1) - 0.5) < 0.8 * radius * np.pi / 2
        found.append(np.linalg.norm(line[inside] - centre, axis=1).mean() - radius)
    assert abs(np.mean(found)) < bias


@pytest.mark.parametrize("name", ["helix", "s-curve", "vertical"])
@pytest.mark.parametrize("spread", [0.03, 0.1])
def test_outliers_a_gap_and_copies(name: str, spread: float) -> None:
    arc, curve = SHAPES[name]
    rng = np.random.default_rng(1)
    points, at = cloud(arc, curve, 1000, rng)
    stray = rng.random(1000) < 0.05
    points[stray] += spread * rng.normal(size=(stray.sum(), 3))
    points = points[(at < 0.3) | (at > 0.36)]
    points = np.concatenate([points, np.repeat(points[:60], 12, axis=0)])
    trace = trace_cloud(points, curve[[0, -1]], 1.0)
    away, error = errors(trace, arc, curve)
    assert np.median(away) < 1.2e-3
    assert away.max() < 8e-3  # the gap is bridged by a chord
    assert np.median(abs(error)) < 2e-3
    assert abs(error).max() < 6e-3
    assert ((trace.point_arc < 0.302) | (trace.point_arc > 0.358)).mean() > 0.99


def test_outliers_are_removed_and_little_else() -> None:
    arc, curve = SHAPES["s-curve"]
    rng = np.random.default_rng(2)
    points, _ = cloud(arc, curve, 1000, rng)
    strays = curve[::400] + np.array([0.0, 0.06, 0.0])
    kept = {tuple(p) for p in remove_outliers(np.concatenate([points, strays]))}
    assert not kept & {tuple(p) for p in strays}
    assert len(kept) > 990


def test_one_sided_clouds_move_to_the_axis() -> None:
    arc, curve = SHAPES["s-curve"]
    points, _ = cloud(arc, curve, 1400, np.random.default_rng(3), radius=0.006, eye=EYE)
    bias = []
    for radius in (None, 0.006):
        line = trace_cloud(points, curve[[0, -1]], 1.0, radius, EYE).centreline[5:-5]
        away = line - curve[nearest(curve, line)[1]]
        sight = EYE - line
        bias.append(np.mean((away * sight).sum(axis=1) / np.linalg.norm(sight, axis=1)))
    # Directions even over the half circle stand 2/π radii before the axis.
    assert bias[0] == pytest.approx(0.006 * 2 / np.pi, rel=0.15)
    assert bias[1] == pytest.approx(0.0, abs=1.5e-4)


def test_ropes_that_touch_or_cross_themselves_are_rejected() -> None:
    rng = np.random.default_rng(0)
    arc, curve = bent(0.05, 4.5)  # a loop
    with pytest.raises(FrameRejected, match="one line from end to end"):
        trace_cloud(cloud(arc, curve, 1400, rng)[0], curve[[0, -1]], 1.0)
    arc, curve = SHAPES["u-turn"]
    points, at = cloud(arc, curve, 1000, rng)
    hidden = (at > 0.3) & (at < 0.36)  # a gap wider than the legs are apart
    with pytest.raises(FrameRejected, match="one line from end to end"):
        trace_cloud(points[~hidden], curve[[0, -1]], 1.0)


def test_reasons_of_rejection() -> None:
    arc, curve = SHAPES["s-curve"]
    rng = np.random.default_rng(0)
    ends = curve[[0, -1]]
    for count in (0, 1, 19):
        with pytest.raises(FrameRejected, match="points after outlier removal"):
            trace_cloud(curve[:count], ends, 1.0)
    with pytest.raises(FrameRejected, match="points after outlier removal"):
        trace_cloud(np.zeros((500, 3)), ends, 1.0)  # all the same
    clumps = rng.normal(size=(MOST_PIECES + 5, 1, 3)) + 1e-4 * rng.normal(size=(1, 12, 3))
    with pytest.raises(FrameRejected, match="separate pieces"):
        trace_cloud(clumps.reshape(-1, 3), UNKNOWN, None)
    points, _ = cloud(arc, curve, 1000, rng)
    with pytest.raises(FrameRejected, match=r"line through the points is .* m long, the rope 2 m"):
        trace_cloud(points, ends, 2.0)


def test_ends_stay_in_order_over_frames() -> None:
    class WithoutEnds:
        class recording:
            class source:
                table = "clouds"

    arc, curve = SHAPES["s-curve"]
    traces = []
    for frame in range(6):
        mirror = np.array([(-1.0) ** frame, 1, 1])
        # Mirrored frames begin at the other end; undo the mirror after tracing.
        shape = (curve + np.array([0.02 * frame, 0, 0])) * mirror
        points, _ = cloud(arc, shape, 500, np.random.default_rng(frame))
        t = trace_cloud(points, UNKNOWN, None)
        traces.append(
            Trace(t.points * mirror, t.point_arc, t.centreline * mirror, t.arc, t.length, t.reach)
        )
    assert len({t.centreline[0, 0] > 0.4 for t in traces}) == 2  # both orders came in
    ends = _ends_seen(traces, WithoutEnds())  # type: ignore[arg-type]
    assert (np.linalg.norm(np.diff(ends, axis=0), axis=2) < 0.04).all()
    for t, end in zip(traces, ends, strict=True):
        np.testing.assert_array_equal(t.centreline[[0, -1]], end)
        assert (np.diff(t.point_arc) >= 0).all()
        assert np.linalg.norm(t.points[0] - end[0]) < 0.02
        assert t.arc[0] == pytest.approx(0)
        assert (np.diff(t.arc) >= 0).all()


def test_order_of_the_points_is_nothing() -> None:
    for name, (arc, curve) in SHAPES.items():
        rng = np.random.default_rng(5)
        points = np.round(cloud(arc, curve, 600, rng)[0], 3)  # whole millimetres: ties
        ends = ends_of(curve, "both" if name == "u-turn" else "none")
        one, other = (trace_cloud(p, ends, 1.0) for p in (points, rng.permutation(points)))
        np.testing.assert_allclose(one.points, other.points, atol=1e-9)
        np.testing.assert_allclose(one.point_arc, other.point_arc, atol=1e-9)
        np.testing.assert_allclose(one.centreline, other.centreline, atol=1e-9)


@given(
    st.sampled_from(sorted(SHAPES)),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-2, 2)] * 3),
    st.sampled_from([0.25, 1.0, 3.0]),
)
@settings(max_examples=12, derandomize=True, deadline=None, phases=PHASES)
def test_moving_and_scaling(
    name: str, turn: tuple[float, ...], shift: tuple[float, ...], scale: float
) -> None:
    arc, curve = SHAPES[name]
    points, _ = cloud(arc, curve, 500, np.random.default_rng(4), eye=EYE)
    rotation = Rotation.from_rotvec(turn)

    def moved(x: np.ndarray) -> np.ndarray:
        return scale * (rotation.apply(x) + shift)

    ends, eye = curve[[0, -1]], EYE[None]
    here = trace_cloud(points, ends, 1.0, 0.003, EYE, most=1000)
    there = trace_cloud(moved(points), moved(ends), scale, scale * 0.003, moved(eye)[0], most=1000)
    # Points that share a vertex of the centreline may come in either order.
    assert len(there.points) == len(here.points)
    assert nearest(moved(here.points), there.points)[0].max() < 1e-7
    np.testing.assert_allclose(there.centreline, moved(here.centreline), atol=1e-7)
    np.testing.assert_allclose(there.point_arc, scale * here.point_arc, atol=1e-7)
    assert there.reach == pytest.approx(scale * here.reach)
