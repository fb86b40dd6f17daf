"""Where data stop that a fitted rope goes on, in motion: what contact is proposed from.

A rope that swings touches a body in other frames than the fitted one goes through it. All frames
together show the space that the data never enter: below their lowest places, or a round hole.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ropefit.effects.contact import up_of
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import middle_of

LEAST_SHARE = 0.02  # of the squared misfit that a body must remove where it is touched
# The same of one that the fitted rope enters deeply, by this share of its length: most of what it
# does comes after it was touched.
DEEP, LEAST_SHARE_DEEP = 0.02, 0.002
PLACES = 25  # tried, of a bar across the rope
RADII = (0.05, 0.02)  # m, of a bar, tried

Gap = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def removed(misfit: Misfit, gap: Gap) -> float:
    """Return the share of the squared misfit that goes where the fitted rope is pushed out of a
    body; gap(x (M, 3)): (M,) [m], negative inside, and its slope (M, 3)."""
    inside, normal = gap(misfit.places)
    left = misfit.moves + np.minimum(inside, 0.0)[:, None] * normal
    return 1 - float((left**2).sum() / max((misfit.moves**2).sum(), 1e-300))


def lowest_level(misfit: Misfit) -> float | None:
    """Return the height [m] of a plane under all data, against the middle of the ends; None where
    the fitted rope is not stopped by it."""
    if not len(misfit.frame):
        return None
    up, origin = up_of(misfit.setup), middle_of(misfit.setup)
    floor = float(((misfit.places + misfit.moves - origin) @ up).min())

    def gap(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (x - origin) @ up - floor, np.broadcast_to(up, x.shape)

    return floor if removed(misfit, gap) > LEAST_SHARE else None


def bars_below(misfit: Misfit, axis: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Return centres (3,) [m] against the middle of the ends, and radii [m], of horizontal bars
    along `axis` (3,) that no data enter and that stop the fitted rope; the best of each radius."""
    if not len(misfit.frame):
        return []
    up, origin = up_of(misfit.setup), middle_of(misfit.setup)
    side = np.cross(up, axis)
    data, length = misfit.places + misfit.moves - origin, float(misfit.setup.arc[-1])
    across, height = data @ side, data @ up
    out = []
    for radius in RADII:
        best, found = 0.0, None
        for place in np.linspace(across.min(), across.max(), PLACES):
            near = np.abs(across - place) < radius
            if not near.any():
                continue
            rise = np.sqrt(radius**2 - (across[near] - place) ** 2)
            centre = place * side + float((height[near] - rise).min()) * up
            gap = _around(origin + centre, side, up, radius)
            share = removed(misfit, gap)
            deep = -gap(misfit.places)[0].min() > DEEP * length
            if share > max(best, LEAST_SHARE_DEEP if deep else LEAST_SHARE):
                best, found = share, centre
        if found is not None:
            out.append((found, radius))
    return out


def _around(centre: np.ndarray, side: np.ndarray, up: np.ndarray, radius: float) -> Gap:
    """Return the gap of a bar through a centre (3,) across two axes (3,)."""

    def gap(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        arm = ((x - centre) @ side)[:, None] * side + ((x - centre) @ up)[:, None] * up
        far = np.linalg.norm(arm, axis=1)
        return far - radius, arm / np.maximum(far, 1e-9)[:, None]

    return gap
