"""A setup with given values of the rope's parameters."""

from __future__ import annotations

import numpy as np

from ropefit.adapters.units import stated_units
from ropefit.artifacts import Observations
from ropefit.errors import WrongUsage
from ropefit.models.parameters import AT_REST, PARAMETERS, offered
from ropefit.rod.setup import Setup


def started_setup(setup: Setup, start: dict[str, float], o: Observations) -> Setup:
    """Return the setup with some parameters set to values as they are stated. Raises WrongUsage
    for values out of bounds."""
    stated = stated_units(o)
    for name in sorted(start):  # EI before GJ, which otherwise follows it
        if name not in AT_REST:
            raise WrongUsage(f"unknown parameter {name}; one of {offered(AT_REST)}")
        row, factor = PARAMETERS[name], stated[name].factor
        value = start[name] / factor
        _, low, high = row.range(setup)
        if not low <= value <= high:
            raise WrongUsage(
                f"start {name} = {start[name]:g} is outside its bounds {low * factor:g}.."
                f"{high * factor:g}"
            )
        given = np.array([value])
        setup = setup.after(lambda s, apply=row.apply, v=given: apply(s, v))
    return setup


def with_values(setup: Setup, values: np.ndarray) -> Setup:
    """Return the setup with values (4,) in the order of NAMES, the same everywhere."""
    p = setup.properties
    bend, twist, axial, length = values
    p = p._replace(
        bend=np.broadcast_to(bend, p.bend.shape),
        twist=np.broadcast_to(twist, p.twist.shape),
        axial=np.broadcast_to(axial, p.axial.shape),
        length=p.length * (length / p.length.sum()),
    )
    return setup._replace(properties=p)
