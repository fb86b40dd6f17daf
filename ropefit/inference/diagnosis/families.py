"""An effect with all its places: what a scan looks at, and how it becomes a term of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ropefit.effects import Effect, Obstacle, SupportPlane
from ropefit.models.equilibrium import Term
from ropefit.plugins import concrete
from ropefit.rod.setup import Setup

POINTS = 25  # places of a point effect along the rope
WIDTHS = (0.1, 0.2, 0.35, 0.6)  # of the length, of an interval effect
WHOLE = 0.9  # of the length: what is wider has no edges that could move
CONTACT = (SupportPlane, Obstacle)
NARROWEST = 0.04  # of the length: what is narrower is a point


@dataclass(frozen=True)
class Family:
    """One effect (at one end, if it has one) and the places (Q, p) where it may be: what shapes it,
    then where on the rope [m]."""

    effect: Effect
    places: np.ndarray

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def size(self) -> int:
        """Quantities at one place."""
        return len(self.effect.quantities) - self.effect.shaping

    @property
    def positive(self) -> bool:
        return self.size == 1 and self.effect.quantities[0].lower == 0.0

    def scales(self, setup: Setup) -> np.ndarray:
        """(k,) usual sizes in SI."""
        return np.array([q.size(setup) for q in self.effect.quantities[: self.size]])

    def term(self, setup: Setup, values: np.ndarray, free_place: bool = True) -> Term:
        """A term of a model that starts at values (k + p,): quantities, then the place."""
        length = float(setup.properties.length.sum())
        quantities = self.effect.quantities
        scale = np.array([*(q.size(setup) for q in quantities)])
        low = np.array([q.lower for q in quantities])
        high = np.array([q.upper for q in quantities])
        limits = {
            "arc_length": (0.0, length), "centre": (0.0, length),
            "width": (NARROWEST * length, 1.2 * length),
        }  # fmt: skip
        place = self.effect.place_names
        units = tuple(q.unit for q in quantities)
        if not free_place:
            fixed = torch.tensor(values[self.size :])

            def apply(setup: Setup, v: torch.Tensor) -> Setup:
                return self.effect.apply(setup, torch.cat([v, fixed]))

            k = self.size
            return Term(
                self.name, tuple(q.name for q in quantities[:k]), units[:k], apply, values[:k],
                scale[:k], low[:k], high[:k], np.full(k, np.inf),
            )  # fmt: skip
        # A bar may slide along itself: it stays near where the data propose it.
        near = scale if isinstance(self.effect, Obstacle) else np.full(len(values), np.inf)
        return Term(
            self.name, self.effect.names, (*units, *("m" for _ in place)), self.effect.apply,
            np.asarray(values, dtype=float), np.array([*scale, *(0.05 * length for _ in place)]),
            np.array([*low, *(limits[p][0] for p in place)]),
            np.array([*high, *(limits[p][1] for p in place)]),
            near,
        )  # fmt: skip


def families(setup: Setup) -> list[Family]:
    """Every effect that can occur in a setup, but contact, which has no small beginnings.

    Effects of installed add-ons are among them, see docs/adding-an-effect.md.
    """
    out = []
    for kind in concrete(Effect, "ropefit.effects"):
        if kind in CONTACT:
            continue
        for end in (0, 1) if kind.locus == "end" else (0,):
            effect = kind(end)  # pyright: ignore[reportAbstractUsage]
            if effect.applies(setup):
                out.append(Family(effect, _places(effect, setup)))
    return out


def _places(effect: Effect, setup: Setup) -> np.ndarray:
    length = float(setup.properties.length.sum())
    if effect.shaping:
        usual = [q.size(setup) for q in effect.quantities[-effect.shaping :]]
        return np.array([[share * size for size in usual] for share in effect.tries])
    if effect.locus == "point":
        return (np.linspace(0.02, 0.98, POINTS) * length)[:, None]
    if effect.locus != "interval":
        return np.zeros((1, 0))
    rows = [
        (c * length, w * length)
        for w in WIDTHS
        for c in np.linspace(w / 2, 1 - w / 2, round(2.0 / w))
    ]
    if effect.name == "intrinsic_curvature":
        rows.append((0.5 * length, WHOLE * length))
    return np.array(rows)
