"""Bending that is not linear: a moment that grows more, or less, than the curvature does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.law import Constant, Form, Law
from ropefit.rod.bending import Bending
from ropefit.rod.setup import Setup

INNER = (2, 4, 8, 16)  # over the length: curvatures at which the slope's logarithm is a value
LOWEST, HIGHEST = 0.25, 32.0  # over the length: beyond, the slope of M is constant
OCTAVES, PER_OCTAVE = (-2, 6), 4  # over the length: where M is exact, between which it is linear
MIDDLE = 32.0**0.5  # over the length: EI is M / κ there
LEAST_SLOPE = 1e-3  # over EI: a moment that no longer grows leaves equilibria undetermined
STEEPEST = 5.0  # of the slope's logarithm: strands that lock are a hundred times as stiff

Moment = Callable[[np.ndarray, float], np.ndarray]  # of curvatures (n,), a shape; up to a factor

LEAST_TESTED = 1.0  # of the exponent: data that miss a larger departure test nothing


class BendingLaw(Effect):
    """The slope dM/dκ of the bending moment over the rigidity EI, as a function of the curvature.

    Its logarithm is piecewise linear in that of the curvature: `exponent` n - 1 of M ~ κ^n, and
    departures from that at four curvatures. EI is M / κ at the middle one. All bending moments of
    the rope follow the same law.
    """

    name = "bending_law"
    in_motion = False
    of_rope = True
    changes = False
    asked_as = "bending"
    quantities = (
        Quantity("exponent", "1", 0.3, -0.9, 3.0),
        *(Quantity(f"log_slope_at_{k}", "1", 0.3, -3.0, STEEPEST) for k in INNER),
    )

    def applies(self, setup: Setup) -> bool:
        return setup.bending is None

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        knots = _knots(setup)
        edges = np.concatenate([knots[:1] / 2, knots, knots[-1:] * 2])
        at = np.log(edges[1:] * edges[:-1]) / 2 + np.log(_length(setup))
        at = np.clip(at, np.log(LOWEST), np.log(HIGHEST))
        apart = np.log(INNER[1] / INNER[0])
        hats = np.maximum(1 - np.abs(at[:, None] - np.log(INNER)) / apart, 0.0)
        slope = np.exp(values[0] * (at - np.log(MIDDLE)) + hats @ values[1:])
        return _with_slope(setup, np.maximum(slope, LEAST_SLOPE))

    def law(self, setup: Setup) -> Law:
        return Law(
            "curvature", "bending moment", "1/m", -1.0, _curve, _curvatures,
            np.array([True, False, False, False, False]), _forms(setup), _sentence,
        )  # fmt: skip

    def unseen(self, size: float) -> tuple[str, str]:
        if size > LEAST_TESTED:
            return "linearity", (
                "Whether bending is linear cannot be determined: these data cover too small a "
                "range of curvature; poses with the ends close together, and far apart, would show "
                "it."
            )
        return "linearity", (
            "Bending is linear as far as these data show: a moment that grows as the curvature to "
            f"a power between {max(1 - size, 0.0):.2f} and {1 + size:.2f} could not be "
            "distinguished from that."
        )

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        at = MIDDLE / _length(setup)
        note = f"bending_law: bending is linear there; EI is that at a curvature of {at:.3g} 1/m"
        return Exported(beside, note=note)

    def sentence(self, values: dict[str, float]) -> str:
        way = "softens" if values["exponent"] < 0 else "stiffens"
        return (
            f"the rope {way} in bending: its moment grows as the curvature to the power "
            f"{1 + values['exponent']:.2g}"
        )


def _length(setup: Setup) -> float:
    return float(setup.properties.length.sum())


def _knots(setup: Setup) -> np.ndarray:
    """Return (B-1,) [1/m] the curvatures where M is exact."""
    low, high = OCTAVES
    return 2.0 ** np.linspace(low, high, (high - low) * PER_OCTAVE + 1) / _length(setup)


def _with_slope(setup: Setup, slope: np.ndarray) -> Setup:
    """Return the setup with a law of these slopes (B,), up to a factor: M is EI κ in the middle."""
    knots, middle = _knots(setup), MIDDLE / _length(setup)
    steps = np.diff(np.minimum(knots, middle), prepend=0.0)
    moment = (slope[:-1] * steps).sum()
    return setup._replace(bending=Bending(knots, slope * middle / moment))


def _with_moment(setup: Setup, moment: Moment, shape: float) -> Setup:
    """Return the setup with a moment that is a function of the curvature."""
    knots = _knots(setup)
    edges = np.concatenate([[0.0], knots, knots[-1:] * 1.2])
    slope = np.diff(moment(edges, shape)) / np.diff(edges)
    middle = np.full(1, MIDDLE / _length(setup))
    return _with_slope(setup, np.maximum(slope, LEAST_SLOPE * moment(middle, shape) / middle))


def _curve(setup: Setup, x: np.ndarray) -> np.ndarray:
    """Return (n,) moments [N m] at curvatures x (n,) [1/m], of the rope's first segment."""
    rigidity = float(setup.properties.bend[0])
    if setup.bending is None:
        return rigidity * x
    knots, slope = setup.bending
    edges = np.concatenate([[0.0], knots, [np.inf]])
    parts = np.clip(x[:, None], edges[:-1], edges[1:]) - edges[:-1]
    return rigidity * (parts * slope).sum(1)


