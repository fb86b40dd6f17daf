"""Whether accepted effects still hold once another one is known.

The first effect had to stand for all that was missing, and may have been accepted for that. Beside
the others something else may explain more in its place, or nothing may be left for it to explain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.acceptance import first_acceptable, significant
from ropefit.diagnosis.accepted import Accepted, accept, close_cost
from ropefit.diagnosis.beginning import HOPELESS
from ropefit.diagnosis.candidate import Candidate, best_of, comparable, compared, fit_candidate
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.last_fit import last_fit
from ropefit.diagnosis.proposals import proposals_beside
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.problem import FitProblem
from ropefit.models.terms import Term

EVALUATIONS = 20


def reassessed(
    current: Fit, accepted: list[Accepted], threshold: float, tried: int,
    names: tuple[str, ...] | None = None,
) -> tuple[Fit, list[Accepted]]:  # fmt: skip
    """Return the model and its effects, each compared once more beside the others.

    The last one is compared only if another changed: it was accepted beside them. tried: how many
    hypotheses were scanned; names: of the effects that are looked for; None: all.
    """
    out, changed = list(accepted), False
    for index, one in enumerate(accepted):
        if one is accepted[-1] and not changed:
            break
        after = [f.candidate for f in accepted[index + 1 :]]
        if _needed(current, one.candidate, after):
            continue
        without = without_effects(current, one.candidate)
        if without is None or not comparable(current, without):
            continue
        # As it is: in another order of the terms it might act on another setup.
        held = compared(one.candidate.hypothesis, one.candidate.term, without, current)
        close = close_cost(without, held.fit)  # one that does not come near is stopped
        fitted = [
            fit_candidate(without, c.hypothesis, c.values(), needed=close) for c in one.beaten
        ]
        later = [replace(c, fit=current) for c in after]
        # The other parameters, as fitted with the effect, are a bad start for another one in its
        # place; but where that one was beaten, effects stood beside it that may have changed.
        if later and not changed:
            fitted += [refitted_beside(c, later, without, close) for c in one.beaten]
        candidates = _with_their_like(without, best_of([held, *fitted]), names)
        better = [
            c for c in candidates
            if c.evidence > held.evidence + TIE_NATS and c.fit.cost < current.cost
        ]  # fmt: skip
        if not better and 0.5 * (without.cost - current.cost) < threshold and len(out) > 1:
            out = [f for f in out if f is not one]
            current, changed = without, True
            continue
        # Even where it keeps its place, others may explain as much beside the rest.
        best = first_acceptable(better, threshold, without, []) or held
        now = accept(best, candidates, without, tried)
        out = [now if f is one else f for f in out]
        current, changed = now.candidate.fit, changed or now.candidate is not held
    return current, out


def refitted_beside(
    candidate: Candidate, later: list[Candidate], without: Fit, needed: float
) -> Candidate | None:
    """Return a candidate from where its own fit left it, with later effects beside it; stopped
    where it is without prospect of the cost that is `needed`, and where it begins too far off: each
    was fitted in the other's place, and both may bend the rope twice as much as it is bent."""
    parts = [
        *parts_of(candidate.fit), *(p for c in later for p in parts_of(c.fit) if p[0] is c.term),
    ]  # fmt: skip
    parts.sort(key=lambda part: part[0] is candidate.term)
    highest = HOPELESS * without.cost
    fitted = fitted_again(candidate.fit, parts, without.problem, needed, highest)
    if fitted is None or len(fitted.z) != len(without.z):
        return None
    return compared(candidate.hypothesis, candidate.term, without, fitted)


def last_fit_without(current: Fit, one: Accepted, accepted: list[Accepted]) -> Fit | None:
    """Return the last fit without one of the accepted effects; None where another one needs it, or
    the model without it does not settle."""
    if _needed(current, one.candidate, [f.candidate for f in accepted if f is not one]):
        return None
    without = without_effects(current, one.candidate)
    if without is None or not comparable(current, without):
        return None
    return last_fit(without)


def without_insignificant(
    current: Fit, accepted: list[Accepted], threshold: float
) -> tuple[Fit, list[Accepted]]:
    """Return a last fit and its effects without those whose sizes it leaves not significantly
    different from zero, where the others explain as much alone."""
    out = list(accepted)
    for one in accepted:
        if len(out) == 1 or significant(replace(one.candidate, fit=current)):
            continue
        without = last_fit_without(current, one, out)
        if without is not None and 0.5 * (without.cost - current.cost) < threshold:
            current, out = without, [f for f in out if f is not one]
    return current, out


def _with_their_like(
    without: Fit, candidates: list[Candidate], names: tuple[str, ...] | None
) -> list[Candidate]:
    """Return candidates with what may do the same as one of them and was not fitted: a plane for a
    bar, or the bar elsewhere."""
    lowest, known = candidates[0].fit.cost, {c.hypothesis.key for c in candidates}
    fitted = [
        fit_candidate(without, *choices[0], lowest)
        for one in candidates
        for choices in proposals_beside(one.hypothesis.effect, one.values(), one.fit, names)
        if choices[0][0].key == one.hypothesis.key or choices[0][0].key not in known
    ]
    return best_of([*candidates, *fitted])


def _needed(current: Fit, candidate: Candidate, later: list[Candidate]) -> bool:
    """Return whether a later effect needs a candidate's, as friction needs contact."""
    rest = [part for part in parts_of(current) if part[0] is not candidate.term]
    values = [term.value(u) for term, u in rest]
    setup = current.forward.with_terms([term for term, _ in rest]).setup(values)
    return not all(c.hypothesis.effect.applies(setup) for c in later)


def without_effects(current: Fit, *candidates: Candidate) -> Fit | None:
    """Return the model without some effects."""
    theirs = {id(candidate.term) for candidate in candidates}
    rest = [part for part in parts_of(current) if id(part[0]) not in theirs]
    return fitted_again(current, rest, current.problem)


def parts_of(fitted: Fit) -> list[tuple[Term, np.ndarray]]:
    """Return the terms of a fit, each with its search variables."""
    return list(zip(fitted.forward.terms, fitted.forward.split(fitted.point.u), strict=True))


def fitted_again(
    fitted: Fit, parts: list[tuple[Term, np.ndarray]], problem: FitProblem,
    needed: float = np.inf, highest: float = np.inf,
) -> Fit | None:  # fmt: skip
    """Return the fit of a model of some terms, in that order, from their values in another fit;
    stopped where it is without prospect of the cost that is `needed`, or begins above `highest`."""
    forward = fitted.forward.with_terms([term for term, _ in parts], fitted.point.solution)
    begin = np.concatenate([part for _, part in parts])
    return attempted(
        forward, problem, begin, EVALUATIONS, tolerance=1e-5, needed=needed, highest=highest
    )
