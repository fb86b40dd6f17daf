"""In which units the parameters of a rope are stated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.artifacts import Observations
from ropefit.models.parameters import PARAMETERS


class Stated(NamedTuple):
    """How a parameter is stated: its value in SI of the setup times `factor`."""

    factor: float
    unit: str
    meaning: str


def stated_units(o: Observations) -> dict[str, Stated]:
    """Return how each parameter is stated: as a ratio to the weight if no mass is known."""
    gravity = float(np.linalg.norm(o.gravity))
    return {name: Stated(*p.stated(bool(o.mass), gravity)) for name, p in PARAMETERS.items()}