def _sentence(x: np.ndarray, y: np.ndarray, units: tuple[str, str]) -> str:
    ratio = float(y[1] / x[1] / (y[0] / x[0]))
    way = "softens" if ratio < 1 else "stiffens"
    return (
        f"bending {way}: the bending moment per curvature at {x[1]:.2g} {units[0]} is {ratio:.2g} "
        f"times that at {x[0]:.2g} {units[0]}"
    )


def _curvatures(setup: Setup, nodes: np.ndarray) -> np.ndarray:
    """Return the curvatures [1/m] at the inner nodes (F, N+1, 3) [m]."""
    step = np.diff(nodes, axis=1)
    length = np.linalg.norm(step, axis=-1)
    way = step / length[..., None]
    turned = np.linalg.norm(np.diff(way, axis=1), axis=-1)
    return (turned / (0.5 * (length[:, 1:] + length[:, :-1]))).ravel()


def _power(x: np.ndarray, n: float) -> np.ndarray:
    return np.where(x > 0, x, 1.0) ** n * (x > 0)


def _rising(x: np.ndarray, at: float) -> np.ndarray:
    return x + x**3 / at**2


def _falling(x: np.ndarray, at: float) -> np.ndarray:
    """Return the moment that is highest at the curvature `at`, and level beyond."""
    x = np.minimum(x, at)
    return x - x**3 / (3 * at**2)


def _levelling(x: np.ndarray, at: float) -> np.ndarray:
    return np.tanh(x / at)


def _forms(setup: Setup) -> tuple[Form, ...]:
    length = _length(setup)
    between = np.geomspace(0.5, 100, 24)[:, None] / length
    exponents = np.linspace(0.2, 3.0, 29)[:, None]

    def form(name: str, shape: str, moment: Moment, constants, tries=between) -> Form:
        unit = "1" if tries is exponents else "1/m"
        return Form(
            name, (shape,), (unit,), tries[0] / 2, tries[-1] * 2, tries,
            lambda s, v: _with_moment(s, moment, v[0]), constants,
        )  # fmt: skip

    def power(s: Setup, v: np.ndarray) -> list[Constant]:
        middle, n = MIDDLE / length, float(v[0])
        size = float(s.properties.bend[0]) * middle ** (1 - n)
        return [Constant("a", size, n - 1), Constant("n", n, 0.0, False)]

    def cubic(sign: float) -> Callable[[Setup, np.ndarray], list[Constant]]:
        def constants(s: Setup, v: np.ndarray) -> list[Constant]:
            ratio = (MIDDLE / length / float(v[0])) ** 2
            a = float(s.properties.bend[0]) / (1 + ratio if sign > 0 else max(1 - ratio / 3, 2 / 3))
            b = a / float(v[0]) ** 2 * (1.0 if sign > 0 else -1 / 3)
            return [Constant("a", a, 0.0), Constant("b", b, 2.0)]

        return constants

    def tanh(s: Setup, v: np.ndarray) -> list[Constant]:
        at, middle = float(v[0]), MIDDLE / length
        size = float(s.properties.bend[0]) * middle / np.tanh(middle / at)
        return [Constant("M0", size, -1.0), Constant("k0", at, -1.0, False)]

    return (
        form("M = a k |k|^(n-1)", "exponent", _power, power, exponents),
        form("M = a k + b k^3, b > 0", "curvature", _rising, cubic(1)),
        form("M = a k + b k^3, b < 0", "curvature", _falling, cubic(-1)),
        form("M = M0 tanh(k/k0)", "curvature", _levelling, tanh),
    )
