"""Drag that is not in proportion to speed: the air's resistance as a function of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.law import Constant, Form, Law
from ropefit.rod.moving import DRAG_SPEEDS
from ropefit.rod.setup import Setup

# Over √(g L): speeds at which the exponent may change; beyond LOWEST and HIGHEST drag is linear.
BENDS = (1 / 12, 1 / 4)
LOWEST, HIGHEST = 1 / 64, 2.0
MIDDLE = (BENDS[0] * BENDS[1]) ** 0.5  # there the drag is that of the linear law
LONG_PAUSE = 1.5  # times the usual time between frames: no speed is computed over a longer one

Force = Callable[
    [np.ndarray, np.ndarray], np.ndarray
]  # of speeds (n,) and a shape (), up to a factor


class DragLaw(Effect):
    """The drag per length over that of a linear law, as a function of the speed.

    Its logarithm is piecewise linear in that of the speed: `exponent` n - 1 of F ~ v^n at middle
    speeds, and how much larger it is at lower and at higher ones. Along and across the rope it is
    the same.
    """

    name = "drag_law"
    of_rope = True
    quantities = (
        Quantity("exponent", "1", 0.5, -2.0, 4.0),
        Quantity("more_below", "1", 0.5, -4.0, 4.0),
        Quantity("more_above", "1", 0.5, -4.0, 4.0),
    )

    def applies(self, setup: Setup) -> bool:
        return setup.damping is not None and setup.drag is None

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        at = np.log(_relative(setup))
        below = np.minimum(at - np.log(BENDS[0]), 0)
        above = np.maximum(at - np.log(BENDS[1]), 0)
        parts = np.stack([at - np.log(MIDDLE), below, above], axis=-1)
        return setup._replace(drag=parts @ values)

    def law(self, setup: Setup) -> Law:
        return Law(
            "speed", "drag per length", "m/s", -3.0, _curve, _speeds,
            np.array([True, False, False]), _forms(setup), _sentence,
        )  # fmt: skip

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        note = "drag_law: resistance in proportion to speed only, that of the fitted linear law"
        return Exported(beside, settles=False, note=note)

    def sentence(self, values: dict[str, float]) -> str:
        return f"the air resists the rope as its speed to the power {1 + values['exponent']:.2g}"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("dashpot", label="drag over speed")


def _speed_scale(setup: Setup) -> float:
    """Return the speed [m/s] by which those of a swinging rope are measured, √(g L)."""
    length = float(setup.properties.length.sum())
    return (float(np.linalg.norm(setup.gravity)) * length) ** 0.5


def _relative(setup: Setup) -> np.ndarray:
    """Return (11,) the speeds of the law's knots over `_speed_scale`, within LOWEST and HIGHEST."""
    return np.clip(DRAG_SPEEDS / max(_speed_scale(setup), 1e-9), LOWEST, HIGHEST)


def _curve(setup: Setup, x: np.ndarray) -> np.ndarray:
    """Return (n,) drag per length [N/m] at speeds x (n,) [m/s], of the rope's first segment."""
    assert setup.damping is not None
    linear = float(setup.damping.air[0]) * x
    if setup.drag is None:
        return linear
    octaves = np.log2(np.maximum(x, 1e-9))
    factor = np.interp(octaves, np.log2(DRAG_SPEEDS), setup.drag)
    return linear * np.exp(factor)


def _speeds(setup: Setup, nodes: np.ndarray) -> np.ndarray:
    """Return the speeds [m/s] of the nodes (F, N+1, 3) [m] between neighbouring frames, of those at
    which drag need not be linear."""
    step = np.diff(setup.clock)
    near = (step > 0) & (step < LONG_PAUSE * np.median(step))
    moved = np.linalg.norm(np.diff(nodes, axis=0), axis=-1)[near] / step[near, None]
    return moved[np.isfinite(moved) & (moved > LOWEST * _speed_scale(setup))]


def _sentence(x: np.ndarray, y: np.ndarray, units: tuple[str, str]) -> str:
    power = float(np.log(y[1] / y[0]) / np.log(x[1] / x[0]))
    return (
        f"drag is not in proportion to speed: between {x[0]:.2g} and {x[1]:.2g} {units[0]} it "
        f"grows as speed^{power:.2g}"
    )


def _with_force(setup: Setup, force: Force, shape: np.ndarray) -> Setup:
    """Return the setup with a drag that is a function of the speed over `_speed_scale`."""
    at, middle = _relative(setup), np.array(MIDDLE)
    factor = force(at, shape) / at / (force(middle, shape) / middle)
    return setup._replace(drag=np.log(factor))


def _power(x: np.ndarray, n: np.ndarray) -> np.ndarray:
    return x**n


def _mixed(x: np.ndarray, at: np.ndarray) -> np.ndarray:
    return x + x**2 / at


def _forms(setup: Setup) -> tuple[Form, ...]:
    assert setup.damping is not None
    fall = _speed_scale(setup)

    exponents = np.linspace(0.2, 3.0, 29)[:, None]
    shares = np.geomspace(0.005, 5.0, 24)[:, None]

    def form(name: str, shape: str, tries: np.ndarray, force: Force, constants) -> Form:
        return Form(
            name, (shape,), ("1",), tries[0] / 2, tries[-1] * 2, tries,
            lambda s, v: _with_force(s, force, v[0]), constants,
        )  # fmt: skip

    def at_middle(s: Setup) -> float:
        return float(_curve(s, np.array([MIDDLE * fall]))[0])

    def power(s: Setup, v: np.ndarray) -> list[Constant]:
        n = float(v[0])
        return [
            Constant("F1", at_middle(s) / (MIDDLE * fall) ** n, -3.0),
            Constant("n", n, 0, False),
        ]

    def mixed(s: Setup, v: np.ndarray) -> list[Constant]:
        at, ratio = float(v[0]) * fall, MIDDLE / float(v[0])
        size = at_middle(s) / (ratio + ratio**2)
        return [Constant("F1", size, -3.0), Constant("v1", at, 0.0, False, "m/s")]

    return (
        form("F = F1 (v / 1 m/s)^n", "exponent", exponents, _power, power),
        form("F = F1 (v/v1 + (v/v1)^2)", "speed", shares, _mixed, mixed),
    )
