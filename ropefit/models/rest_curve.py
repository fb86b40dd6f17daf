"""The shape of a rope on which nothing acts, as parameters: its curvature, uniform or varying.

About the rope's own two directions across it, those of the clamps, transported along it.
"""

from __future__ import annotations

import numpy as np

from ropefit.effects.place import QUARTERS, between_quarters
from ropefit.models.terms import Apply
from ropefit.rod.setup import Setup

UNIFORM = ("curvature_1", "curvature_2")
VARYING = tuple(f"{name}_at_{place}" for name in UNIFORM for place in QUARTERS)
NAMES = (*UNIFORM, *VARYING)
SHORT = "rest_curve"  # stands for all of `VARYING`
UNIFORM_BOUND, VARYING_BOUND = 5.0, 20.0  # 1/m per length, of a uniform and of a varying curvature
ACROSS = ("", ", across the first")


def spelled_out(names: list[str]) -> list[str]:
    """Return the names, `SHORT` replaced by what it stands for."""
    return [full for name in names for full in (VARYING if name == SHORT else (name,))]


def meaning(name: str) -> str:
    """Return the meaning of a parameter in words."""
    uniform, _, place = _parted(name)
    where = f" at {place} % of the length" if place else ""
    return f"rest curvature{where}{ACROSS[UNIFORM.index(uniform)]}"


def bound(name: str, setup: Setup) -> float:
    """Return [1/m] that no rope's rest curvature exceeds."""
    most = UNIFORM_BOUND if name in UNIFORM else VARYING_BOUND
    return most / float(setup.properties.length.sum())


def apply(*names: str) -> Apply:
    """Return adds curvatures [1/m]: each everywhere, or at one of `QUARTERS` and less and less up
    to the next."""
    which = [QUARTERS.index(int(place)) if place else -1 for _, _, place in map(_parted, names)]
    about = np.zeros((len(names), 3))
    about[range(len(names)), [UNIFORM.index(uniform) for uniform, _, _ in map(_parted, names)]] = 1

    def added(setup: Setup, v: np.ndarray) -> Setup:
        p = setup.properties
        near = np.pad(between_quarters(setup), ((0, 0), (0, 1)), constant_values=1.0)
        curvature = p.curvature + near[:, which] @ (v[:, None] * about)
        return setup._replace(properties=p._replace(curvature=curvature))

    return added


def _parted(name: str) -> tuple[str, str, str]:
    return name.partition("_at_")
