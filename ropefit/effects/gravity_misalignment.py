"""Gravity does not point where the recording says."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Calibration, Effect, Quantity
from ropefit.effects.distributed_load import DistributedLoad
from ropefit.effects.drawn import Drawn
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import horizontal
from ropefit.rod.setup import Setup

FAR_MISFIT = 0.02  # of the length, rms: a misfit beyond it may come from axes that were confused
CONFUSED = 0.5  # rad: a smaller tilt the scan finds by itself
SMOOTHING = 1e-24  # rad²: keeps the quotient by the angle finite at zero


class GravityMisalignment(Effect):
    """Gravity is turned by a vector of two angles [rad] about the horizontal axes.

    Any angle is possible: the axes of cameras and of motion capture are often confused.
    """

    name = "gravity_misalignment"
    kind = "measurement"
    vector = ("angle", "rad")
    quantities = tuple(Quantity(f"angle_{k}", "rad", 0.02, -np.pi, np.pi) for k in (1, 2))
    calibration = Calibration("gravity", ("x", "y"), "gravity", degrees=True)
    implausible = np.inf

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return setup._replace(gravity=turned(setup.gravity, values))

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Propose the direction in which the recorded rope sags, if it is far from the stated one.

        A scan looks at small tilts; a rope whose gravity is stated along another axis fits nothing.
        Its fit has distorted the errors of the ends, too: ends, gravity and data are those stated.
        """
        setup = misfit.stated
        length, gravity = float(setup.properties.length.sum()), setup.gravity
        rms = np.sqrt((misfit.moves**2).sum(1).mean()) if len(misfit.frame) else 0.0
        ends = setup.whole()[0].ends
        frame, slot = np.nonzero(misfit.counts)
        nothing = self.name in misfit.terms or np.isnan(ends).any() or not len(frame)
        if nothing or rms < FAR_MISFIT * length:
            return []
        chord = ends[frame, 1] - ends[frame, 0]
        chord /= np.maximum(np.linalg.norm(chord, axis=1), SMOOTHING)[:, None]
        sag = misfit.points[frame, slot] - ends[frame, 0]
        sag -= (sag * chord).sum(1)[:, None] * chord
        down, stated = (v / np.linalg.norm(v) for v in (sag.mean(0), gravity))
        angles = turning(stated, down)
        return [[angles]] if np.linalg.norm(angles) > CONFUSED else []

    def starts_beside(
        self, leader: Effect, values: np.ndarray, misfit: Misfit
    ) -> list[list[np.ndarray]]:
        """Propose the direction of the weight and a uniform load together."""
        setup = misfit.setup
        if not isinstance(leader, DistributedLoad) or self.name in misfit.terms:
            return []
        weight = setup.weight * setup.gravity / np.linalg.norm(setup.gravity)
        whole = weight + values * float(setup.properties.length.sum())
        return [[turning(setup.gravity, whole)]]

    def sentence(self, values: dict[str, float]) -> str:
        size = (values["angle_1"] ** 2 + values["angle_2"] ** 2) ** 0.5
        confused = " (were the axes confused?)" if size > CONFUSED else ""
        return f"gravity points {_degrees(size)}° away from its recorded direction{confused}"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        angles = np.array([values["angle_1"], values["angle_2"]])
        return Drawn("gravity", vector=turned(gravity, angles))


def turning(gravity: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Return the angles (2,) [rad] about the horizontal axes that turn gravity (3,) towards `down`
    (3,)."""
    axis = np.cross(gravity, down)
    size = np.linalg.norm(axis)
    first, second = horizontal(gravity)
    axis = axis / size if size > 1e-6 * np.linalg.norm(gravity) * np.linalg.norm(down) else first
    return np.arctan2(size, gravity @ down) * np.array([axis @ first, axis @ second])


def _degrees(angle: float) -> str:
    """Return an angle [rad] in degrees, of two digits at least."""
    degrees = np.degrees(angle)
    return f"{degrees:.0f}" if degrees >= 10 else f"{degrees:.2g}"


def turned(gravity: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return gravity (3,) turned by the rotation vector of angles (2,) [rad] about the horizontal
    axes (Rodrigues)."""
    first, second = horizontal(gravity)
    vector = angles[0] * first + angles[1] * second
    angle = np.sqrt((vector * vector).sum() + SMOOTHING)
    across = np.cross(vector, gravity)
    return gravity * np.cos(angle) + across * np.sin(angle) / angle
