"""The table of parameters: every number of a rope that a model can be fitted by.

One row a parameter: what it means, its unit with and without the mass, how it is searched, where
it starts, its bounds, and how it acts on a setup. The equilibrium and the dynamics read it alike
(the paper's weights, which act on no setup, are in `weights.py`).

Shapes alone fix only ratios to the weight: without the mass a setup has one kilogram a metre, and
what is proportional to the mass is stated over the weight per length.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ropefit.models import rest_curve
from ropefit.models.terms import Apply, Term
from ropefit.rod.setup import Setup


class Range(NamedTuple):
    """Where a search starts, and its bounds."""

    start: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Parameter:
    """One row of the table.

    unit: with the mass known; unit_per_weight: without it, the same for what does not depend on the
    mass. range: in SI of a setup. log: positive and searched on a logarithmic scale; else of either
    sign.
    """

    name: str
    meaning: str
    unit: str
    unit_per_weight: str
    range: Callable[[Setup], Range]
    apply: Apply
    log: bool = True

    def term(self, setup: Setup, start: float | None = None) -> Term:
        """Return the parameter as a free term that starts where the table says, or at `start`."""
        usual, low, high = self.range(setup)
        return self.within(Range(usual if start is None else start, low, high))

    def within(self, given: Range) -> Term:
        """Return the parameter as a free term with a range of its own."""
        start, low, high = given
        return Term(
            self.name, (self.name,), (self.unit,), self.apply,
            np.array([start]),
            np.ones(1) if self.log else np.array([0.1 * high]),
            np.array([low]), np.array([high]), np.full(1, np.inf), log=self.log,
        )  # fmt: skip

    def stated(self, mass_known: bool, gravity: float) -> tuple[float, str, str]:
        """Return factor, unit and meaning with which values in SI of a setup are stated.

        gravity: its size [m/s²], which is the weight per metre where the mass is not known.
        """
        if mass_known or self.unit == self.unit_per_weight:
            return 1.0, self.unit, self.meaning
        return 1 / gravity, self.unit_per_weight, f"{self.meaning} over the weight per length"


def set_bend(setup: Setup, v: np.ndarray) -> Setup:
    """Set EI [N m²], the same everywhere; the twist rigidity follows at its ratio."""
    p = setup.properties
    ratio = v[0] / p.bend
    return setup._replace(properties=p._replace(bend=p.bend * ratio, twist=p.twist * ratio))


def set_twist(setup: Setup, v: np.ndarray) -> Setup:
    """Set GJ [N m²], the same everywhere."""
    p = setup.properties
    return setup._replace(properties=p._replace(twist=np.full(p.twist.shape, v[0])))


def set_axial(setup: Setup, v: np.ndarray) -> Setup:
    """Set EA [N], the same everywhere."""
    p = setup.properties
    return setup._replace(properties=p._replace(axial=np.full(p.axial.shape, v[0])))


def set_length(setup: Setup, v: np.ndarray) -> Setup:
    """Set the rest length [m] of the whole rope."""
    p = setup.properties
    return setup._replace(properties=p._replace(length=p.length * (v[0] / p.length.sum())))


def set_bend_damping(setup: Setup, v: np.ndarray) -> Setup:
    """Set the damping of bending and of twist [N m² s], the same everywhere."""
    assert setup.damping is not None
    same = np.full(setup.properties.length.shape, v[0])
    return setup._replace(damping=setup.damping._replace(bend=same, twist=same))


def set_air_damping(setup: Setup, v: np.ndarray) -> Setup:
    """Set the air drag [N s/m²], the same everywhere."""
    assert setup.damping is not None
    same = np.full(setup.properties.length.shape, v[0])
    return setup._replace(damping=setup.damping._replace(air=same))


def _length(setup: Setup) -> float:
    return float(setup.properties.length.sum())


def _weight(setup: Setup) -> float:
    """Return [N]."""
    return float(setup.properties.density.mean() * np.linalg.norm(setup.gravity)) * _length(setup)


def _swing(setup: Setup) -> float:
    """Return [s] time in which a rope of this length swings by a radian."""
    return (_length(setup) / float(np.linalg.norm(setup.gravity))) ** 0.5


def _bend(setup: Setup) -> Range:
    usual = _weight(setup) * _length(setup) ** 2
    # A motion is out of step with a rope that is too soft: it sets out from a stiff one.
    start = 3e-3 * usual if setup.damping is not None else float(setup.properties.bend[0])
    return Range(start, 3e-8 * usual, 3.0 * usual)


def _twist(setup: Setup) -> Range:
    usual = _weight(setup) * _length(setup) ** 2
    start = 2e-3 * usual if setup.damping is not None else float(setup.properties.twist[0])
    return Range(start, 3e-8 * usual, 3.0 * usual)


def _axial(setup: Setup) -> Range:
    """Return a rope that does not stretch yet starts where it hardly does."""
    weight, axial = _weight(setup), float(setup.properties.axial[0])
    return Range(axial if np.isfinite(axial) else 1e3 * weight, weight, 1e7 * weight)


def _whole_length(setup: Setup) -> Range:
    length = _length(setup)
    return Range(length, 0.8 * length, 1.25 * length)


def _bend_damping(setup: Setup) -> Range:
    usual = _weight(setup) * _length(setup) ** 2 * _swing(setup)
    return Range(3e-4 * usual, 1e-8 * usual, 0.1 * usual)


def _air_damping(setup: Setup) -> Range:
    usual = _weight(setup) / _length(setup) ** 2 * _swing(setup)
    return Range(0.05 * usual, 1e-4 * usual, 10 * usual)


def _curvature(name: str) -> Parameter:
    def bounds(setup: Setup) -> Range:
        most = rest_curve.bound(name, setup)
        return Range(0.0, -most, most)

    return Parameter(
        name, rest_curve.meaning(name), "1/m", "1/m", bounds, rest_curve.apply(name), log=False
    )


_ROWS = (
    Parameter("EI", "bending rigidity", "N m^2", "m^3", _bend, set_bend),
    Parameter("GJ", "twist rigidity", "N m^2", "m^3", _twist, set_twist),
    Parameter("EA", "axial rigidity", "N", "m", _axial, set_axial),
    Parameter(
        "bend_damping", "bending moment per rate of curvature", "N m^2 s", "m^3 s",
        _bend_damping, set_bend_damping,
    ),
    Parameter(
        "air_damping", "force per length and speed", "N s/m^2", "s/m", _air_damping,
        set_air_damping,
    ),
    Parameter("length", "rest length of the rope", "m", "m", _whole_length, set_length),
    *(_curvature(name) for name in rest_curve.NAMES),
)  # fmt: skip
PARAMETERS = {row.name: row for row in _ROWS}
AT_REST = ("EI", "GJ", "EA", "length", *rest_curve.NAMES)
IN_MOTION = tuple(PARAMETERS)


def terms(setup: Setup, free: Iterable[str]) -> list[Term]:
    """Return one term for each free parameter, in the order given."""
    return [PARAMETERS[name].term(setup) for name in free]


def offered(names: Iterable[str]) -> str:
    """Return names in words for a message, the points of a varying rest curve as one."""
    short = [name for name in names if name not in rest_curve.VARYING]
    return ", ".join([*short, rest_curve.SHORT])
