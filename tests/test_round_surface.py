"""Where the axis of a round rope is, from points on the surface that a sensor sees."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.inference.round_surface import axis, information

STATIONS, EACH = 800, 9
LATERAL = 2e-4  # m


def scanned(
    radius: float, sd: float, seen: tuple[float, float] = (-0.97, 0.97), wild: float = 0.01
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of axes (M, 2) [m], points (N, 2) on the surface that is seen, and their stations."""
    rng = np.random.default_rng(3)
    station = np.repeat(np.arange(STATIONS), EACH)
    place = 0.003 * rng.normal(size=(STATIONS, 2))
    u = radius * rng.uniform(*seen, len(station))
    points = place[station] + np.stack([u, -np.sqrt(radius**2 - u**2)], axis=1)
    points += rng.normal(size=points.shape) * [LATERAL, sd]
    far = rng.random(len(points)) < wild
    points[far] += 0.03 * rng.normal(size=(int(far.sum()), 2))
    return place, points, station


def spread(values: np.ndarray) -> np.ndarray:
    """Robust sd of columns."""
    return 1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0)


@pytest.mark.parametrize(("radius", "sd"), [(0.0026, 0.0008), (0.004, 0.001), (0.002, 0.0015)])
def test_depths_tell_where_the_axis_is_sideways(radius: float, sd: float) -> None:
    place, points, station = scanned(radius, sd)
    found, count, variance, fall = axis(points, station, STATIONS, radius)
    off = spread(found - place)
    across = 0.56 * radius / np.sqrt(EACH)  # as a mean over the width would be
    assert off[0] < (1.0 if sd > 0.5 * radius else 0.7) * across
    assert 0.8 * sd < np.sqrt(variance[1]) < 1.2 * sd
    side, both, deep = information(count, fall, np.broadcast_to(variance, (STATIONS, 2)))
    expected = np.stack([deep, side], axis=1) / (side * deep - both**2)[:, None]
    pull = spread((found - place) / np.sqrt(expected))
    assert (pull > 0.85).all()
    assert (pull < 1.15).all()
    assert np.abs(np.median(found - place, axis=0)).max() < 0.1 * sd


def test_one_flank_alone_pulls_less() -> None:
    """Where half of the rope is in shadow, the mean of its points lies to the side; the surface
    says otherwise."""
    radius, sd = 0.005, 0.0007
    place, points, station = scanned(radius, sd, seen=(-0.1, 0.97))
    found = axis(points, station, STATIONS, radius)[0]
    assert np.median(found[:, 0] - place[:, 0]) < 0.75 * 0.435 * radius
    mean = axis(points, station, STATIONS, 0.0)[0]
    assert np.median(mean[:, 0] - place[:, 0]) > 0.9 * 0.435 * radius


def test_points_on_the_axis_are_averaged() -> None:
    _, points, station = scanned(0.002, 0.001, seen=(0.0, 1e-9), wild=0.0)
    points[:, 1] += 0.002
    found, count, _, fall = axis(points, station, STATIONS, 0.0)
    means = np.stack([np.bincount(station, c, STATIONS) / EACH for c in points.T], axis=1)
    assert spread(found - means).max() < 0.3 * 0.001 / np.sqrt(EACH)
    assert not fall.any()
    assert (count <= EACH).all()


def test_one_point_far_off_does_not_move_an_axis_of_three() -> None:
    """The two others must not be taken for points on the flank of a surface far away."""
    radius, sd = 0.005, 0.0007
    place, points, station = scanned(radius, sd, wild=0.0)
    few = np.flatnonzero(station == 0)[:3]
    points[few] = place[0] + np.array([[0.0, -radius], [0.001, -radius], [-0.019, -radius - 0.009]])
    kept = np.sort(np.r_[few, np.flatnonzero(station > 0)])
    found = axis(points[kept], station[kept], STATIONS, radius)[0]
    assert np.linalg.norm(found[0] - place[0]) < 3 * sd
