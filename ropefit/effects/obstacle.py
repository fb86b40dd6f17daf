"""A fixed round bar or edge that the rope touches in some frames, without friction."""

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
    up_of,
    with_body,
    with_contact,
)
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import horizontal, middle_of
from ropefit.effects.stopped import bars_below
from ropefit.effects.support_plane import SupportPlane
from ropefit.rod.fields import BAR
from ropefit.rod.setup import Setup

PUSHED_SHARE = 0.1  # of the strongest push: others with less may be what distorts a frame
EXCESS_SD = 3.0  # standard errors by which a frame must be worse than usual to show a bar
LIFT_SD = 2.5  # standard errors of the mean lift that makes a bar worth a fit
LIFTED_SHARE = 0.7  # of the greatest lift: stations on the bar
SMOOTHING = np.full(5, 0.2)  # weights of neighbouring stations in a mean lift
RADII = (0.03, 0.01)  # m, tried: over a thick bar a rope comes to lie from farther away
LOWERED = (0.0, 0.001, 0.002, 0.004, 0.006)  # m below the data, tried until the rope settles
ASIDE = 0.02  # m, to either side of a bar that was fitted: another is tried
TINY = 1e-16  # m²: keeps the distance from the axis smooth
EXPORTED_LENGTH = 2.0  # m, of a bar that the model takes as endless


