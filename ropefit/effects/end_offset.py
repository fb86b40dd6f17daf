"""An end that is not where the recording has it."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Calibration, Effect, Quantity
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.ends import one_end, where
from ropefit.rod.setup import Setup


class EndOffset(Effect):
    """The true end lies (x, y, z) [m] away from the recorded one, in every frame alike."""

    name = "end_offset"
    kind = "measurement"
    locus = "end"
    vector = ("offset", "m")
    quantities = tuple(Quantity(f"offset_{axis}", "m", 0.005) for axis in "xyz")
    calibration = Calibration("end", ("x", "y", "z"), "end_position")

    def applies(self, setup: Setup) -> bool:
        return not bool(np.isnan(setup.ends[:, self.end]).any())

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return setup._replace(ends=setup.ends + one_end(self.end, values))

    def sentence(self, values: dict[str, float]) -> str:
        size = sum(values[f"offset_{axis}"] ** 2 for axis in "xyz") ** 0.5
        return f"{where(self.end)} is {size * 1e3:.2g} mm away from its recorded position"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("arrow", vector=components(values, "offset_"))
