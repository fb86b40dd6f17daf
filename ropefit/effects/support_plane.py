"""A plane that the rope lies on in some frames: a table, the floor, a slope."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit import attachments as records
from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.contact import (
    NO_SPREAD,
    Contact,
    bears_most,
    has_free_end,
    touching,
    up_and_normal,
    up_of,
    with_body,
    with_contact,
)
from ropefit.effects.drawn import Drawn
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import horizontal, middle_of
from ropefit.effects.stopped import lowest_level
from ropefit.rod.fields import PLANE
from ropefit.rod.setup import Setup

PENETRATION_SD = 2.0  # noise sd by which the fitted rope must sink below the lowest data
STEEPEST = 0.5  # slope
LOWEST_SHARE = 0.05  # quantile of the frames' lowest points, at which the plane is proposed


class SupportPlane(Contact):
    """A frictionless half space: `height` [m] against the middle of the ends, against gravity, and
    its slope [1] along the two horizontal axes."""

    name = "support_plane"
    nearly_zero = ("slope_1", "slope_2")  # tables are level
    quantities = (
        Quantity("height", "m", 0.1, by_length=1.0),
        Quantity("slope_1", "1", 0.02, -STEEPEST, STEEPEST),
        Quantity("slope_2", "1", 0.02, -STEEPEST, STEEPEST),
    )

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        up, normal = up_and_normal(setup, values[1], values[2])
        origin = middle_of(setup) + values[0] * up
        if setup.damping is not None:  # in motion: part of every step
            return with_body(setup, origin, normal, 0.0, PLANE)

        def gap(x: np.ndarray) -> np.ndarray:
            return (x - origin) @ normal

        flat = np.zeros(())
        return with_contact(setup, gap, touching(setup.segments), lambda x: (normal, flat))

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Propose the level of the lowest data, where the fitted rope sinks below it."""
        if has_free_end(misfit) or self.name in misfit.terms or len(misfit.frame) == 0:
            return []
        if misfit.setup.damping is not None:
            level = lowest_level(misfit)
            return [] if level is None else [[np.array([level, 0.0, 0.0])]]
        up, origin = up_of(misfit.setup), middle_of(misfit.setup)
        model = np.einsum("fka,a->fk", misfit.nodes - origin, up)
        height = (misfit.places + misfit.moves - origin) @ up
        noise = float(np.sqrt(misfit.variance / 2)) + NO_SPREAD
        lowest, points = _lowest(misfit, height), _lowest_points(misfit, origin, up)
        points = np.where(np.isfinite(points), points, lowest)[np.isfinite(lowest)]
        lowest = lowest[np.isfinite(lowest)]
        floor, least = float(np.quantile(lowest, LOWEST_SHARE)), PENETRATION_SD * noise
        if model.min() > floor - least:
            return []
        # Stations of a rope that sinks deep are matched to wrong places, lower than any point is.
        above = np.maximum(lowest, points - np.median(points - lowest))
        level = float(np.quantile(above, LOWEST_SHARE))
        return [[np.array([level if level > floor + least else floor, 0.0, 0.0])]]

    def starts_beside(
        self, leader: Effect, values: np.ndarray, misfit: Misfit
    ) -> list[list[np.ndarray]]:
        """Propose the plane that touches a bar where that bears the rope: in few frames they do
        the same, and under all data there may be none."""
        borne = leader.borne(values, misfit)
        if borne is None or isinstance(leader, SupportPlane) or misfit.setup.damping is not None:
            return []
        (place, normal), up = borne, up_of(misfit.setup)
        slopes = [-float(normal @ axis) for axis in horizontal(misfit.setup.gravity)]
        rise = max(float(normal @ up), 1e-9)
        tangent = np.array([float(place @ normal), *slopes]) / rise
        level = np.array([float(place @ up), 0.0, 0.0])
        return [[tangent, level] if np.abs(tangent[1:]).max() < STEEPEST else [level]]

    def borne(self, values: np.ndarray, misfit: Misfit) -> tuple[np.ndarray, np.ndarray] | None:
        up, normal = up_and_normal(misfit.setup, values[1], values[2])
        place = misfit.nodes - middle_of(misfit.setup)
        depth = np.nan_to_num(np.maximum(-((place - values[0] * up) @ normal), 0.0))
        found = bears_most(depth, place)
        return None if found is None else (found[1], normal)

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        up, origin = up_of(setup), middle_of(setup)
        first, second = horizontal(setup.gravity)
        normal = up - values["slope_1"] * first - values["slope_2"] * second
        point = origin + values["height"] * up
        return Exported((*beside, records.Plane(records.vector(point), records.vector(normal))))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"in some frames the rope lies on a plane {abs(values['height']):.3f} m "
            f"{'below' if values['height'] < 0 else 'above'} the middle of its ends"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        first, second = horizontal(gravity)
        up = -gravity / np.linalg.norm(gravity)
        normal = up - values["slope_1"] * first - values["slope_2"] * second
        return Drawn("plane", normal, values["height"] * up, label="plane")


def _lowest(misfit: Misfit, height: np.ndarray) -> np.ndarray:
    """Return (F,) the least of the heights (M,) of each frame's stations; inf without any."""
    mine = [misfit.frame == t for t in range(len(misfit.nodes))]
    return np.array([height[m].min() if m.any() else np.inf for m in mine])


def _lowest_points(misfit: Misfit, origin: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return (F,) the height [m] over `origin` of each frame's lowest point; inf without any."""
    height = (misfit.points - origin) @ up
    return np.where(misfit.counts, height, np.inf).min(axis=1)
