"""A recording whose sideways shape was lost by projecting it onto a plane."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup


class LostOutOfPlane(Effect):
    """`share` of the rope's offset from the plane of gravity and its ends that is missing."""

    name = "lost_out_of_plane"
    kind = "measurement"
    quantities = (Quantity("share", "1", 0.5, 0.0, 1.0),)

    def applies(self, setup: Setup) -> bool:
        # Where an end is not known the plane is that of the points, and follows their noise.
        return not bool(np.isnan(setup.ends).any())

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        sensor = setup.sensor
        return setup._replace(sensor=sensor._replace(flat=sensor.flat + values[0]))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"{100 * values['share']:.0f} % of the rope's sideways shape is missing: the data were "
            "projected onto a plane"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("camera", label=f"{100 * values['share']:.0f} % of the depth lost")
