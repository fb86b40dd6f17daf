"""Stretch that is not linear: a tension that grows more, or less, than the strain does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.law import Constant, Form, Law
from ropefit.rod.axial import TENSIONS
from ropefit.rod.fields import PER_OCTAVE
from ropefit.rod.setup import Setup

# Over the rope's weight: tensions at which the exponent may change; beyond LOWEST and HIGHEST
# strain is in proportion to tension.
BENDS = (1 / 5, 1 / 2)
LOWEST, HIGHEST = 1 / 64, 16.0
MIDDLE = (BENDS[0] * BENDS[1]) ** 0.5  # there EA is the tension over the strain
LEAST_POWER = 0.05  # of strain in tension: a strain that no longer grows leaves tensions open
SMALLEST = 1e-6  # strain: smaller ones are none
POINTS = 400  # of a form's curve
LEAST_LOCKING = 1.001  # strain at which a rope locks, over that in the middle, which it reaches

Tension = Callable[[np.ndarray, float], np.ndarray]  # of strains (n,) and a shape, up to a factor


class AxialLaw(Effect):
    """The axial strain over that of a linear rope, as a function of the tension.

    Its logarithm is piecewise linear in that of the tension: `exponent` n - 1 of strain ~ tension^n
    at middle tensions, and how much larger it is at lower and at higher ones. All of the rope
    follows the same law; what does not stretch has none.
    """

    name = "axial_law"
    in_motion = False
    of_rope = True
    changes = False
    counted = False  # it corrects the linear stretch, which is a parameter or an effect of its own
    quantities = (
        Quantity("exponent", "1", 0.5, -0.95, 4.0),
        Quantity("more_below", "1", 0.5, -4.0, 4.0),
        Quantity("more_above", "1", 0.5, -4.0, 4.0),
    )

    def applies(self, setup: Setup) -> bool:
        return setup.axial is None and _compliance(setup) > 0

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        at = np.log(_relative(setup))
        below = np.minimum(at - np.log(BENDS[0]), 0.0)
        above = np.maximum(at - np.log(BENDS[1]), 0.0)
        parts = np.stack([at - np.log(MIDDLE), below, above], axis=-1)
        return setup._replace(axial=_increasing(parts @ values))

    def law(self, setup: Setup) -> Law:
        return Law(
            "axial strain", "tension", "1", -2.0, _curve, _strains,
            np.array([True, False, False]), _forms(setup), _sentence,
        )  # fmt: skip

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        at = MIDDLE * float(setup.weight)
        note = f"axial_law: stretch is linear there; EA is that at a tension of {at:.3g} N"
        return Exported(beside, note=note)

    def sentence(self, values: dict[str, float]) -> str:
        way = "stiffens" if values["exponent"] < 0 else "softens"
        return (
            f"the rope {way} as it stretches: its tension grows as the strain to the power "
            f"{1 / (1 + values['exponent']):.2g}"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("spring", label="tension over strain")


def _compliance(setup: Setup) -> float:
    """Return 1/EA [1/N] of the rope's first segment."""
    return float(1 / setup.properties.axial[0] + setup.stretch[0])


def _weight(setup: Setup) -> float:
    return float(setup.weight)


def _relative(setup: Setup) -> np.ndarray:
    """Return (A,) the tensions of the law's knots over the weight, within LOWEST and HIGHEST."""
    return np.clip(TENSIONS / _weight(setup), LOWEST, HIGHEST)


def _increasing(factor: np.ndarray) -> np.ndarray:
    """Return logarithms of the factor (A,) with which the strain grows with the tension."""
    least = (LEAST_POWER - 1) * np.log(2.0) / PER_OCTAVE
    steps = np.diff(factor)
    if bool((steps >= least).all()):
        return factor
    middle = len(factor) // 2
    summed = np.append(0.0, np.maximum(steps, least).cumsum())
    return factor[middle] + summed - summed[middle]


def _curve(setup: Setup, x: np.ndarray) -> np.ndarray:
    """Return (n,) tensions [N] at strains x (n,), of the rope's first segment."""
    soft = _compliance(setup)
    if setup.axial is None:
        return x / soft
    way, at = np.log(soft * TENSIONS) + setup.axial, np.log(np.maximum(x, 1e-300))
    inside = np.interp(at, way, np.log(TENSIONS))  # beyond the knots, in proportion
    beyond = np.minimum(at - way[0], 0.0) + np.maximum(at - way[-1], 0.0)
    return np.where(x > 0, np.exp(inside + beyond), 0.0)


