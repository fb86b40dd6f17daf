"""Nested hypotheses: an effect that contains a simpler one (`Effect.special_cases`).

Where what the general effect has besides is not significantly different from zero, the special one
is fitted in full from its values. What the extra quantities are worth is the difference of the
two's evidence; `equivalence` names the simplest within reach.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ropefit.diagnosis.candidate import EVALUATIONS, Candidate, compared
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.effects import Effect
from ropefit.effects.base import SpecialCase
from ropefit.inference.least_squares import Fit, attempted

MOST_SIGNIFICANCE = 6.0  # standard errors from zero: beyond, a quantity is there


def as_usual(best: Candidate, without: Fit, within: float) -> Candidate:
    """Return the candidate as fitted from the more usual values that do the same, if there are any
    and its evidence is then at most `within` nats less."""
    setup = best.fit.forward.base
    values = best.hypothesis.effect.more_usual(setup, best.values())
    if values is None:
        return best
    usual = _fitted_from(best, best.hypothesis, values, without)
    return best if usual is None or best.evidence - usual.evidence > within else usual


def with_special_cases(
    best: Candidate, candidates: list[Candidate], without: Fit
) -> list[Candidate]:
    """Return candidates with the special cases of the best one, and theirs, as fitted from its
    values if that is better than what is known of them; highest evidence first.

    without: the model without any of them.
    """
    out = {c.hypothesis.key: c for c in (best, *candidates)}
    general = [best]
    for one in general:  # grows
        effect, setup = one.hypothesis.effect, one.fit.forward.base
        for case in effect.special_cases:
            special, values = case.effect(effect.end), case.values(setup, one.values())
            if values is None or not special.applies(setup) or not vanishing(one, case):
                continue
            hypothesis = Hypothesis(special, NO_PLACE)
            fitted, known = _fitted_from(one, hypothesis, values, without), out.get(hypothesis.key)
            if fitted is not None and (known is None or fitted.evidence > known.evidence):
                out[hypothesis.key] = fitted
            if hypothesis.key in out:
                general.append(out[hypothesis.key])
    return sorted(out.values(), key=lambda c: -c.evidence)


def with_general_cases(candidates: list[Candidate], without: Fit) -> list[Candidate]:
    """Return candidates, highest evidence first; those whose fits ran to sizes that are not
    plausible as fitted from the values of the best special case of theirs: there they are as likely
    as that is, and plausible."""
    out = []
    for one in candidates:
        again, kind = None, type(one.hypothesis.effect)
        if not one.plausible():
            values = ((c, _as_general(kind, c)) for c in candidates if c.plausible())
            special = next(((c, v) for c, v in values if v is not None), None)
            again = special and _fitted_from(special[0], one.hypothesis, special[1], without)
        out.append(again if again is not None and again.plausible() else one)
    return sorted(out, key=lambda c: -c.evidence)


def _as_general(kind: type[Effect], special: Candidate) -> np.ndarray | None:
    """Return the values of an effect of a kind that do what a candidate does, a special case of it;
    None if it is none, or these are not known."""
    setup = special.fit.forward.base
    for case in kind.special_cases:
        if case.effect is type(special.hypothesis.effect):
            values = special.values()
        else:
            values = _as_general(case.effect, special)
        if values is not None and case.general is not None:
            return case.general(setup, values)
    return None


def _fitted_from(
    known: Candidate, hypothesis: Hypothesis, values: np.ndarray, without: Fit
) -> Candidate | None:
    """Return a hypothesis fitted in a candidate's place, all else beginning as it was there; None
    if it cannot be."""
    model = known.fit.forward
    term, parts = hypothesis.term(model.base, values), model.split(known.fit.point.u)
    others = [(t, u) for t, u in zip(model.terms, parts, strict=True) if t is not known.term]
    forward = model.with_terms([*(t for t, _ in others), term], known.fit.point.solution)
    begin = np.concatenate([*(u for _, u in others), np.zeros(term.size)])
    fitted = attempted(forward, without.problem, begin, EVALUATIONS, tolerance=1e-5)
    if fitted is None or not fitted.point.converged.all() or len(fitted.z) != len(without.z):
        return None
    return compared(hypothesis, term, without, fitted)


def vanishing(candidate: Candidate, case: SpecialCase) -> bool:
    """Return whether the quantities that a special case lacks may be zero."""
    term = candidate.term
    extra = np.isin(term.names, case.vanishing)
    least = np.where(term.lower > 0, term.lower, 0.0)
    off = candidate.values() - least
    return bool((np.abs(off) <= MOST_SIGNIFICANCE * candidate.sd())[extra].all())


def is_special_case(effect: Effect, of: Effect) -> bool:
    """Return whether an effect is a special case of another one, or of one of its."""
    return type(effect) in _contained(type(of))


def _contained(kind: type[Effect]) -> Iterator[type[Effect]]:
    for case in kind.special_cases:
        yield case.effect
        yield from _contained(case.effect)
