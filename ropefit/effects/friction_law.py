"""How friction inside a rope builds up with the change of curvature: Prandtl's law, and Dahl's.

The first builds up in proportion and then slides; after a reversal the moment changes by twice that
of half the change (Masing). The second builds up exponentially, over one range from no friction and
after a reversal alike; where the direction of bending turns it departs from Dahl's, see `rod.dahl`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ropefit.effects.law import Constant, Form, Law
from ropefit.rod.memory import Branch
from ropefit.rod.setup import Setup

# Relative errors (one sigma) of Dahl's moment and range without noise: where the ends turn between
# two frames, how far they had gone is not known, and what has faded across is not all of it.
INEXACT = (0.03, 0.08)
RANGES = np.geomspace(0.2, 5.0, 25)  # that are tried, over the fitted one
NEVER = np.array(np.inf)


class Element(NamedTuple):
    """bend () [N m²] its rigidity, slip () [1/m] where it slips, or over which it builds up
    gradually."""

    bend: np.ndarray
    slip: np.ndarray
    gradual: bool


def prandtl(moment: np.ndarray, reach: np.ndarray) -> Element:
    """Return the element of M = moment min(dk / reach, 1)."""
    return Element(moment / reach, reach, gradual=False)


def dahl(moment: np.ndarray, reach: np.ndarray) -> Element:
    """Return the element of M = moment (1 - exp(-dk / reach))."""
    return Element(moment / reach, reach, gradual=True)


def with_friction(setup: Setup, element: Element) -> Setup:
    """Return the setup with an element that is unloaded in the first frame."""
    bend = np.broadcast_to(element.bend, setup.properties.bend.shape)
    branch = Branch(bend, element.slip, NEVER, fresh=False, gradual=element.gradual)
    return setup._replace(memory=(*setup.memory, branch))


def friction_law(setup: Setup, usual: np.ndarray) -> Law:
    """Return the moment as a function of the change of curvature; usual (2,): moment [N m] and
    range [1/m]. Forms are tried from the friction that a setup has: where an element begins to
    slip, the misfit has no slope, and a fit from elsewhere may stop."""
    own = _elements(setup)
    known = [float(v) for v in (own[0].bend[0] * own[0].slip, own[0].slip)] if own else usual
    return Law(
        "change of curvature", "friction moment", "1/m", -1.0, _curve, _changes,
        np.array([True, True]), _forms(usual, np.array(known)), _sentence,
    )  # fmt: skip


def _elements(setup: Setup) -> list[Branch]:
    """Return the elements of friction: what yields from the rest shape, or relaxes, is none."""
    return [b for b in setup.memory if not b.fresh and bool(np.isinf(b.time))]


def _curve(setup: Setup, x: np.ndarray) -> np.ndarray:
    """Return (n,) moments [N m] of a rope's first segment after changes x (n,) [1/m] from where it
    was unloaded."""
    out = np.zeros_like(x)
    for element in _elements(setup):
        slip = float(element.slip)
        risen = -slip * np.expm1(-x / slip) if element.gradual else np.minimum(x, slip)
        out += float(element.bend[0]) * risen
    return out


def _changes(setup: Setup, nodes: np.ndarray) -> np.ndarray:
    """Return changes of curvature [1/m] at the inner nodes (F, N+1, 3) [m], from the least and the
    greatest curvature that each has."""
    step = np.diff(nodes, axis=1)
    length = np.linalg.norm(step, axis=-1)
    way = step / length[..., None]
    turned = np.linalg.norm(np.diff(way, axis=1), axis=-1)
    curvature = turned / (0.5 * (length[:, 1:] + length[:, :-1]))
    curvature = curvature[np.isfinite(curvature).all(axis=1)]
    ends = (curvature - curvature.min(axis=0), curvature.max(axis=0) - curvature)
    changes = np.concatenate([e.ravel() for e in ends])
    return changes[changes > 0]


def _sentence(x: np.ndarray, y: np.ndarray, units: tuple[str, str]) -> str:
    return (
        f"friction inside the rope resists a change of its bending: by {y[1]:.2g} {units[1]} after "
        f"a change of curvature by {x[1]:.2g} {units[0]}"
    )


def _forms(usual: np.ndarray, known: np.ndarray) -> tuple[Form, ...]:
    tries = known * np.stack([np.ones_like(RANGES), RANGES], axis=1)

    def form(
        name: str,
        element: Callable[[np.ndarray, np.ndarray], Element],
        inexact: tuple[float, float],
    ) -> Form:
        def constants(_: Setup, v: np.ndarray) -> list[Constant]:
            return [
                Constant("M0", float(v[0]), -1.0, inexact=inexact[0]),
                Constant("k0", float(v[1]), -1.0, False, inexact=inexact[1]),
            ]

        return Form(
            name, ("moment", "range"), ("N m", "1/m"), np.array([0.0, 1e-3 * usual[1]]),
            np.array([np.inf, 1e3 * usual[1]]), tries,
            lambda s, v: with_friction(s, element(v[0], v[1])), constants, usual,
        )  # fmt: skip

    return (
        form("Prandtl: M = M0 min(dk/k0, 1)", prandtl, (0.0, 0.0)),
        form("Dahl: M = M0 (1 - e^(-dk/k0))", dahl, INEXACT),
    )
