"""Chains of strands against all there are; strands, looks and edges where depth tells."""

from __future__ import annotations

from itertools import permutations, product

import cv2
import numpy as np
import pytest

from ropefit.perception.camera import Camera
from ropefit.perception.chaining import WORTH, best_chain
from ropefit.perception.cues import NO_DEPTH, nearness
from ropefit.perception.follow import even
from ropefit.perception.linking import link
from ropefit.perception.looks import learn
from ropefit.perception.rgbd import centred, check_length
from ropefit.perception.segment import Segmentation, segment_rope
from ropefit.perception.strands import cut_at_jumps
from ropefit.perception.trace import FrameRejected
from tests.ropecloud import nearest
from tests.test_perception_images import GROUND, NOWHERE, ORANGE, SIZE, draw, drawn_mask, wave
from tests.test_perception_strands import loop

WALL, ROPE = 1.0, 0.7  # m


def value(chain, cost, length, first, last) -> float:
    """What a chain [(piece, reversed)] is worth, by the book."""
    enter = [2 * piece + flipped for piece, flipped in chain]
    leave = [tip ^ 1 for tip in enter]
    links = sum(cost[a, b] for a, b in zip(leave, enter[1:], strict=False))
    return WORTH * sum(length[p] for p, _ in chain) - links - first[enter[0]] - last[leave[-1]]


@pytest.mark.parametrize("seed", range(6))
def test_best_chain_is_the_best_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 4
    cost = rng.uniform(0, 60, (2 * count, 2 * count))
    cost[rng.random(cost.shape) < 0.2] = np.inf
    length = rng.uniform(1, 20, count)
    first, last = rng.uniform(0, 30, (2, 2 * count))
    chains = [
        list(zip(order, flips, strict=True))
        for many in range(1, count + 1)
        for order in permutations(range(count), many)
        for flips in product((False, True), repeat=many)
    ]
    best = max(value(chain, cost, length, first, last) for chain in chains)
    found = best_chain(cost, length, first, last)
    assert value(found, cost, length, first, last) == pytest.approx(best)
    assert best_chain(np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0)) == []


def test_a_loop_whose_top_is_hidden() -> None:
    """Where the rope turns back behind something, no link by itself looks likely."""
    curve = 3 * loop()
    t = np.linspace(-1, 1, len(curve))
    parts = [(-1, -0.72), (0.33, 0.65), (-0.65, -0.33), (0.72, 1)]
    lines = [even(curve[(t >= low) & (t <= high)], 1.0) for low, high in parts]
    path = link(lines, 4.0, curve[[0, -1]])[0]
    for line in lines:
        assert nearest(path.points, line)[0].max() < 1
    assert path.bridged == 5
    places = nearest(curve, path.points[path.seen])[1]
    assert (np.diff(places) >= 0).all()  # once around, the way the rope goes


def test_strands_are_cut_where_depth_jumps() -> None:
    line = np.column_stack([np.arange(100.0), np.full(100, 20.0)])
    depth = np.full((40, 100), ROPE)
    depth[:, 60:] = 0.5
    depth[:, ::7] = 0  # holes are no jumps
    parts = cut_at_jumps([line], depth, 5.0)
    assert [len(part) > 30 for part in parts] == [True, True]
    assert parts[0][-1, 0] < 61 < parts[1][0, 0] + 3
    slope = np.linspace(0.6, 0.9, 100) + np.zeros((40, 1))
    np.testing.assert_array_equal(cut_at_jumps([line], slope, 5.0)[0], line)
    np.testing.assert_array_equal(cut_at_jumps([line], np.zeros((40, 100)), 5.0)[0], line)


def scene() -> tuple[np.ndarray, np.ndarray]:
    """A rope before a wall, and on the wall a thing of its colour."""
    image = np.full((*SIZE, 3), GROUND, np.uint8)
    cv2.rectangle(image, (150, 190), (250, 230), ORANGE, -1)
    draw(image, wave(), ORANGE, 5)
    return image, np.where(drawn_mask(wave()), ROPE, WALL)


def test_nearness() -> None:
    _, depth = scene()
    depth[:4] = 0
    near = nearness(depth)
    assert (near[:4] == NO_DEPTH).all()
    assert abs(int(np.median(near[drawn_mask(wave())])) - 300) <= 1
    assert np.median(near[100:][~drawn_mask(wave(), width=9)[100:]]) == 0


def test_looks_are_of_colour_and_depth_together() -> None:
    image, depth = scene()
    rope = drawn_mask(wave())
    by_both = learn(image, nearness(depth), rope, wave(), 5.0, 1.0).mask(image, nearness(depth))
    by_colour = learn(image, None, rope, wave(), 30.0, 1.0).mask(image)
    assert by_both[rope].mean() > 0.9
    assert not by_both[195:225, 155:245].any()
    assert by_colour[195:225, 155:245].mean() > 0.9  # colour alone cannot tell


def test_a_shaded_side_is_rope_too() -> None:
    """Half of the rope is as dark as the ground: its middle is where depth says."""
    curve = np.column_stack([np.linspace(40.0, 320, 600), np.linspace(120.0, 130, 600)])
    image = np.full((*SIZE, 3), 120, np.uint8)
    draw(image, curve - [0, 2.5], (230, 230, 230), 5)
    depth = np.where(drawn_mask(curve, width=10), ROPE, WALL)
    camera = Camera(SIZE[1], SIZE[0], 350.0, 350.0, 180.0, 120.0, np.eye(4))
    path = curve - [0, 2.0]
    found = Segmentation(drawn_mask(path), path, np.ones(len(path), bool), 6.0, 1.0, "drawn")
    off = {}
    for radius, given in ((0.01, depth), (0.01, np.zeros(SIZE)), (None, np.zeros(SIZE))):
        moved, _ = centred(image, given, found, camera, radius)
        off[radius, bool(given.any())] = abs(np.median(nearest(curve, moved)[0]))
    assert off[0.01, True] < 0.8
    assert off[None, False] > 1.5


def test_several_ropes_are_told() -> None:
    image = np.full((*SIZE, 3), GROUND, np.uint8)
    other = np.column_stack([np.linspace(30, 330, 500), 220 + 8 * np.sin(np.linspace(0, 6, 500))])
    draw(image, wave(), ORANGE, 5)
    assert not segment_rope(image, NOWHERE).several
    draw(image, other, (30, 60, 190), 5)
    assert segment_rope(image, NOWHERE).several
    assert not segment_rope(image, wave()[[0, -1]]).several  # its ends say which


def test_lines_of_another_length_are_refused() -> None:
    check_length(1.02, 1.0, True)
    check_length(0.4, 1.0, False)  # part of the rope may be hidden where its ends are not known
    check_length(1.9, None, False)
    for traced, between in ((0.6, True), (1.9, True), (1.9, False)):
        with pytest.raises(FrameRejected, match="wrong turn"):
            check_length(traced, 1.0, between)
