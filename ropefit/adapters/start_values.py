"""A setup with given values of the rope's parameters."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.errors import WrongUsage
from ropefit.inference import rest_curve
from ropefit.inference.equilibrium_rope import NAMES, ranges
from ropefit.inference.terms import ROPE
from ropefit.rod.setup import Setup


def started_setup(
    setup: Setup, start: dict[str, float], scale: dict[str, tuple[float, str]]
) -> Setup:
    """The setup with some parameters set. Raises WrongUsage for values out of reach."""
    for name in sorted(start):  # EI before GJ, which otherwise follows it
        if name in rest_curve.NAMES:
            curvature = torch.tensor([start[name]], dtype=torch.float64)
            setup = rest_curve.apply(name)(setup, curvature)
            continue
        if name not in NAMES:
            raise WrongUsage(f"unknown parameter {name}; one of {', '.join(NAMES)}")
        value = start[name] / scale[name][0]
        _, low, high = ranges(setup)[name]
        if not low <= value <= high:
            f = scale[name][0]
            raise WrongUsage(
                f"start {name} = {start[name]:g} is outside its bounds {low * f:g}..{high * f:g}"
            )
        given = torch.tensor([value], dtype=torch.float64)
        setup = setup.after(lambda s, apply=ROPE[name], v=given: apply(s, v))
    return setup


def with_values(setup: Setup, values: Tensor) -> Setup:
    """The setup with values (4,) in the order of NAMES, the same everywhere."""
    p = setup.properties
    bend, twist, axial, length = values
    p = p._replace(
        bend=bend.expand_as(p.bend),
        twist=twist.expand_as(p.twist),
        axial=axial.expand_as(p.axial),
        length=p.length * (length / p.length.sum()),
    )
    return setup._replace(properties=p)
