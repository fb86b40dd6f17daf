"""What the journal knows of one fit: evaluations that need not be made again."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ropefit.models.model import Model
from ropefit.models.response import Point
from ropefit.runs.arrays import within
from ropefit.runs.journal import Arrays, journal


def settled(forward: Model, u: np.ndarray, name: str = "") -> Point:
    """Return the model at u, kept under a name, or known."""
    name = name or journal().next("settled")
    known = journal().recall(name)
    if known and np.array_equal(known["u"], u):
        return forward.restored(u, known)
    point = forward.at(u)
    journal().keep(name, lambda: {"u": u, **forward.kept(point)})
    return point


class Known:
    """One fit of a forward model. Of a fit under way every row of numbers that the optimiser was
    given is kept, and the latest state, from which the next would be found; of one that is done,
    where it began and ended."""

    def __init__(self, forward: Model, start: np.ndarray):
        self.forward, self.name = forward, journal().next("fit")
        self.done = journal().recall(self.name)
        if self.done and not np.array_equal(self.done["start"], start):
            self.done = None
        self.start, self.resumed = start, False
        self.best: Point | None = None
        self.count = {"square": 0, "slope": 0}

    def begin(self) -> Point:
        """Return the model where the fit begins."""
        if self.done:
            return self.forward.restored(self.start, within("first.", self.done))
        return settled(self.forward, self.start, f"{self.name}/first")

    def at(self, u: np.ndarray) -> Point:
        """Return the model at u, from the best state so far: where a rope has two equilibria, a
        step that was not taken may have left the one that the fit is in."""
        if self.done:
            return self.forward.restored(u, within("best.", self.done))
        if not self.resumed:
            self.resumed = True
            latest = self._recalled("latest")
            if latest is not None and np.array_equal(latest.u, u):
                return latest
            self.best = self._recalled("so far") or self.best
        if self.best is not None:
            self.forward.remember(self.best)
            if np.array_equal(self.best.u, u):  # resumed: else it is kept where it was asked for
                return self.best
        point = self.forward.at(u)
        journal().keep(f"{self.name}/latest", lambda: {"u": u, **self.forward.kept(point)})
        return point

    def _recalled(self, name: str) -> Point | None:
        known = journal().recall(f"{self.name}/{name}")
        return self.forward.restored(known["u"], known) if known else None

    def improved(self, point: Point) -> None:
        """Take a point as the best so far."""
        if self.forward.instantaneous:
            self.best = point
            name = f"{self.name}/so far"
            journal().keep(name, lambda: {"u": point.u, **self.forward.kept(point)})

    def rows(self, kind: str, u: np.ndarray, make: Callable[[], np.ndarray]) -> np.ndarray:
        """Return what the optimiser asks for next, "square" or "slope", at u."""
        name = f"{self.name}/{kind} {self.count[kind]}"
        self.count[kind] += 1
        known = journal().recall(name)
        if known and np.array_equal(known["u"], u):
            return known["rows"].copy()
        rows = make()
        journal().keep(name, lambda: {"u": u, "rows": rows})
        return rows

    def result(self, find: Callable[[], tuple[Arrays, Point]]) -> Arrays:
        """Return what the fit comes to: found, with the model there, or known."""
        if self.done:
            return self.done
        first = journal().recall(f"{self.name}/first") or {}
        found, point = find()
        journal().keep(
            self.name,
            lambda: {
                "start": self.start,
                **found,
                **{f"first.{name}": value for name, value in first.items()},
                **{f"best.{name}": value for name, value in self.forward.kept(point).items()},
            },
        )
        return found
