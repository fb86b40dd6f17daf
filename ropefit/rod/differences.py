"""Central differences of a setup's parts in one value, which are cheap and smooth."""

from __future__ import annotations

import numpy as np

from ropefit.rod.quaternion import conjugate_product
from ropefit.rod.sensor import SensorModel
from ropefit.rod.setup import Setup

DIFFERENCE_STEP = 1e-5
SMALL_ERRORS = {"rotation", "gain", "shift", "depth"}  # of a sensor, in which it is linear


def sensor_slope(a: Setup, b: Setup, x: np.ndarray) -> np.ndarray:
    """Return (F, K, 3) the central difference of what is seen of nodes x that stay; (1,) zero where
    the sensor does not change. Of the small errors, which are linear, the difference is exact."""
    if a.sensor is b.sensor:
        return np.zeros(1)
    pairs = zip(SensorModel._fields, a.sensor, b.sensor, strict=True)
    changed = {name for name, p, q in pairs if not (p is q or np.array_equal(p, q))}
    if not changed:
        return np.zeros(1)
    if not changed <= SMALL_ERRORS or a.sensor.flat.any():
        return slope(a.sensor(x), b.sensor(x))
    fields = {
        name: slope(getattr(a.sensor, name), getattr(b.sensor, name)) for name in SMALL_ERRORS
    }
    return a.sensor._replace(**fields).errors(a.sensor.nodes(x))


def turn_slope(now: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return (F, 2, 3) central difference of clamps (F, 2, 4) as turns about their own axes
    `now`."""
    if before is after or np.array_equal(before, after, equal_nan=True):
        return np.zeros((*now.shape[:-1], 3))
    turns = (conjugate_product(now, clamp)[..., 1:] for clamp in (before, after))
    return 2 * slope(*turns)


def slope(before: np.ndarray | float, after: np.ndarray | float) -> np.ndarray:
    """Return the central difference; zero where the values are not finite."""
    with np.errstate(invalid="ignore"):
        out = np.asarray((after - before) / (2 * DIFFERENCE_STEP))
    return out if np.isfinite(out).all() else np.nan_to_num(out, posinf=0.0, neginf=0.0)
