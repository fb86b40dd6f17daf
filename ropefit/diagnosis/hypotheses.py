"""Hypotheses: an effect with all its places, as the scan tries it, and as a term of a model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ropefit.effects import Effect
from ropefit.models.terms import Term
from ropefit.plugins import EFFECTS, concrete
from ropefit.rod.setup import Setup

NARROWEST = 0.04  # of the length: a narrower section is a point
WIDEST = 1.2  # of the length: bound of a section's width
PLACE_SCALE = 0.05  # of the length: a fair step of a search over places
NO_PLACE = np.zeros((1, 0))


@dataclass(frozen=True)
class Hypothesis:
    """An effect (at one end, if it has one) and the places (Q, p) where it may be: its shaping
    quantities, then where on the rope [m]."""

    effect: Effect
    places: np.ndarray

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def key(self) -> tuple[str, int]:
        """Return what identifies a hypothesis: the class of the effect, and its end."""
        return type(self.effect).__name__, self.effect.end

    @property
    def size(self) -> int:
        """Return the number of quantities at one place."""
        return len(self.effect.quantities) - self.effect.shaping

    @property
    def positive(self) -> bool:
        return self.size == 1 and self.effect.quantities[0].lower == 0.0

    def scales(self, setup: Setup) -> np.ndarray:
        """Return (k,) usual sizes in SI."""
        return np.array([q.size(setup) for q in self.effect.quantities[: self.size]])

    def term(self, setup: Setup, values: np.ndarray) -> Term:
        """Return a term of a model that starts at values (k + p,): quantities, then the place."""
        length = float(setup.properties.length.sum())
        quantities = self.effect.quantities
        limits = {
            "arc_length": (0.0, length), "centre": (0.0, length),
            "width": (NARROWEST * length, WIDEST * length),
        }  # fmt: skip
        lower, upper = self.effect.bounds(setup)
        place, step = self.effect.place_names, PLACE_SCALE * length
        return Term(
            self.name, self.effect.names, (*(q.unit for q in quantities), *("m" for _ in place)),
            self.effect.apply, np.asarray(values, dtype=float),
            np.array([*(q.size(setup) for q in quantities), *(step for _ in place)]),
            np.array([*lower, *(limits[p][0] for p in place)]),
            np.array([*upper, *(limits[p][1] for p in place)]),
            self.effect.start_sd(setup), effect=self.effect,
            saturating=np.array([*(q.saturates for q in quantities), *(False for _ in place)]),
        )  # fmt: skip

    def term_at(self, setup: Setup, values: np.ndarray) -> Term:
        """Return a term of the quantities (k,) only, starting at values (k + p,): the place is
        fixed."""
        k, fixed = self.size, values[self.size :]
        quantities = self.effect.quantities[:k]
        lower, upper = self.effect.bounds(setup)

        def apply(setup: Setup, v: np.ndarray) -> Setup:
            return self.effect.apply(setup, np.concatenate([v, fixed]))

        return Term(
            self.name, tuple(q.name for q in quantities), tuple(q.unit for q in quantities), apply,
            values[:k], self.scales(setup), np.array(lower[:k]), np.array(upper[:k]),
            np.full(k, np.inf), effect=self.effect,
            saturating=np.array([q.saturates for q in quantities]),
        )  # fmt: skip


def hypotheses(setup: Setup, names: tuple[str, ...] | None = None) -> list[Hypothesis]:
    """Return a hypothesis for every effect that a setup can have and a scan can show."""
    every = effects_of(setup, names)
    return [Hypothesis(e, e.scan_places(setup)) for e in every if e.scanned]


def effects_of(setup: Setup, names: tuple[str, ...] | None = None) -> Iterator[Effect]:
    """Yield all effects that can occur in a setup, or those of some names, at each of their ends.

    Effects of installed add-ons are among them, see docs/adding-an-effect.md.
    """
    for kind in concrete(Effect, EFFECTS):
        for end in (0, 1) if kind.locus == "end" else (0,):
            effect = kind(end)  # pyright: ignore[reportAbstractUsage]
            if effect.path_dependent and setup.followers:  # a walk knows no forces that turn
                continue
            if (names is None or effect.name in names) and effect.possible(setup):
                yield effect


def made_possible(
    changed: Setup, before: Setup, names: tuple[str, ...] | None = None
) -> list[Effect]:
    """Return the effects that can occur in a changed setup, but not in it as it was before: as
    friction on what is touched now."""
    known = {type(effect) for effect in effects_of(before, names)}
    return [effect for effect in effects_of(changed, names) if type(effect) not in known]
