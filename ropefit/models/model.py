"""What inference and diagnosis know of a model: a setup, terms that act on it, and predictions.

A model predicts where a recording shows the rope, frame by frame, says which frames it could
compute, and gives the first-order change of its prediction in any change of the setup
(`Point.respond`). `Equilibrium` settles every frame; `Dynamics` steps clips through time; `Xpbd`
iterates by the paper's Algorithm 1.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np

from ropefit.models.prior import Joint, Prior
from ropefit.models.response import Point
from ropefit.models.slopes import Change
from ropefit.models.terms import Term, applied, value_at
from ropefit.models.watched import Done, differing, done, followed, made_again
from ropefit.rod.differences import DIFFERENCE_STEP
from ropefit.rod.setup import Setup
from ropefit.runs.journal import Arrays
from ropefit.solvers.equilibrium.solution import States


@dataclass
class Model(ABC):
    """A base setup and the terms that act on it, in order; last: states from which it goes on.

    clips: indices of the frames of each stretch that is predicted from its own start.
    instantaneous: each frame's shape follows from its own loads and ends alone; no clips.
    """

    base: Setup
    terms: list[Term]
    last: States | None = field(default=None, repr=False)
    clips: list[np.ndarray] = field(default_factory=list)

    instantaneous: ClassVar[bool] = True

    @abstractmethod
    def at(self, u: np.ndarray, start: States | None = None) -> Point:
        """Predict at search variables u (P,). Frames that cannot be computed are NaN in `seen`."""

    @abstractmethod
    def kept(self, point: Point) -> Arrays:
        """Return what of a point, and of this model's memory, only computing it gives."""

    @abstractmethod
    def restored(self, u: np.ndarray, arrays: Arrays) -> Point:
        """Return the point at u that was kept; the model remembers what it did then."""

    def remember(self, point: Point) -> None:  # noqa: B027
        """Go on from the states of a point; by default there are none."""

    def folds(self, frames: int, count: int) -> np.ndarray:
        """Return (F,) the fold of each frame, below `count`: folds are held out one by one, by
        default neighbouring frames together."""
        return np.arange(frames) * count // frames

    @property
    def size(self) -> int:
        """Return P, the number of search variables."""
        return sum(term.size for term in self.terms)

    def starting_from(self, states: States) -> Self:
        """Return the same model, which goes on from other states of its frames."""
        return replace(self, last=states)

    def settling_at_once(self) -> Self:
        """Return the same model, which only marks frames that do not settle as they are, and
        begins none anew; by default itself."""
        return self

    def coarsened(self, point: Point) -> Self | None:
        """Return the model on a coarser mesh, with what that changes at a point added to whatever
        it predicts; None, by default, where there is none."""
        return None

    def horizon(self, seconds: float, most: float = np.inf) -> Self:
        """Return the model that predicts no further than this from what was observed, in parts of
        together at most `most` [s], evenly spread."""
        return self

    def corrected(self, u: np.ndarray) -> Self:
        """Return the model with its discretisation error at u (P,) added to what it predicts; by
        default itself, of a mesh that is fine enough."""
        return self

    def with_terms(self, terms: list[Term], states: States | None = None) -> Self:
        """Return the model with other terms, which goes on from other states."""
        return replace(self, terms=terms, last=states)

    def of_setup(
        self, setup: Setup, states: States | None = None, terms: list[Term] | None = None
    ) -> Self:
        """Return the model of another setup, with these terms only."""
        return replace(self, base=setup, terms=terms or [], last=states)

    def split(self, u: np.ndarray) -> list[np.ndarray]:
        """Return search variables term by term."""
        last = np.cumsum([term.size for term in self.terms], dtype=int)
        return [u[end - t.size : end] for t, end in zip(self.terms, last, strict=True)]

    def with_unit_directions(self, u: np.ndarray) -> np.ndarray:
        """Return equivalent search variables (P,) with directions of unit length."""
        parts = zip(self.terms, self.split(u), strict=True)
        return np.concatenate([np.empty(0), *(t.with_unit_direction(part) for t, part in parts)])

    def start(self) -> np.ndarray:
        """Return (P,) search variables at the terms' starts."""
        return np.zeros(self.size)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (P,), (P,) bounds of the search variables."""
        low = np.concatenate([t.search(t.lower) for t in self.terms] or [np.empty(0)])
        high = np.concatenate([t.search(t.upper) for t in self.terms] or [np.empty(0)])
        return low, high

    def prior(self) -> Prior:
        """Return what is known of the search variables beforehand."""
        groups: dict[Joint, tuple[list[int], list[int]]] = {}
        first = 0
        for term in self.terms:
            if term.joint is not None:
                joint, place = term.joint
                mine, there = groups.setdefault(joint, ([], []))
                mine += range(first, first + term.size)
                there += range(place, place + term.size)
            first += term.size
        together = tuple(
            (np.array(mine), joint.covariance[np.ix_(there, there)])
            for joint, (mine, there) in groups.items()
        )
        sd = np.concatenate([t.prior / t.scale for t in self.terms] or [np.empty(0)])
        return Prior(sd, together)

    def broad(self) -> np.ndarray:
        """Return (P,) one sigma of the search variables by the broad prior of the effects' sizes;
        inf for none."""
        return np.concatenate([t.broad for t in self.terms] or [np.empty(0)])

    def setup(self, values: list[np.ndarray]) -> Setup:
        """Return the setup with values (n,) in SI of every term."""
        setup = self.base
        for term, value in zip(self.terms, values, strict=True):
            setup = applied(setup, term, value)
        return setup

    def setup_at(self, u: np.ndarray) -> Setup:
        """Return the setup at search variables u (P,)."""
        parts = zip(self.terms, self.split(u), strict=True)
        return self.setup([term.value(part) for term, part in parts])

    def jacobian(self, point: Point) -> np.ndarray:
        """Return (P, F, K, 3) derivatives of `seen` in the search variables."""
        return point.respond(self.changes(point.u))

    def changes(self, u: np.ndarray) -> list[Change]:
        """Return the change of the setup by each search variable, at u (P,); of a rope that
        remembers that of all the frames that it has been through."""
        parts = self.split(u)
        base, made = self._made(self.base, parts)
        if made and made[-1].after.remembers:
            base, made = self._made(self.base.whole()[0], parts)
        # Differences to one side, where u itself is known, of what has a prior, of which a step is
        # next to nothing (errors of the set-up, a rope that another recording tells), and of all
        # beside what takes long to apply.
        costly = any(term.effect is not None and term.effect.costly for term in self.terms)
        known = [bool(np.isfinite(term.prior).all()) for term in self.terms]
        middle = [DIFFERENCE_STEP if costly or one else 0.0 for one in known]
        return [
            partial(self._change, base, made, parts, number, k, middle[number])
            for number, term in enumerate(self.terms)
            for k in range(term.size)
        ]

    def _made(self, base: Setup, parts: list[np.ndarray]) -> tuple[Setup, list[Done]]:
        """Return a setup without its past, and what each term makes of it."""
        base = setup = base._replace(past=None)
        made = []
        for term, part in zip(self.terms, parts, strict=True):
            value = term.value(part)
            made.append(done(setup, lambda s, t=term, v=value: t.apply(s, v)))
            setup = made[-1].after
        return base, followed(made)

    def _change(
        self, base: Setup, made: list[Done], parts: list[np.ndarray], number: int, k: int,
        middle: float, step: float,
    ) -> Setup:  # fmt: skip
        """Return the setup where one term's k-th value has moved by a step from the middle; made:
        by all terms."""
        if middle + step == 0.0:
            return made[-1].after
        term = self.terms[number]
        before = made[number - 1].after if number else base
        setup = term.apply(before, value_at(term, parts[number], k, middle + step))
        return made_again(setup, differing(setup, made[number].after), made[number + 1 :])
