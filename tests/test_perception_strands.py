"""Skeletons taken apart and linked: golden paths, crossings, gaps, clutter, and any picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ropefit.perception.linking import link
from ropefit.perception.segment import Looked, segment_rope
from ropefit.perception.strands import MOST_LINES, find_strands
from ropefit.perception.trace import FrameRejected
from tests.ropecloud import nearest
from tests.test_perception_images import GROUND, NOWHERE, ORANGE, SIZE, draw, drawn_mask, wave


def loop() -> np.ndarray:
    """(N, 2) [px] a path that crosses itself once, by about a right angle."""
    t = np.linspace(-1.0, 1.0, 3000)
    return np.column_stack([180 + 130 * (1.6 * t**3 - 0.75 * t), 60 + 150 * (1 - t**2) * 0.9])


@pytest.mark.parametrize("width", [3, 5, 12])
def test_one_strand(width: int) -> None:
    mask = drawn_mask(wave(), width=width)
    found = find_strands(mask)
    assert found is not None
    assert len(found.lines) == 1
    length = np.linalg.norm(np.diff(wave(), axis=0), axis=1).sum()
    assert found.width == pytest.approx(mask.sum() / length, abs=2)
    away, _ = nearest(wave(), found.lines[0])
    assert np.median(away) < 0.6
    assert away.max() < 1.5 + width / 8


@pytest.mark.parametrize(("apart", "follows"), [(12, True), (5, False)], ids=["dashes", "grain"])
def test_the_grain_of_a_surface_is_not_followed(apart: int, follows: bool) -> None:
    mask = np.zeros((240, 360), bool)
    for shift in range(4):
        mask[4:-4:apart, 4 + shift : -4 : 9] = True  # dashes of 4 px
    found = find_strands(mask)
    assert (found is not None) == follows
    assert found is None or 700 < len(found.lines) <= MOST_LINES


def test_golden_skeleton() -> None:
    """The wave's skeleton at seven places, against the curve that was drawn."""
    found = find_strands(drawn_mask(wave()))
    assert found is not None
    line = found.lines[0] if found.lines[0][0, 0] < 100 else found.lines[0][::-1]
    rows = np.interp([60, 100, 140, 180, 220, 260, 300], line[:, 0], line[:, 1])
    golden = 120 + 60 * np.sin(np.array([60, 100, 140, 180, 220, 260, 300]) / 50)
    np.testing.assert_allclose(rows, golden, atol=1.0)


def test_a_crossing_is_followed_straight_on() -> None:
    found = find_strands(drawn_mask(loop(), width=5))
    assert found is not None
    ends = loop()[[0, -1]]
    paths = link(found.lines, found.width, ends)
    away, index = nearest(loop(), paths[0].points)
    assert away.max() < 4
    # Along the whole of it, in order, but where the strands lie on each other.
    steps = np.diff(index[(away < 2)])
    assert (steps > -30).mean() > 0.98
    assert np.ptp(index) > 2900
    assert paths[0].length == pytest.approx(
        np.linalg.norm(np.diff(loop(), axis=0), axis=1).sum(), rel=0.03
    )


def test_gaps_are_bridged_and_marked() -> None:
    mask = drawn_mask(wave())
    mask[:, 150:190] = False
    found = find_strands(mask)
    assert found is not None
    path = link(found.lines, found.width, NOWHERE)[0]
    inside = (path.points[:, 0] > 153) & (path.points[:, 0] < 187)
    assert not path.seen[inside].any()
    assert path.seen[~inside].mean() > 0.95
    away, _ = nearest(wave(), path.points)
    assert away.max() < 5
    assert path.bridged == 1


def test_spurs_and_clutter_stay_out() -> None:
    spur = np.linspace([180.0, 95.0], [184.0, 84.0], 40)
    mask = drawn_mask(wave(), spur)
    cv2.rectangle(view := mask.astype(np.uint8), (20, 200), (60, 235), 1, -1)
    found = find_strands(view > 0)
    assert found is not None
    path = link(found.lines, found.width, wave()[[0, -1]])[0]
    away, _ = nearest(wave(), path.points)
    assert np.percentile(away, 99) < 3


def test_overrides() -> None:
    image = np.full((*SIZE, 3), GROUND, np.uint8)
    other = np.column_stack([np.linspace(30, 330, 500), 220 + 8 * np.sin(np.linspace(0, 6, 500))])
    draw(image, wave(), ORANGE, 5)
    draw(image, other, (30, 60, 190), 5)
    by_color = segment_rope(image, NOWHERE, None, Looked(color=(30, 60, 190)))
    assert nearest(other, by_color.path)[0].max() < 3
    by_roi = segment_rope(image, NOWHERE, None, Looked(roi=(0, 195, 360, 45)))
    assert nearest(other, by_roi.path)[0].max() < 3
    by_mask = segment_rope(image, NOWHERE, None, Looked(mask=drawn_mask(wave())))
    assert nearest(wave(), by_mask.path)[0].max() < 3
    assert by_mask.cue == "the given mask"
    with pytest.raises(FrameRejected, match="mask is empty"):
        segment_rope(image, NOWHERE, None, Looked(mask=np.zeros(SIZE, bool)))


@given(
    st.integers(1, 90),
    st.integers(1, 90),
    st.sampled_from(["noise", "flat", "stripes", "blocks", "half"]),
    st.integers(0, 2**31),
)
@settings(max_examples=30, derandomize=True, deadline=None)
def test_no_picture_crashes(height: int, width: int, kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    if kind == "flat":
        image[:] = image[0, 0]
    elif kind == "stripes":
        image[:] = image[:, :1]
    elif kind == "blocks":
        image = np.repeat(np.repeat(image[::4, ::4], 4, 0), 4, 1)[:height, :width].copy()
    elif kind == "half":
        image[: height // 2] = 0
    depth = rng.random((height, width)) * (rng.random((height, width)) < 0.7)
    ends = rng.uniform(-5, 95, (2, 2)) if seed % 2 else NOWHERE
    for given_depth in (None, depth):
        try:
            found = segment_rope(image, ends, given_depth)
        except FrameRejected:
            continue
        assert np.isfinite(found.path).all()
        assert found.mask.shape == (height, width)
        assert len(found.path) == len(found.seen)
        assert 0 <= found.confidence <= 1
