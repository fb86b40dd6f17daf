"""In which unit each parameter of a rope at rest is told."""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Observations
from ropefit.inference import rest_curve


def unit_scale(o: Observations) -> dict[str, tuple[float, str]]:
    """Factor and unit in which each parameter is told: ratios to the weight if no mass is known."""
    weight = 1.0 if o.mass else 1.0 / float(np.linalg.norm(o.gravity))
    rigid = "N m^2" if o.mass else "m^3"
    return {
        "EI": (weight, rigid),
        "GJ": (weight, rigid),
        "EA": (weight, "N" if o.mass else "m"),
        "length": (1.0, "m"),
        **dict.fromkeys(rest_curve.NAMES, (1.0, "1/m")),
    }
