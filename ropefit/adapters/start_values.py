"""A setup with given values of the rope's parameters."""

from __future__ import annotations

import torch
from torch import Tensor

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
        given = torch.tensor([value], dtype=torch.float64)
        setup = setup.after(lambda s, apply=row.apply, v=given: apply(s, v))
    return setup


def with_values(setup: Setup, values: Tensor) -> Setup:
    """Return the setup with values (4,) in the order of NAMES, the same everywhere."""
    p = setup.properties
    bend, twist, axial, length = values
    p = p._replace(
        bend=bend.expand_as(p.bend),
        twist=twist.expand_as(p.twist),
        axial=axial.expand_as(p.axial),
        length=p.length * (length / p.length.sum()),
    )
    return setup._replace(properties=p)
