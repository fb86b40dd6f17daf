"""What may be fitted to a rope in motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ropefit.inference import rest_curve
from ropefit.inference.forward import Term
from ropefit.inference.terms import (
    DEGREE,
    Apply,
    nuisance,
    rope_term,
    set_axial,
    set_bend,
    set_length,
    set_twist,
    turn_clamp,
)
from ropefit.rod.setup import Setup

LOOSE = 50.0  # rad/(N m) per weight and length: how far a grip may yield, see `_grip`


@dataclass(frozen=True)
class Unknown:
    """A parameter: its meaning, its unit with the mass known and without, where it starts, its
    bounds in SI, how it acts."""

    meaning: str
    unit: str
    ratio: str
    start: float
    low: float
    high: float
    apply: Apply

    def term(self, name: str, setup: Setup) -> Term:
        if name in rest_curve.NAMES:
            return rest_curve.term(name, setup)
        return rope_term(name, "", self.start, self.low, self.high, self.apply)


def unknowns(setup: Setup) -> dict[str, Unknown]:
    """What may be fitted, in the units of the setup (a rope of known weight, or of 1 kg/m)."""
    p = setup.properties
    length, density = float(p.length.sum()), float(p.density.mean())
    g = float(setup.gravity.norm())
    heavy, time = density * g, (length / g) ** 0.5
    bend, air = heavy * length**3, heavy * time / length
    found = {
        "EI": Unknown(
            "bending rigidity", "N m^2", "m^3", 3e-3 * bend, 1e-6 * bend, 1.0 * bend, set_bend
        ),
        "GJ": Unknown(
            "twist rigidity", "N m^2", "m^3", 2e-3 * bend, 1e-6 * bend, 1.0 * bend, set_twist
        ),
        "EA": Unknown(
            "axial rigidity", "N", "m", 1e3 * heavy * length, 30 * heavy * length,
            1e6 * heavy * length, set_axial,
        ),
        "bend_damping": Unknown(
            "bending moment per rate of curvature", "N m^2 s", "m^3 s",
            3e-4 * bend * time, 1e-8 * bend * time, 0.1 * bend * time, set_bend_damping,
        ),
        "air_damping": Unknown(
            "force per length and speed", "N s/m^2", "s/m",
            0.05 * air, 1e-4 * air, 10 * air, set_air_damping,
        ),
        "length": Unknown(
            "rest length between the grips", "m", "m", length, 0.8 * length, 1.2 * length,
            set_length,
        ),
    }  # fmt: skip
    for name in rest_curve.NAMES:
        most = rest_curve.bound(name, setup)
        found[name] = Unknown(
            rest_curve.meaning(name), "1/m", "1/m", 0.0, -most, most, rest_curve.apply(name)
        )
    return found


def grips(setup: Setup, degrees: float) -> list[Term]:
    """How far each clamp is turned from what the recording tells, the same in every frame, and how
    far it yields to bending; degrees: one sigma of the turn."""
    p = setup.properties
    length, weight = float(p.length.sum()), float(setup.weight)
    terms = []
    for end in range(2):
        if not setup.clamped[end]:
            continue
        sd = degrees * DEGREE
        terms.append(
            nuisance(f"clamp_{end}", ["x", "y", "z"], ["rad"] * 3, turn_clamp(end), [sd] * 3)
        )
        usual = LOOSE / (weight * length)
        terms.append(
            Term(
                f"grip_{end}", ("give",), ("rad/(N m)",), _grip(end), np.full(1, 0.1 * usual),
                np.ones(1), np.full(1, 1e-4 * usual), np.full(1, 30 * usual), np.full(1, 2.0),
                log=True, nuisance=True,
            )
        )  # fmt: skip
    return terms


def set_air_damping(setup: Setup, v: Tensor) -> Setup:
    """Air drag [N s/m²], the same everywhere."""
    assert setup.damping is not None
    same = v[0].expand(setup.properties.length.shape)
    return setup._replace(damping=setup.damping._replace(air=same))


def set_bend_damping(setup: Setup, v: Tensor) -> Setup:
    """Damping of bending and of twist [N m² s], the same everywhere."""
    assert setup.damping is not None
    same = v[0].expand(setup.properties.length.shape)
    return setup._replace(damping=setup.damping._replace(bend=same, twist=same))


def _grip(end: int) -> Apply:
    at = torch.zeros(2, 2, dtype=torch.float64)
    at[end, 0] = 1.0
    return lambda setup, v: setup._replace(clamp_compliance=setup.clamp_compliance + v[0] * at)
