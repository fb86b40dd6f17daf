"""Terms: the parts of a model, each of which changes a setup by a few values.

A rope parameter, a calibration error or an effect. Values are searched in units of the term's own
scale, so that a step of one is a fair step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ropefit.effects.base import Effect
from ropefit.models.prior import Joint
from ropefit.models.slopes import Change
from ropefit.rod.setup import Setup

SIZE_PRIOR_SD = 3.0  # usual sizes: of the broad prior under which effects are compared
NEXT_TO_NOTHING = 1e-12  # of a saturating value's search variable, from where it is infinite

Apply = Callable[[Setup, np.ndarray], Setup]


@dataclass(frozen=True)
class Term:
    """A part of a model that changes a setup: `apply` takes values in SI; a value is
    scale * (search variable).

    start, lower, upper (n,) in SI; prior (n,) one-sigma in SI, inf for none; log: the search
    variable is the logarithm of the value over its start. saturating (n,) bool: values that may be
    infinite, searched as value / (value + scale). effect: that the term stands for, if any. joint:
    what it is known together with, and from which place there on its own values are; prior is then
    that of each by itself.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    apply: Apply
    start: np.ndarray
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    prior: np.ndarray
    log: bool = False
    nuisance: bool = False
    effect: Effect | None = None
    saturating: np.ndarray | None = None
    joint: tuple[Joint, int] | None = None

    @property
    def size(self) -> int:
        return len(self.names)

    @property
    def broad(self) -> np.ndarray:
        """Return (n,) one sigma of the search variables by the broad prior of an effect's sizes,
        half the way between their bounds where any size is plausible; inf where there is a prior
        of its own, or no size."""
        places = self.effect.place_names if self.effect else self.names
        size, usual = np.isinf(self.prior) & ~np.isin(self.names, places), SIZE_PRIOR_SD
        if self.effect is not None and np.isinf(self.effect.implausible):
            usual = 0.5 * (self.upper - self.lower) / self.scale
        return np.where(size, usual, np.inf)

    @property
    def in_direction(self) -> np.ndarray:
        """Return (n,) bool: components of a direction, whose length changes nothing."""
        return np.isin(self.names, self.effect.direction if self.effect else ())

    def with_unit_direction(self, u: np.ndarray) -> np.ndarray:
        """Return equivalent search variables (n,) with a direction of unit length."""
        components = self.in_direction
        if not components.any():
            return u
        value = self.value(u)
        length = float(np.linalg.norm(value[components]))
        return np.where(components, self.search(value / length), u) if length > 0 else u

    def value(self, u: np.ndarray) -> np.ndarray:
        """Return (n,) in SI from search variables (n,)."""
        if self.log:
            return self.start * np.exp(u)
        value = self.start + self.scale * u
        if self.saturating is None:
            return value
        rest = 1 - self._share(self.start) - u
        rest = np.where(rest == 0, NEXT_TO_NOTHING, rest)
        return np.where(self.saturating, self.scale * (1 / rest - 1), value)

    def value_of(self, u: float) -> float:
        """Return the first value in SI from its search variable, the others at their start."""
        return float(self.value(np.full(self.size, u))[0])

    def search(self, value: np.ndarray) -> np.ndarray:
        """Return (n,) search variables of values in SI."""
        if self.log:
            return np.log(value / self.start)
        u = (value - self.start) / self.scale
        if self.saturating is None:
            return u
        return np.where(self.saturating, self._share(value) - self._share(self.start), u)

    def _share(self, value: np.ndarray) -> np.ndarray:
        """Return (n,) value / (value + scale), 1 at infinity, of what saturates; else 0."""
        assert self.saturating is not None
        return 1 - self.scale / (np.where(self.saturating, value, 0.0) + self.scale)

    def slope(self, u: np.ndarray) -> np.ndarray:
        """Return (n,) derivative of the values in the search variables."""
        if self.log or self.saturating is None:
            return self.value(u) if self.log else self.scale
        stretched = (self.value(u) + self.scale) ** 2 / self.scale
        return np.where(self.saturating, stretched, self.scale)

    def interval(
        self, u: np.ndarray, covariance: np.ndarray, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (n,), (n,) values `width` standard deviations to either side, within the bounds;
        covariance (n, n) of the search variables."""
        half = width * np.sqrt(np.maximum(np.diag(covariance), 0))
        least, most = self.search(self.lower), self.search(self.upper)
        low, high = np.clip(u - half, least, most), np.clip(u + half, least, most)
        return self.value(low), self.value(high)


def merged(name: str, terms: list[Term], at_once: Apply | None = None) -> Term:
    """Return linear terms as one; at_once: the same as all of them one after the other."""
    last = np.cumsum([term.size for term in terms])

    def one_by_one(setup: Setup, v: np.ndarray) -> Setup:
        for term, end in zip(terms, last, strict=True):
            setup = term.apply(setup, v[end - term.size : end])
        return setup

    start, scale, lower, upper, prior = (
        np.concatenate([getattr(term, field) for term in terms])
        for field in ("start", "scale", "lower", "upper", "prior")
    )
    names = tuple(name for term in terms for name in term.names)
    units = tuple(unit for term in terms for unit in term.units)
    return Term(name, names, units, at_once or one_by_one, start, scale, lower, upper, prior)


def applied(setup: Setup, term: Term, value: np.ndarray) -> Setup:
    """Return a setup after a term of a value (n,) in SI."""
    return setup.after(lambda s: term.apply(s, value))


def value_at(term: Term, u: np.ndarray, k: int, step: float) -> np.ndarray:
    """Return a term's values in SI where the k-th of its search variables u (n,) has moved."""
    return term.value(u + step * (np.arange(term.size) == k))


def change_by(setup: Setup, term: Term, k: int) -> Change:
    """Return the change of a setup by a further term's k-th value, from the term's start."""
    start = np.zeros(term.size)
    return lambda step: applied(setup, term, value_at(term, start, k, step))
