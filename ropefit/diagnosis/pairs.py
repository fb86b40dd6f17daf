"""Two of a kind: one effect at two places at once, as of two weights on one rope.

One such effect alone lies somewhere between the two, or is taken for a wide one, and a search that
accepts one effect after the other begins from there. The scan over pairs of places costs no solve:
a pair's score follows from what is known of its places.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ropefit.diagnosis.acceptance import refusal
from ropefit.diagnosis.accepted import Accepted, accept, close_cost
from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.candidate import (
    EVALUATIONS,
    Candidate,
    best_of,
    comparable,
    compared,
    cost_for,
    fit_candidate,
    occam_factor,
)
from ropefit.diagnosis.equivalence import TIE_NATS, within_reach
from ropefit.diagnosis.hypotheses import NARROWEST, NO_PLACE, Hypothesis
from ropefit.diagnosis.nested import is_special_case
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.reassessment import without_effects
from ropefit.diagnosis.scan import Projection
from ropefit.diagnosis.sensitivities import Sensitivities, Sensitivity
from ropefit.diagnosis.unexplained import unexplained
from ropefit.effects import CATALOGUE, Effect
from ropefit.effects.base import MAY_LEAVE
from ropefit.inference.least_squares import Fit, attempted
from ropefit.rod.setup import Setup

PRIOR_SIZE = 3.0  # usual sizes: keeps the sizes of two places nearby from running away
LEAST_APART = 2  # places of the scan

Pair = tuple[list[tuple[Candidate, Fit]], Fit]  # candidates, each with the model without it; both


def best_pair(
    current: Fit, known: list[Sensitivity], single: Candidate | None, threshold: float
) -> Pair | None:
    """Return two candidates of one effect, each with the model without it, and the fit with both.

    None unless together they leave next to nothing, are better than the best single candidate, if
    any, and each of them passes every gate beside the other. known: sensitivities of the current
    model.
    """
    found = _scanned(current, known)
    saved = current.cost - single.fit.cost if single else 0.0
    if found is None or found[0] < saved + 2 * threshold:
        return None
    alone = single.evidence if single else 0.0
    return fitted_pair(current, found[1], threshold, alone + TIE_NATS, MAY_LEAVE)


def as_points(
    current: Fit, accepted: list[Accepted], threshold: float
) -> tuple[Fit, list[Accepted]]:
    """Return two accepted stretches as two points, unless their widths are worth their evidence;
    the pair that is not named is equivalent where it is within reach.

    Two overlapping sections can be what two weights are: neither is a weight beside the other, so
    that the pairs are compared as a whole.
    """
    if len(accepted) != 2 or not current.forward.instantaneous:
        return current, accepted
    one, other = (a.candidate.hypothesis.effect for a in accepted)
    if type(one) is not type(other) or one.locus != "interval":
        return current, accepted
    base = without_effects(current, *(a.candidate for a in accepted))
    if base is None:
        return current, accepted
    setup, responses = base.forward.base, Sensitivities(base)
    points = [
        responses.of(Hypothesis(e, e.scan_places(setup)))
        for e in (kind() for kind in CATALOGUE if is_special_case(kind(), one))
        if e.locus == "point" and e.applies(setup)
    ]
    found = _scanned(base, points)
    pair = fitted_pair(base, found[1], threshold) if found else None
    if pair is None:
        return current, accepted
    behind = together(base, current) - together(base, pair[1])
    share = (base.cost - pair[1].cost) / max(base.cost - current.cost, 1e-9)
    if not within_reach(behind, share):
        return current, accepted
    both = [c for c, _ in pair[0]]
    if behind > TIE_NATS:
        return current, [replace(a, equivalent=[*a.equivalent, *both]) for a in accepted]
    wide = [a.candidate for a in accepted]
    return pair[1], [
        Accepted(c, wide, c.evidence, a.p_value) for c, a in zip(both, accepted, strict=True)
    ]


def accepted_pair(
    pair: Pair, tried: int, others: Sequence[Sequence[Start]] = ((), ())
) -> tuple[list[Accepted], Fit]:
    """Return both candidates as accepted, with the stretches that explain as much in their place,
    or what else does, higher evidence first; and the fit with both.

    At most one of them gives way to what explains more, or is a special case of it, and was fitted
    beside the other as it is: where both would, the one that gains more by that. tried: how many
    hypotheses were scanned; others: hypotheses to fit in place of either, and from which values.
    """
    out, changed = [], []
    for (candidate, beside), starts in zip(pair[0], others, strict=True):
        # What is far behind is not kept, and stopped.
        needed = close_cost(beside, candidate.fit)
        fits = [fit_candidate(beside, *start, needed=needed) for start in starts]
        same = [*_spread_out(candidate, beside), *(one for one in fits if one is not None)]
        out.append(_accepted_beside(beside, candidate, same, tried))
        if out[-1].candidate is not candidate:
            changed.append((out[-1].evidence - candidate.evidence, len(out) - 1))
    if not changed:
        return _by_evidence(out), pair[1]
    (_, most), *others_changed = sorted(changed, reverse=True)
    for _, k in others_changed:
        out[k] = _kept(out[k], pair[0][k][0])
    return _by_evidence(out), out[most].candidate.fit


def _by_evidence(accepted: list[Accepted]) -> list[Accepted]:
    return sorted(accepted, key=lambda one: -one.evidence)


def _kept(one: Accepted, candidate: Candidate) -> Accepted:
    """Return a candidate as accepted that does not give way: what would have been named instead is
    as good if it explains about as much, or is a special case of it."""
    effect = candidate.hypothesis.effect
    same = [
        c for c in (one.candidate, *one.equivalent)
        if c is not candidate
        and (c.evidence < candidate.evidence + TIE_NATS
             or is_special_case(c.hypothesis.effect, effect))
    ]  # fmt: skip
    return replace(one, candidate=candidate, equivalent=same, evidence=candidate.evidence)


def _accepted_beside(
    beside: Fit, candidate: Candidate, same: list[Candidate], tried: int
) -> Accepted:
    """Return a candidate of a pair, or what explains more in its place, as accepted."""
    one = accept(candidate, [candidate, *same], beside, tried)
    every = best_of([one.candidate, candidate, *same, *one.equivalent, *one.beaten])
    more = [c for c in every if c.evidence > candidate.evidence + TIE_NATS]
    best = next((c for c in more if not refusal(c, beside)), None)
    return one if best is None else accept(best, every, beside, tried)


def _spread_out(point: Candidate, beside: Fit) -> list[Candidate]:
    """Return fits of effects of the same quantities as a point has, or as one of its special cases
    has, on a stretch about it."""
    setup = beside.forward.base
    width = 2 * NARROWEST * float(setup.properties.length.sum())
    fits = [
        fit_candidate(beside, Hypothesis(wide, NO_PLACE), np.array([*values, width]))
        for effect, values in _with_special_cases(point.hypothesis.effect, point.values(), setup)
        for wide in (kind() for kind in CATALOGUE if is_special_case(effect, kind()))
        if wide.locus == "interval" and _units(wide) == _units(effect)
    ]
    return [one for one in fits if one is not None]


def _with_special_cases(
    effect: Effect, values: np.ndarray, setup: Setup
) -> Iterator[tuple[Effect, np.ndarray]]:
    """Yield an effect and its special cases with the values that are nearest to its own."""
    yield effect, values
    for case in effect.special_cases:
        nearest = case.values(setup, values)
        if nearest is not None:
            yield from _with_special_cases(case.effect(effect.end), nearest, setup)


def _units(effect: Effect) -> list[str]:
    return [quantity.unit for quantity in effect.quantities]


def together(base: Fit, both: Fit, count: int = 2) -> float:
    """Return the log evidence of so many effects, the last terms, over the model without them."""
    gain = 0.5 * (base.cost - both.cost) / max(1.0, both.spread)
    return gain - occam_factor(both, *both.forward.terms[-count:])


def fitted_pair(
    current: Fit, starts: list[Start], threshold: float, least: float = -np.inf,
    may_leave: float = np.inf,
) -> Pair | None:  # fmt: skip
    """Return two effects, or one at two places, fitted from where they start; None unless each
    passes every gate beside the other, and together they have more than the `least` evidence [nats]
    and leave no more of the misfit than they may."""
    begun = settled_start(current, starts)
    if begun is None:
        return None
    model, terms = begun.forward, begun.terms
    left = may_leave * max(unexplained(current), 0.0)
    needed = min(len(current.z) + left, cost_for(current, max(least, 0.0)))
    both = attempted(model, current.problem, begun.values, EVALUATIONS, 1e-5, needed)
    if both is None or both.stopped or not comparable(both, current):
        return None
    much = unexplained(both) > left
    if much or together(current, both) <= least:
        return None
    own, out = current.forward.terms, []
    parts = dict(zip(map(id, model.terms), model.split(both.point.u), strict=True))
    for k, (mine, other) in enumerate((terms, terms[::-1])):
        forward = current.forward.with_terms([*own, other], both.point.solution)
        u = np.concatenate([parts[id(term)] for term in forward.terms])
        beside = attempted(forward, current.problem, u, EVALUATIONS, tolerance=1e-5)
        if beside is None or len(beside.z) != len(both.z):
            return None
        candidate = compared(starts[k][0], mine, beside, both)
        if candidate.evidence < threshold or refusal(candidate, beside):
            return None
        out.append((candidate, beside))
    return out, both


def _scanned(current: Fit, known: list[Sensitivity]) -> tuple[float, list[Start]] | None:
    """Return by how much the pair of the highest evidence lowers χ², to first order, and where its
    fit starts.

    By evidence: two tethers always lower it more than the two weights that they contain.
    """
    project, best, most = Projection(current), None, -np.inf
    setup = current.forward.base
    for one in known:
        hypothesis = one.hypothesis
        if hypothesis.effect.locus != "point" or not hypothesis.effect.linear:
            continue
        many, k = one.values.shape[1:]
        flat = one.values.reshape(len(one.values), -1)
        a, b = flat.T @ project(flat), flat.T @ project.z
        scales = hypothesis.scales(setup)
        for p, q in combinations(range(many), 2):
            if q - p < LEAST_APART:
                continue
            rows = np.r_[k * p : k * p + k, k * q : k * q + k]
            strength = a[np.ix_(rows, rows)]
            sizes = np.linalg.solve(strength + np.eye(2 * k) / PRIOR_SIZE**2, b[rows])
            gain = float(sizes @ b[rows])
            cost = np.linalg.slogdet(np.eye(2 * k) + PRIOR_SIZE**2 * strength)[1]
            if hypothesis.positive and sizes.min() < 0:
                continue
            if gain - cost > most:
                most = gain - cost
                starts: list[Start] = [
                    (hypothesis, np.concatenate([scales * part, hypothesis.places[place]]))
                    for part, place in ((sizes[:k], p), (sizes[k:], q))
                ]
                best = gain, starts
    return best
