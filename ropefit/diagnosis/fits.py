"""Fits of hypotheses on top of one model, with the best of each, and whether more are needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ropefit.diagnosis.acceptance import significant
from ropefit.diagnosis.accepted import CLOSE_EVIDENCE, least_evidence
from ropefit.diagnosis.beginning import LATE_GAIN, most_promising_first
from ropefit.diagnosis.branch_repair import on_right_branches
from ropefit.diagnosis.candidate import (
    TOLERANCE,
    Candidate,
    best_of,
    cost_for,
    fit_candidate,
    gain_of,
    pace,
)
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.few_frames import FAR_BEHIND, far_behind, on_few_frames
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.proposals import Start, proposals_beside, uneven
from ropefit.diagnosis.quick_fits import alike, quick_ones, unknown_frames
from ropefit.diagnosis.unexplained import explained, leaves_something, unexplained
from ropefit.inference.least_squares import Fit
from ropefit.inference.objective import OPTIMISM

NEARLY_NOTHING = 1e-3  # of the χ² in excess of noise
FOR_NOISE = 1e-3  # tolerance of fits that are made for the noise
MOST_SPREAD = 10.0  # times the usual tolerance, where the smaller model misses much
MOST_MINIMA = 4  # of one hypothesis, each better than the one before
EXPLORING = 8  # evaluations of each start of a late effect; the best is fitted further

Progress = Callable[[float, str], None]


def silent(share: float, text: str) -> None:
    """Report nothing."""


@dataclass
class Fits:
    """Candidates on top of one model, the best of each hypothesis."""

    current: Fit
    threshold: float
    progress: Progress = silent
    due: int = 1  # starts that may be fitted
    best_of: dict[tuple[str, int], Candidate] = field(default_factory=dict)
    tied: list[Candidate] = field(default_factory=list)  # with the best one of their hypothesis
    names: tuple[str, ...] | None = None
    for_noise: bool = False  # they tell what of a misfit is no noise
    begun: int = 0
    _moving: dict[int, tuple[Candidate, bool]] = field(default_factory=dict)

    def add(self, choices: list[Start], below: float = np.inf) -> None:
        """Fit the first start that settles; it is kept if its cost is `below`."""
        self._report(choices)
        found = self._first(choices)
        self._keep(found if found and found.fit.cost < below else None)

    def add_kinds(self, starts: list[list[Start]]) -> None:
        """Fit kinds of one law, each from where the best of its starts ends after a few evaluations
        on few frames: those that come near there to what counts, and move all frames in a way that
        gains. Where one explains all frames, only those that came close to it."""
        few = on_few_frames(self.current) or self.current
        explored = best_of([self._explored(few, choices) for choices in starts])
        best, share = self.best(), self._share(few)
        highest = max((c.evidence for c in explored), default=0.0)
        if best and best.plausible():
            highest = max(highest, share * best.evidence)
        for candidate in explored:
            if OPTIMISM * gain_of(candidate) < share * self._least_evidence():
                continue
            further = 0.5 * EXPLORING * pace(candidate.fit)  # nats, by as many evaluations again
            if candidate.evidence + further < highest - FAR_BEHIND:
                continue
            close = CLOSE_EVIDENCE * explored[0].evidence
            if self.sufficient() and candidate.evidence < close:
                break
            if not candidate.fit.stopped:
                start = (candidate.hypothesis, candidate.values())
                self._keep(self._fitted(start, LATE_GAIN))

    def add_elsewhere(self, known: Sequence[Candidate] = ()) -> None:
        """Fit bodies that the rope touches from where else they may be; not those `known`."""
        for one in self.found():
            # Others have no further starts: what they leave costs time.
            has_further = one.hypothesis.effect.slow and one.fit.cost < self.most_cost()
            if not has_further or self.far_behind(one) or any(one is k for k in known):
                continue
            if one is self.best() or not self.for_noise:
                self._elsewhere(one)

    def _elsewhere(self, one: Candidate) -> None:
        """Fit a candidate's hypothesis from where its effect proposes other minima, as long as one
        of them is better, by more than a tie."""
        key = one.hypothesis.key
        for _ in range(MOST_MINIMA):
            for choices in self.beside(one):
                if choices[0][0].key == key:
                    self.add(choices, below=one.fit.cost)
            before, one = one, self.best_of[key]
            if before.fit.cost - one.fit.cost < 2 * TIE_NATS:
                return

    def beside(self, one: Candidate) -> list[list[Start]]:
        """Return starts of what may fit as well as a candidate does."""
        return proposals_beside(one.hypothesis.effect, one.values(), one.fit, self.names)

    def _explored(self, few: Fit, choices: list[Start]) -> Candidate | None:
        """Return the first of a kind's starts that settles, fitted for a while to few frames."""
        self._report(choices)
        share, evidence = self._share(few), self._least_evidence()
        fitted = (
            fit_candidate(
                few, *start, needed=cost_for(few, share * evidence), evaluations=EXPLORING,
                least_gain=share * LATE_GAIN,
            )
            for start in choices
        )  # fmt: skip
        return next((c for c in fitted if c is not None), None)

    def _report(self, choices: list[Start]) -> None:
        if choices:
            share = min(self.begun / self.due, 1.0)
            self.progress(share, f"fit of {choices[0][0].name.replace('_', ' ')}")
        self.begun += 1

    def _first(self, choices: list[Start]) -> Candidate | None:
        every = most_promising_first(self.current, choices)
        fitted = (self._fitted(start) for start in every)
        return next((c for c in fitted if c is not None), None)

    def _keep(self, candidate: Candidate | None) -> None:
        if candidate is None:
            return
        better = candidate.fit if self.far_behind(candidate) else on_right_branches(candidate.fit)
        if better is not candidate.fit:
            again = self._fitted((candidate.hypothesis, candidate.values()))
            candidate = again or candidate
        better, *others = best_first([*self.of_hypothesis(candidate.hypothesis), candidate])
        self.best_of[better.hypothesis.key] = better
        self.tied = [c for c in self.tied if c.hypothesis.key != better.hypothesis.key]
        self.tied += [c for c in others if better.evidence - c.evidence < TIE_NATS]

    def of_hypothesis(self, hypothesis: Hypothesis) -> list[Candidate]:
        """Return the best candidate of a hypothesis and those that tie with it, best first."""
        best = self.best_of.get(hypothesis.key)
        return [best, *(c for c in self.tied if c.hypothesis.key == hypothesis.key)] if best else []

    def found(self) -> list[Candidate]:
        """Return the best candidate of each hypothesis, best first; of a tie the best of a
        significant size. (A stretch that weighs less ties with the rest of the rope weighing more,
        and where it ends is open.)"""
        tied = [self.of_hypothesis(best.hypothesis) for best in self.best_of.values()]
        return best_first([next(filter(significant, every), every[0]) for every in tied])

    def _fitted(self, start: Start, least_gain: float = 0.0) -> Candidate | None:
        best = self.best()
        lowest = min(best.fit.cost if best else np.inf, self.most_cost())
        needed = self._needed(start[0])
        return fit_candidate(
            self.current, *start, lowest, needed, least_gain=least_gain, tolerance=self._tolerance()
        )

    def _tolerance(self) -> float:
        """Return the relative decrease of the cost at which fits end: where only the noise is asked
        for soon, and the sooner the more the smaller model misses, as that scales evidence down."""
        if self.for_noise:
            return FOR_NOISE
        return TOLERANCE * min(max(1.0, self.current.spread), MOST_SPREAD)

    def most_cost(self) -> float:
        """Return the cost without prospect of which slow fits are not continued, nor begun
        elsewhere: where only the noise is asked for, that of one that counts."""
        return cost_for(self.current, self.threshold) if self.for_noise else np.inf

    def _needed(self, hypothesis: Hypothesis) -> float:
        """Return the cost at which a candidate begins to count: it may be accepted, or is close to
        the best, and better than what is known of the same hypothesis."""
        known, best = self.best_of.get(hypothesis.key), self.best()
        cost = cost_for(self.current, self._least_evidence())
        if best is not None:  # what may tie with it counts, whatever the smaller model misses
            cost = max(cost, min(far_behind(best.fit), self.current.cost))
        return cost if known is None else min(cost, known.fit.cost + 2 * TIE_NATS)

    def _least_evidence(self) -> float:
        """Return the evidence [nats] from which a candidate counts."""
        best = self.best()
        return least_evidence(self.threshold, best.evidence if best else 0.0)

    def _share(self, few: Fit) -> float:
        """Return the share of the data that a fit to few frames has."""
        return len(few.z) / len(self.current.z)

    def best(self) -> Candidate | None:
        return max(self.best_of.values(), key=lambda c: c.evidence, default=None)

    def explained_by(self, candidate: Candidate) -> bool:
        """Return whether a candidate leaves next to nothing."""
        return explained(self.current, candidate.fit)

    def enough(self) -> bool:
        """Return whether the best candidate is a body that the rope touches and leaves no more than
        noise, in all frames alike; where only the noise is asked for, explains them alike."""
        best = self.best()
        if best is None or not best.hypothesis.effect.slow:
            return False
        if self.for_noise:
            return self.sufficient()
        return self._leaves_noise(best)

    @staticmethod
    def _leaves_noise(candidate: Candidate) -> bool:
        """Return whether a candidate leaves no more than noise, in all frames alike."""
        return not (leaves_something(candidate.fit) or uneven(candidate.fit))

    def far_behind(self, candidate: Candidate) -> bool:
        """Return whether a candidate does not come close to the best one, and that is enough."""
        best = self.best()
        if best is None or candidate.evidence >= CLOSE_EVIDENCE * best.evidence:
            return False
        return self.enough() or (best.hypothesis.effect.late and self._leaves_noise(best))

    def sufficient(self) -> bool:
        """Return whether no slow fit is needed: a candidate within reach of the best explains all
        frames alike, or is an error of the set-up that explains nearly all; contact is then fitted
        beside it."""
        best = self.best()
        return best is not None and any(
            self._suffices(one)
            for one in self.best_of.values()
            if best.evidence - one.evidence < TIE_NATS
        )

    def _suffices(self, candidate: Candidate) -> bool:
        measurement = candidate.hypothesis.effect.kind == "measurement"
        left, was = unexplained(candidate.fit), unexplained(self.current)
        if measurement and left <= NEARLY_NOTHING * was:
            return True
        if self.explained_by(candidate) and not uneven(candidate.fit):
            return True
        return candidate.evidence > self.threshold and self._suffices_in_motion(candidate)

    def _suffices_in_motion(self, candidate: Candidate) -> bool:
        """Return whether the rope moves, and a candidate with what every rope in motion has, as
        inertia, explains all frames alike."""
        if candidate.fit.point.setup.motion is None:
            return False
        known = self._moving.get(id(candidate))
        if known is None or known[0] is not candidate:
            quick = quick_ones(candidate.fit, self.threshold, self.names)
            last = quick[-1].fit if quick else candidate.fit
            enough = explained(self.current, last) and alike(last, unknown_frames(candidate))
            self._moving[id(candidate)] = known = (candidate, enough)
        return known[1]


def best_first(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return candidates by their evidence, highest first."""
    return sorted(candidates, key=lambda c: -c.evidence)
