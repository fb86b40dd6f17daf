"""What may be fitted to a rope in motion."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from ropefit.inference.terms import Apply, set_bend, set_length, set_twist
from ropefit.rod.setup import Setup


@dataclass(frozen=True)
class Unknown:
    """A parameter: its meaning, unit without and with the mass known, start and bounds in
    multiples of `size`, how it acts."""

    meaning: str
    unit: str
    ratio: str
    start: float
    low: float
    high: float
    apply: Apply


def _air(setup: Setup, v: Tensor) -> Setup:
    assert setup.damping is not None
    same = v[0].expand(setup.properties.length.shape)
    return setup._replace(damping=setup.damping._replace(air=same))


def _bend_damping(setup: Setup, v: Tensor) -> Setup:
    assert setup.damping is not None
    same = v[0].expand(setup.properties.length.shape)
    return setup._replace(damping=setup.damping._replace(bend=same, twist=same))


def unknowns(setup: Setup) -> dict[str, Unknown]:
    """What may be fitted, in the units of the setup (a rope of known weight, or of 1 kg/m)."""
    p = setup.properties
    length, density = float(p.length.sum()), float(p.density.mean())
    heavy = density * 9.81
    bend, time = heavy * length**3, (length / 9.81) ** 0.5
    return {
        "EI": Unknown(
            "bending rigidity", "N m^2", "m^3", 1e-3 * bend, 1e-6 * bend, 1.0 * bend, set_bend
        ),
        "GJ": Unknown(
            "twist rigidity", "N m^2", "m^3", 1e-3 * bend, 1e-6 * bend, 1.0 * bend, set_twist
        ),
        "bend_damping": Unknown(
            "bending moment per rate of curvature", "N m^2 s", "m^3 s",
            1e-4 * bend * time, 1e-8 * bend * time, 0.1 * bend * time, _bend_damping,
        ),
        "air_damping": Unknown(
            "force per length and speed", "N s/m^2", "s/m",
            0.05 * heavy * time / length, 1e-4 * heavy * time / length,
            10 * heavy * time / length, _air,
        ),
        "length": Unknown("rest length", "m", "m", length, 0.8 * length, 1.2 * length, set_length),
    }  # fmt: skip
