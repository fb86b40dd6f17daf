"""Pairs of effects as fitted to few frames, until the best of them are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.few_frames import far_behind
from ropefit.diagnosis.pairs import together
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.unexplained import leaves_something
from ropefit.inference.least_squares import Fit, attempted
from ropefit.models.terms import Term

EVALUATIONS, LOOK = 11, 4  # of such a fit, and of those after which it is known which go on
MOST_CONTINUED = 10  # pairs, of those that come closest by then
LEFT_OF_FEW = 1.0  # standard errors of χ²: few frames show little
ALIKE, ENOUGH = 1.0, 2  # of χ², within which fits of one pair are the same; so many are enough
MOST_FITTED = 3  # pairs fitted to all, and the best one from where else it may be
APART = 0.1  # of the length: places so far from each other are other minima

ScannedPair = tuple[float, Start, Start]  # log evidence [nats]
Kinds = frozenset[tuple[str, int]]
Begun = tuple[list[Start], list[Term], Fit]


@dataclass(frozen=True)
class Explored:
    """Where the fit of a pair to few frames ended, and its log evidence there [nats]."""

    evidence: float
    starts: list[Start]
    fit: Fit

    @property
    def kinds(self) -> Kinds:
        return _kinds(self.starts)

    def far_from(self, starts: list[Start]) -> bool:
        """Return whether one of the two effects is elsewhere than where it starts."""
        least = APART * float(self.fit.forward.base.properties.length.sum())
        ours, theirs = (dict(map(_place, both)) for both in (self.starts, starts))
        return any(abs(place - theirs[key]) > least for key, place in ours.items())


def explored(
    few: Fit, pairs: list[ScannedPair], ended: dict[Kinds, list[Explored]], rank: int,
    needed: float = np.inf,
) -> list[Explored]:  # fmt: skip
    """Return the fits of pairs to few frames, those that come closest after a few evaluations
    fitted further; ended: the fits of every two hypotheses, which are not fitted again about where
    several have ended alike. A fit without prospect of the cost that is `needed`, or of coming
    close to the best one of its hypotheses or to the two of a `rank`, is stopped."""
    begun = [one for _, *both in pairs if (one := _begun(few, both, ended)) is not None]
    out: list[Explored] = []
    for both, terms, short in sorted(begun, key=lambda one: one[2].cost)[:MOST_CONTINUED]:
        before = ended[_kinds(both)]
        if _known(both, before):
            continue
        fitted = attempted(
            short.forward, few.problem, short.point.u, EVALUATIONS - LOOK, tolerance=1e-4,
            needed=min(needed, _needed(before), _needed(_ranked(ended, rank))),
        )  # fmt: skip
        if fitted is None or fitted.stopped or len(fitted.z) != len(few.z):
            continue
        parts = fitted.forward.split(fitted.point.u)[-2:]
        values = [term.value(part) for term, part in zip(terms, parts, strict=True)]
        starts = [(h, v) for (h, _), v in zip(both, values, strict=True)]
        out.append(Explored(together(few, fitted), starts, fitted))
        before.append(out[-1])
    return out


def _begun(few: Fit, both: list[Start], ended: dict[Kinds, list[Explored]]) -> Begun | None:
    """Return a pair, its terms, and its fit after a few evaluations; None if it does not settle, or
    is known."""
    begun = None if _known(both, ended[_kinds(both)]) else settled_start(few, both)
    if begun is None:
        return None
    short = attempted(begun.forward, few.problem, begun.values, LOOK, tolerance=1e-4, matched=False)
    if short is None or len(short.z) != len(few.z):
        return None
    short.forward.remember(short.point)
    return both, begun.terms, short


def _known(both: list[Start], before: list[Explored]) -> bool:
    """Return whether several fits of a pair have ended alike, not far from where one starts."""
    lowest = min((one.fit.cost for one in before), default=np.inf)
    alike = [one for one in before if one.fit.cost < lowest + ALIKE]
    return len(alike) >= _enough(alike) and not alike[0].far_from(both)


def _enough(alike: list[Explored]) -> int:
    """Return how many fits of one pair have to end alike: the one that leaves no more than noise
    is not bettered by another."""
    return 1 if alike and not leaves_something(alike[0].fit, LEFT_OF_FEW) else ENOUGH


def _needed(better: list[Explored]) -> float:
    """Return the cost of a fit that is not far behind the best of these; any, if there is none."""
    best = min(better, key=lambda one: one.fit.cost, default=None)
    return np.inf if best is None else far_behind(best.fit)


def _ranked(ended: dict[Kinds, list[Explored]], rank: int) -> list[Explored]:
    """Return the fits of the two hypotheses of a rank, 0 for the best ones, if there are so many;
    of the best ones where these leave no more than noise, as what is far behind is not the best."""
    best = {kinds: min(fits, key=lambda one: one.fit.cost) for kinds, fits in ended.items() if fits}
    ranked = sorted(best, key=lambda kinds: best[kinds].fit.cost)
    if ranked and not leaves_something(best[ranked[0]].fit, LEFT_OF_FEW):
        rank = 0
    return ended[ranked[rank]] if len(ranked) > rank else []


def _kinds(both: list[Start]) -> Kinds:
    return frozenset(hypothesis.key for hypothesis, _ in both)


def _place(start: Start) -> tuple[tuple[str, int], float]:
    """Return which hypothesis a start is of, and where that is: the arc length or centre [m]."""
    (hypothesis, values), names = start, start[0].effect.names
    places = [float(values[names.index(n)]) for n in ("arc_length", "centre") if n in names]
    return hypothesis.key, places[0] if places else 0.0


def best_explored(fits: list[Explored]) -> list[Explored]:
    """Return the best fit of each two hypotheses, few of them, best first; last the best fit of the
    first two with one of them elsewhere."""
    best: dict[Kinds, Explored] = {}
    every = sorted(fits, key=lambda one: -one.evidence)
    for one in every:
        best.setdefault(one.kinds, one)
    out = list(best.values())[:MOST_FITTED]
    alike = [one for one in every if out and one.kinds == out[0].kinds]
    return out + [one for one in alike if one.far_from(out[0].starts)][:1]
