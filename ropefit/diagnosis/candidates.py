"""Full fits of what the scan and the effects themselves propose, on top of a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ropefit.diagnosis.calm import distorted
from ropefit.diagnosis.candidate import (
    EVALUATIONS,
    TOLERANCE,
    Candidate,
    compared_if_comparable,
    fit_candidate,
    gain_of,
)
from ropefit.diagnosis.equivalence import ALSO_POSSIBLE_NATS
from ropefit.diagnosis.few_frames import far_behind
from ropefit.diagnosis.fits import Fits, Progress, best_first, silent
from ropefit.diagnosis.leaders import leading
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.scan import Score
from ropefit.diagnosis.stretches import significant_interval
from ropefit.diagnosis.unexplained import leaves_something, unexplained
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.objective import LEFT

LINEAR_STEPS = 2.0  # from where fits end, after so many evaluations, to their minimum, at most
MOST_SHOWN = 0.7  # of the χ² in excess of noise, explained in one place of a scan


def fit_candidates(
    current: Fit, scan: list[Score], quick: list[list[Start]], slow: list[list[Start]],
    threshold: float, names: tuple[str, ...] | None = None, progress: Progress = silent,
    for_noise: bool = False, known: Sequence[Candidate] = (),
) -> list[Candidate]:  # fmt: skip
    """Fit the leaders of a scan and what effects propose, on top of a model; best first.

    slow: what is fitted only unless the best of the others leaves next to nothing. names: of the
    effects that may be proposed; None: all. for_noise: the fits are made for the noise, for which
    the best place of each is enough. known: candidates on top of the model, fitted already, also
    from where else they may be.
    """
    leaders, further = leading(scan, threshold, current.point.setup)
    due = len(leaders) + len(further) + len(quick) + len(slow) + 1
    fits = Fits(current, threshold, progress, due, names=names, for_noise=for_noise)
    fits.best_of |= {one.hypothesis.key: one for one in known}
    slow = [choices for choices in slow if choices[0][0].key not in fits.best_of]
    for choices in quick:
        fits.add(choices)
    if fits.sufficient() and distorted(current):  # what a scan about it says is of no use
        leaders, further = [], []
    # With contact, what remembers is settled frame after frame, which takes long: it is fitted
    # last. Where the scan shows nothing that explains most of the misfit, it is likely to be what
    # does: then first, as those of the others end early beside it.
    last: list[list[Start]] = []
    if current.point.setup.potentials:
        slowest = [choices for choices in leaders if choices[0][0].effect.path_dependent]
        others = [choices for choices in leaders if not choices[0][0].effect.path_dependent]
        leaders, last = (others, slowest) if _shows_most(scan, current) else (slowest + others, [])
    for choices in leaders:
        fits.add(choices)
    first = fits.best()
    if further and not (first and fits.explained_by(first)):
        fits.add_kinds(further)
        first = fits.best()
    if (
        first
        and first.hypothesis.effect.locus == "interval"
        and first.evidence > threshold
        and not fits.explained_by(first)
    ):
        start = significant_interval(current, first.hypothesis)
        fits.add([] if start is None else [(first.hypothesis, start)])
        first = fits.best()
    if not fits.sufficient():
        late = [choices for choices in slow if choices[0][0].effect.late]
        if current.point.setup.remembers and not leaves_something(current):
            late = []  # with memory, every evaluation goes through all frames
        for choices in slow:
            # Bodies that do what another one does are proposed beside that.
            if not (choices[0][0].effect.late or fits.enough()):
                fits.add(choices)
        for name in dict.fromkeys(choices[0][0].name for choices in late):
            first = fits.best()
            # Effects of one name are kinds of one law, and compared in any case.
            if not fits.sufficient() or (first and first.hypothesis.name == name):
                fits.add_kinds([choices for choices in late if choices[0][0].name == name])
    for choices in [] if fits.sufficient() else last:
        fits.add(choices)
    first = fits.best()
    if first and first.evidence > threshold and not (for_noise and fits.enough()):
        for choices in fits.beside(first):
            if choices[0][0].key != first.hypothesis.key:
                fits.add(choices)
    fits.add_elsewhere(known)
    return fits.found()


def _shows_most(scan: list[Score], current: Fit) -> bool:
    """Return whether one place of a scan explains most of the misfit."""
    return max((s.score for s in scan), default=0.0) > MOST_SHOWN * unexplained(current)


def started_from(known: list[Candidate], starts: list[list[Start]]) -> list[list[Start]]:
    """Return the starts; one only of a hypothesis that is known, from where its fit ended, with
    its own alternatives in case that does not settle."""
    ended = {c.hypothesis.key: c.values() for c in known}
    out: list[list[Start]] = []
    for choices in starts:
        hypothesis = choices[0][0]
        if hypothesis.key not in ended:
            out.append(choices)
        elif all(hypothesis.key != other[0][0].key for other in out):
            out.append([(hypothesis, ended[hypothesis.key]), *choices])
    return out


def completed(
    current: Fit, candidates: list[Candidate], threshold: float,
    acceptable: Callable[[list[Candidate]], Candidate | None],
) -> list[Candidate]:  # fmt: skip
    """Return the candidates, best first, those fitted to the end that were stopped, or ended before
    their minimum, and may then not be ruled out beside the one that is acceptable; if none is, may
    have the evidence of a threshold [nats]."""
    ended: set[tuple[str, int]] = set()
    while True:
        best = acceptable(candidates)
        least = best.evidence - ALSO_POSSIBLE_NATS if best else threshold
        further = [c for c in candidates if unfinished(c) and c.hypothesis.key not in ended]
        first = next((c for c in further if promised(current, c) >= least), None)
        if first is None:
            return candidates
        ended.add(first.hypothesis.key)
        rest = [c for c in candidates if c is not first]
        needed = far_behind(best.fit) if best else np.inf
        candidates = best_first([*rest, _to_the_end(current, first, needed)])


def unfinished(candidate: Candidate) -> bool:
    """Return whether a fit was stopped, or, at rest, a linear step promises more."""
    fitted = candidate.fit
    if fitted.stopped or candidate.hypothesis.effect.slow or not fitted.forward.instantaneous:
        return fitted.stopped
    return not fitted.converged and fitted.left_to_gain > LEFT


def promised(current: Fit, candidate: Candidate) -> float:
    """Return the evidence [nats] that an unfinished candidate may have at its minimum, if that is
    as far as it is by linear steps along a valley; any, if it was stopped."""
    fitted = candidate.fit
    if fitted.stopped:
        return np.inf
    lowest = max(fitted.cost - LINEAR_STEPS * fitted.left_to_gain, 1e-9)
    spread = max(1.0, fitted.spread * lowest / fitted.cost)  # what it leaves scales evidence down
    penalty = gain_of(candidate) - candidate.evidence
    return 0.5 * (current.cost - lowest) / spread - penalty


def _to_the_end(current: Fit, candidate: Candidate, needed: float) -> Candidate:
    if candidate.fit.stopped:
        start = (candidate.hypothesis, candidate.values())
        return fit_candidate(current, *start, needed=needed) or candidate
    u, forward = candidate.fit.point.u, candidate.fit.forward
    forward = forward.starting_from(candidate.fit.point.solution)
    again = attempted(forward, current.problem, u, EVALUATIONS, TOLERANCE, thorough=True)
    found = compared_if_comparable(candidate.hypothesis, candidate.term, current, again)
    return candidate if found is None else found