class Obstacle(Contact):
    """A frictionless round bar of `radius` [m] through a point (x, y, z) [m] against the middle of
    the ends; its axis is horizontal, at `heading` [rad] from the first horizontal axis."""

    name = "obstacle"
    quantities = (
        *(Quantity(axis, "m", 0.1, by_length=1.0) for axis in "xyz"),
        Quantity("radius", "m", 0.02, 0.0, 0.2),
        Quantity("heading", "rad", 0.3, -3.2, 3.2),
    )

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        first, second = horizontal(setup.gravity)
        axis = np.cos(values[4]) * first + np.sin(values[4]) * second
        origin = middle_of(setup) + values[:3]
        radius = values[3]

        if setup.damping is not None:  # in motion: part of every step
            return with_body(setup, origin, axis, radius, BAR)

        side = np.cos(values[4]) * second - np.sin(values[4]) * first
        plane = np.stack([side, np.cross(first, second)], axis=1)  # across the bar

        def across(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            way = (x - origin) @ plane
            return way, np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2 + TINY)

        def shape(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            way, far = across(x)
            normal = (way / far[..., None]) @ plane.T
            square = normal[..., :, None] * normal[..., None, :]
            return normal, (plane @ plane.T - square) / far[..., None, None]

        # A bar touches few nodes: every one of them may be among these.
        every = np.ones(setup.segments + 1)
        return with_contact(setup, lambda x: across(x)[1] - radius, every, shape)

    def start_sd(self, setup: Setup) -> np.ndarray:
        """Hold the bar near its start: along itself it could slide freely."""
        return np.array([q.size(setup) for q in self.quantities])

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Propose the place in space where the rope is pushed; else where it is lifted."""
        if has_free_end(misfit):
            return []
        if misfit.setup.damping is not None:
            return self._starts_in_motion(misfit)
        pushed, lifted = self._starts_where_pushed(misfit), self._starts_where_lifted(misfit)
        return [choices for choices in (pushed + lifted,) if choices]

    def _starts_in_motion(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Propose bars that no data enter in any frame, and that would stop the fitted rope."""
        if self.name in misfit.terms or len(misfit.frame) == 0:
            return []
        heading = heading_across(misfit.setup)
        axis = _axis(misfit.setup, heading)
        return [
            [np.array([*centre, radius, heading])] for centre, radius in bars_below(misfit, axis)
        ]

    def _starts_where_pushed(self, misfit: Misfit) -> list[np.ndarray]:
        """Propose a bar where single forces explain the frames that stand out."""
        found = misfit.pushes()
        found = [push for push in found if push.gain > PUSHED_SHARE * found[0].gain]
        if not found:
            return []
        setup, heading = misfit.setup, heading_across(misfit.setup)
        places = np.array([push.place for push in found]) - middle_of(setup)
        away = np.array([_across(setup, heading, push.force) for push in found])
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        weight = np.array([push.gain for push in found])
        out = []
        for which in (slice(None), slice(1)):  # the axis behind all places, or behind the first
            for radius in RADII:
                for below in LOWERED:
                    axis = places[which] - (radius + below) * away[which]
                    centre = np.average(axis, axis=0, weights=weight[which])
                    out.append(np.array([*centre, radius, heading]))
        return out

    def _starts_where_lifted(self, misfit: Misfit) -> list[np.ndarray]:
        """Propose the place in space where the data of bad frames lie above the fitted rope."""
        up, origin = up_of(misfit.setup), middle_of(misfit.setup)
        data, lift = misfit.places + misfit.moves, np.zeros(len(misfit.frame))
        for t in np.flatnonzero(misfit.excess > EXCESS_SD):
            mine = misfit.frame == t
            if mine.sum() >= len(SMOOTHING):
                lift[mine] = np.convolve(misfit.moves[mine] @ up, SMOOTHING, mode="same")
        noise = float(np.sqrt(misfit.variance)) + NO_SPREAD
        if lift.max() < LIFT_SD * noise * np.linalg.norm(SMOOTHING):
            return []
        lifted = lift > LIFTED_SHARE * lift.max()
        centre = np.average(data[lifted], axis=0, weights=lift[lifted])
        away = np.average(misfit.moves[lifted], axis=0, weights=lift[lifted])
        away /= np.linalg.norm(away)  # of a steep rope not upwards
        heading = heading_across(misfit.setup)
        tried = [(way, r, r + d) for way in (away, up) for r in RADII for d in LOWERED]
        return [np.array([*(centre - origin - d * way), r, heading]) for way, r, d in tried]

    def starts_beside(
        self, leader: Effect, values: np.ndarray, misfit: Misfit
    ) -> list[list[np.ndarray]]:
        """Propose bars where a plane bears the rope: few frames on a bar fit a slope nearly too.
        Beside a bar, propose it to either side: frames in which it is not touched do not pull it
        there."""
        found = leader.borne(values, misfit)
        if isinstance(leader, SupportPlane) and found is not None:
            (centre, normal), heading = found, heading_across(misfit.setup)
            return [[np.array([*(centre - r * normal), r, heading])] for r in RADII]
        if isinstance(leader, Obstacle) and found is not None:
            across = np.cross(up_of(misfit.setup), _axis(misfit.setup, values[4]))
            aside = np.array([*(ASIDE * across), 0.0, 0.0])
            return [[values - aside], [values + aside]]
        return []

    def borne(self, values: np.ndarray, misfit: Misfit) -> tuple[np.ndarray, np.ndarray] | None:
        heading, radius = values[4], values[3]
        place = misfit.nodes - middle_of(misfit.setup)
        axis = _axis(misfit.setup, heading)
        arm = place - values[:3]
        arm = arm - (arm @ axis)[..., None] * axis
        depth = np.nan_to_num(np.maximum(radius - np.linalg.norm(arm, axis=-1), 0.0))
        found = bears_most(depth, place)
        if found is None:
            return None
        frame, centre = found
        normal = np.average(arm[frame], axis=0, weights=depth[frame])
        return centre, normal / np.linalg.norm(normal)

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        axis = _axis(setup, values["heading"])
        middle = middle_of(setup) + np.array([values[k] for k in "xyz"])
        half = EXPORTED_LENGTH / 2 * axis
        start, stop = records.vector(middle - half), records.vector(middle + half)
        return Exported((*beside, records.Cylinder(start, stop, values["radius"])))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"the rope touches a fixed obstacle of {values['radius'] * 1e3:.3g} mm radius, "
            f"{(values['x'] ** 2 + values['y'] ** 2 + values['z'] ** 2) ** 0.5:.3f} m from the "
            "middle of its ends"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        first, second = horizontal(gravity)
        axis = np.cos(values["heading"]) * first + np.sin(values["heading"]) * second
        radius = values["radius"]
        label = f"bar, radius {1e3 * radius:.2g} mm"
        return Drawn("bar", axis, components(values, ""), size=radius, label=label)


def _across(setup: Setup, heading: float, vector: np.ndarray) -> np.ndarray:
    """Return the part of a vector (3,) across a horizontal axis of some heading."""
    axis = _axis(setup, heading)
    return vector - (vector @ axis) * axis


def _axis(setup: Setup, heading: float) -> np.ndarray:
    """Return (3,) the horizontal axis of some heading."""
    first, second = horizontal(setup.gravity)
    return np.cos(heading) * first + np.sin(heading) * second


def heading_across(setup: Setup) -> float:
    """Return the heading [rad] of a horizontal axis across the line of the ends."""
    up = up_of(setup)
    first, second = horizontal(setup.gravity)
    span = np.nan_to_num(setup.ends[:, 0] - setup.ends[:, 1]).mean(0)
    across = np.cross(span, up)
    turn = float(np.arctan2(across @ second, across @ first))
    return (turn + np.pi / 2) % np.pi - np.pi / 2  # an axis has no direction
