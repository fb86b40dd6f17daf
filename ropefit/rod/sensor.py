"""How a sensor, or a simulation that is compared with, reports the nodes of a rope."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.either import Array
from ropefit.rod.quaternion import cross, norms


class SensorModel(NamedTuple):
    """How the sensor reports points: small errors of its own, and what a projection took away.

    rotation (3,) [rad] and gain about its place (3,), shift (3,) [m], depth [m] along its rays: a
    point p is reported at p + rotation x (p - place) + gain (p - place) + shift + depth ray.
    flat: share of the offset from a plane, through origin (F, 1, 3) across normal (F, 1, 3), that
    is lost, of what is seen: it lies `standoff` [m] before the axis, along its ray. Errors of a
    solver: lag, a share of the way to the nodes toward (F, N+1, 3) [m], is gone back, and drift
    (F, N+1, 3) [m] is added.
    """

    place: Array
    rotation: Array
    gain: Array
    shift: Array
    depth: Array
    flat: Array
    origin: Array
    normal: Array
    drift: Array
    lag: Array
    toward: Array
    standoff: Array

    def __call__(self, x: Array) -> Array:
        """Return (F, N+1, 3) [m] where nodes x (F, N+1, 3) [m] are reported."""
        seen = x = self.nodes(x)
        if acts(self.rotation, self.gain, self.shift, self.depth):
            seen = x + self.errors(x)
        if acts(self.flat):
            visible = seen
            if acts(self.standoff):
                ray = seen - self.place
                ray = ray / norms(ray)
                visible = seen - self.standoff * ray
            off = ((visible - self.origin) * self.normal).sum(-1)[..., None]
            seen = seen - self.flat * off * self.normal
        return seen

    def frames(self, index: np.ndarray) -> SensorModel:
        """Return the model of some of the frames."""
        few = {name: getattr(self, name)[index] for name in ("origin", "normal")}
        for name in ("drift", "toward"):
            value = getattr(self, name)
            few[name] = value if value.ndim == 1 else value[index]
        return self._replace(**few)

    def errors(self, x: Array) -> Array:
        """Return (F, N+1, 3) [m] by how much small errors move what is reported of nodes x (F, N+1,
        3) [m]; linear in rotation, gain, shift and depth."""
        out, arm = self.shift, x - self.place
        if acts(self.rotation):
            out = out + cross(self.rotation, arm)
        if acts(self.gain):
            out = out + self.gain * arm
        if acts(self.depth):
            out = out + self.depth * (arm / norms(arm))
        return out

    def nodes(self, x: Array) -> Array:
        """Return nodes x (F, N+1, 3) [m] with the errors of a solver."""
        return x + self.lag * (self.toward - x) + self.drift if acts(self.lag, self.drift) else x


def acts(*errors: Array) -> bool:
    """Return whether any of some errors is not zero."""
    return any(bool((error != 0).any()) for error in errors)
