"""What laws have in common: an unknown function of one local variable, and forms that it may have.

A law is an effect of a few values of a curve, linear or absent at zero. Once it is accepted, each
`Form` is fitted in its place (`diagnosis.forms`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ropefit.rod.setup import Setup


class Constant(NamedTuple):
    """A constant of a formula: value in SI, of the unit of a rigidity EI (or 1, if not of_ei) times
    metre to a power; or of a unit of its own. inexact: the relative error (one sigma) that remains
    without noise: added to its interval in quadrature."""

    name: str
    value: float
    power: float
    of_ei: bool = True
    unit: str = ""
    inexact: float = 0.0


class Form(NamedTuple):
    """A formula for a law, with its own values (n,): names, units, bounds, and those from which one
    is chosen to begin a fit with, tries (T, n).

    apply(setup, values (n,)): the setup with the law; constants(setup, values): what the formula
    calls its constants, in SI, of a setup after `apply`. scale (n,): usual sizes, where the first
    value is a factor of the curve; None: the values are positive, and searched by their logarithms.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    tries: np.ndarray
    apply: Callable[[Setup, np.ndarray], Setup]
    constants: Callable[[Setup, np.ndarray], list[Constant]]
    scale: np.ndarray | None = None


class Law(NamedTuple):
    """A function y(x) in SI: names of both, x's unit, and y's as that of EI times metre to a power.

    curve(setup, x (n,)): y (n,) of a setup with the law; visited(setup, nodes (F, N+1, 3) [m]):
    values of x in the data; smooth (n,) bool: of the effect's values, those that are no departures
    from a smooth curve; forms: what it may be; sentence(x (2,), y (2,), units): the curve in words,
    by its values at both ends of what is visited; from_zero: whether x begins at zero; even: x is a
    place, of either sign, not a size.
    """

    x: str
    y: str
    unit_x: str
    power_y: float
    curve: Callable[[Setup, np.ndarray], np.ndarray]
    visited: Callable[[Setup, np.ndarray], np.ndarray]
    smooth: np.ndarray
    forms: tuple[Form, ...]
    sentence: Callable[[np.ndarray, np.ndarray, tuple[str, str]], str]
    from_zero: bool = True
    even: bool = False