def _strains(setup: Setup, nodes: np.ndarray) -> np.ndarray:
    """Return the positive strains of the segments between nodes (F, N+1, 3) [m]."""
    length = np.linalg.norm(np.diff(nodes, axis=1), axis=-1)
    strain = (length / setup.properties.length - 1).ravel()
    return strain[np.isfinite(strain) & (strain > SMALLEST)]


def _sentence(x: np.ndarray, y: np.ndarray, units: tuple[str, str]) -> str:
    power = float(np.log(y[1] / y[0]) / np.log(x[1] / x[0]))
    way = "stiffens" if power > 1 else "softens"
    return (
        f"the rope {way} as it stretches: between strains of {100 * x[0]:.2g} and "
        f"{100 * x[1]:.2g} % its tension grows as the strain to the power {power:.2g}"
    )


def _middle(setup: Setup) -> tuple[float, float]:
    """Return strain and tension [N] where EA is their ratio."""
    tension = MIDDLE * _weight(setup)
    return _compliance(setup) * tension, tension


def _with_tension(setup: Setup, tension: Tension, shape: float) -> Setup:
    """Return the setup with a tension that is a function of the strain over that in the middle."""
    relative, strain = np.log(_relative(setup) / MIDDLE), np.linspace(-14.0, 14.0, POINTS)
    at = np.log(tension(np.exp(strain), shape)) - np.log(tension(np.ones(1), shape))
    at = at + 1e-9 * strain  # where it no longer grows
    k = np.clip(np.searchsorted(at, relative), 1, POINTS - 1)
    share = (relative - at[k - 1]) / (at[k] - at[k - 1])
    found = strain[k - 1] + np.clip(share, 0.0, 1.0) * (strain[k] - strain[k - 1])
    return setup._replace(axial=_increasing(found - relative))


def _power(x: np.ndarray, n: float) -> np.ndarray:
    return x**n


def _rising(x: np.ndarray, at: float) -> np.ndarray:
    return x + x**3 / at**2


def _levelling(x: np.ndarray, at: float) -> np.ndarray:
    return np.tanh(x / at)


def _locking(x: np.ndarray, at: float) -> np.ndarray:
    """Return the tension of a strain that tends to `at`."""
    return np.where(x < at, -np.log1p(-np.minimum(x / at, 1 - 1e-9)), 20.0 + x / at)


def _forms(setup: Setup) -> tuple[Form, ...]:
    exponents = np.linspace(0.25, 5.0, 39)[:, None]
    shares = np.geomspace(0.2, 20.0, 24)[:, None]

    def form(
        name: str, shape: str, tries: np.ndarray, tension: Tension, constants, least: float = 0.0
    ) -> Form:
        return Form(
            name, (shape,), ("1",), np.maximum(tries[0] / 2, least), tries[-1] * 2, tries,
            lambda s, v: _with_tension(s, tension, v[0]), constants,
        )  # fmt: skip

    def constant(name: str, tension: float) -> Constant:
        return Constant(name, tension, -2.0)

    def strain(name: str, value: float) -> Constant:
        return Constant(name, value, 0.0, False)

    def power(s: Setup, v: np.ndarray) -> list[Constant]:
        e, tension = _middle(s)
        return [constant("a", tension / e ** float(v[0])), strain("n", float(v[0]))]

    def rising(s: Setup, v: np.ndarray) -> list[Constant]:
        e, tension = _middle(s)
        a = tension / e / (1 + float(v[0]) ** -2)
        return [constant("a", a), constant("b", a / (float(v[0]) * e) ** 2)]

    def levelling(s: Setup, v: np.ndarray) -> list[Constant]:
        e, tension = _middle(s)
        return [
            constant("T0", tension / np.tanh(1 / float(v[0]))), strain("e0", float(v[0]) * e)
        ]  # fmt: skip

    def locking(s: Setup, v: np.ndarray) -> list[Constant]:
        e, tension = _middle(s)
        at = float(v[0])
        return [constant("T0", tension / -np.log1p(-1 / at)), strain("e0", at * e)]

    return (
        form("T = a e^n", "exponent", exponents, _power, power),
        form("T = a e + b e^3, b > 0", "strain", shares, _rising, rising),
        form("T = T0 tanh(e/e0)", "strain", shares, _levelling, levelling),
        form("T = -T0 ln(1 - e/e0)", "strain", np.geomspace(1.02, 20.0, 24)[:, None], _locking,
             locking, LEAST_LOCKING),
    )  # fmt: skip
