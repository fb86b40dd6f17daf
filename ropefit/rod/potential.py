"""Energies of single nodes: contact, tethers, fields of force, and what plug-ins add."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

STEP = 1e-5  # m: of central differences of fourth order, where an energy is all that is given
WEIGHTS = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}


class Potential(NamedTuple):
    """An energy [J] of single nodes: energy(x (..., 3)) -> (...,), times share (N+1,) per node.

    Smooth, or with a corner in its slope: contact, of a hardness [N/m], and perhaps with a
    coefficient of friction, which acts on some nodes for all, by their shares `rubbing`. cornered:
    its slope has corners that steps towards its lowest place may leap over. derivatives(x): slope
    (..., 3) and curvature (..., 3, 3) of the energy in closed form; None: by central differences.
    slope(x): the first of them, where it costs less alone. quadratic: there is no more to it.
    """

    energy: Callable[[np.ndarray], np.ndarray]
    share: np.ndarray
    hardness: np.ndarray | None = None
    friction: np.ndarray | None = None
    rubbing: np.ndarray | None = None
    cornered: bool = False
    derivatives: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    slope: Callable[[np.ndarray], np.ndarray] | None = None
    quadratic: bool = False


def slope_of(p: Potential, x: np.ndarray) -> np.ndarray:
    """Return the slope (..., 3) [N] of a whole node's energy at places x (..., 3) [m]."""
    if p.slope is not None:
        return p.slope(x)
    return p.derivatives(x)[0] if p.derivatives is not None else differences(p.energy, x)


def derivatives_of(p: Potential, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return slope (..., 3) [N] and curvature (..., 3, 3) [N/m] of a whole node's energy."""
    if p.derivatives is not None:
        return p.derivatives(x)
    return slope_of(p, x), differences(lambda at: slope_of(p, at), x)


def differences(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Return the derivative of function(x (..., 3)) -> (..., *m) along the three axes, last:
    (..., *m, 3)."""
    steps = STEP * np.eye(3)
    along = [sum(w * function(x + k * step) for k, w in WEIGHTS.items()) / STEP for step in steps]
    return np.stack([np.asarray(a) for a in along], axis=-1)
