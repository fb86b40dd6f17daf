"""Equivalence: candidates that explain as much as the best, and which of them is named first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import chdtri

from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.nested import is_special_case
from ropefit.effects import Effect
from ropefit.effects.ends import end_next_to
from ropefit.inference.verdict import NORMAL_QUANTILE
from ropefit.models.terms import SIZE_PRIOR_SD

TIE_NATS = 3.0
SAME_SHARE, SAME_NATS = 0.98, 10.0  # of what the best explains, and so little behind
# Nats less likely: as much as that share leaves of an effect of score 12. Of what a weaker one
# explains that share is less than chance.
SAME_LIKELIHOOD = 1.5
LEAST_SIGNIFICANCE = 1.0  # standard errors from zero
# What is less likely by so much is not told as equivalent: odds of 150 to 1, as there are some ten
# candidates. Of how many samples of a model's misfit one is independent is known to a factor of
# two, and so is evidence by them.
ALSO_POSSIBLE_NATS, BY_MISFIT = 5.0, 2.0
CONFIDENCE = 0.95  # that the extra values of an effect are not those of its special case


def ordered(best: Candidate, same: list[Candidate]) -> tuple[Candidate, list[Candidate]]:
    """Return the candidate that is named first in a tie, and the others.

    Of physics and a measurement error the latter, unless held-out data tell them apart: evidence
    that ties is as good as the priors of sizes and places in it, which no held-out datum knows.
    What would explain the data only with values that are not possible comes last.
    """
    beyond = [c for c in (best, *same) if c.wants_beyond_bounds()]
    possible = [c for c in (best, *same) if c not in beyond]
    leader = max(possible, key=lambda c: c.evidence, default=best)
    if beyond and possible and best.evidence - leader.evidence < TIE_NATS:
        first, others = ordered(leader, [c for c in possible if c is not leader])
        return first, [*others, *beyond]
    first, others = _measurement_first(*_end_first(*_simplest_first(best, same)))
    better = [
        c
        for c in others
        if _is_physics(c) and first.evidence - c.evidence < TIE_NATS and _predicts_better(c, first)
    ]
    if _is_physics(first) or not better:
        return first, others
    leader = max(better, key=lambda c: c.evidence)
    physics = [c for c in others if _is_physics(c) and c is not leader]
    named = _simplest_first(leader, physics)[0]
    return named, [c for c in (first, *others) if c is not named]


def _is_physics(one: Candidate) -> bool:
    return one.hypothesis.effect.kind != "measurement"


def _predicts_better(one: Candidate, than: Candidate) -> bool:
    """Return whether a candidate predicts the same held-out data better than another."""
    alike = one.hypothesis.effect.held_out == than.hypothesis.effect.held_out
    return alike and _held_out_gain(one) - _held_out_gain(than) > TIE_NATS


def _held_out_gain(one: Candidate) -> float:
    """Return what held-out data gain by a candidate [nats], less what the errors of the set-up
    that it needs are unlikely."""
    unlikely = 0.5 * float(np.square(one.fit.prior.rows(one.fit.point.u)).sum())
    return float(one.gains.sum()) - unlikely / max(1.0, one.fit.spread)


def also_possible(first: Candidate, candidates: list[Candidate], before: float) -> list[Candidate]:
    """Return candidates that are less likely than the one that is named, but not by enough to rule
    them out, with those that are within reach, and those that contain it and are significantly
    likelier: however broad the priors of what they have besides; before: as below."""
    by_misfit = first.fit.problem.noise.misfit
    nats = ALSO_POSSIBLE_NATS * (BY_MISFIT if by_misfit else 1.0)
    out = equivalents(first, candidates, before, nats)
    more = [c for c in candidates if _contains(c, first) and _is_there(c) and _likelier(c, first)]
    return [*out, *(c for c in more if all(c is not known for known in out))]


def _likelier(general: Candidate, special: Candidate) -> bool:
    """Return whether what an effect has besides a special case of it explains significantly more,
    by the ratio of likelihoods (Wilks 1938)."""
    extra = max(_number_of_values(general) - _number_of_values(special), 1)
    return -2 * _less(general, special) > chdtri(extra, 1 - CONFIDENCE)


def equivalents(
    best: Candidate, candidates: list[Candidate], before: float, tie: float = TIE_NATS
) -> list[Candidate]:
    """Return candidates of other effects that are within reach of the best, or that explain nearly
    all that it does and are hardly worse, or physics that predicts held-out data better than these
    and is behind only by the penalty for its values, which is mostly how broad their priors are.

    before: χ² of the model without any of them. Each has its evidence by its own estimate of what
    is missed. Where much is explained, a difference of these in the fourth digit is many nats: by
    one and the same they are compared as well.
    """
    out, others = [], []
    for one in candidates:
        same_effect = one.hypothesis.name == best.hypothesis.name
        if one is best or same_effect or not (_contains(one, best) or _is_there(one)):
            continue
        share = (before - one.fit.cost) / max(before - best.fit.cost, 1e-9)
        less = _less(one, best)
        alike = less + _penalty(one, before) - _penalty(best, before)
        if within_reach(min(alike, best.evidence - one.evidence), share, less, tie):
            out.append(one)
        elif less < SAME_LIKELIHOOD and one.evidence > 0 and _is_physics(one):
            others.append(one)
    tied = (best, *out)
    return [*out, *(c for c in others if any(_predicts_better(c, than) for than in tied))]


def _less(one: Candidate, best: Candidate) -> float:
    """Return by how much less likely than the best one it makes the data [nats]."""
    return 0.5 * (one.fit.cost - best.fit.cost) / max(1.0, best.fit.spread)


def _penalty(one: Candidate, before: float) -> float:
    """Return by how much its free values lower its evidence [nats]; before: as above."""
    return 0.5 * (before - one.fit.cost) / max(1.0, one.fit.spread) - one.evidence


def _is_there(one: Candidate) -> bool:
    """Return whether a candidate's size is unlikely to be zero."""
    return one.significance() >= LEAST_SIGNIFICANCE


def _contains(one: Candidate, special: Candidate) -> bool:
    """Return whether another candidate is a special case of a plausible one."""
    effect = one.hypothesis.effect
    return one.plausible() and is_special_case(special.hypothesis.effect, effect)


def within_reach(behind: float, share: float, less: float = np.inf, tie: float = TIE_NATS) -> bool:
    """Return whether a candidate so far behind the best [nats], which explains such a share of what
    the best does, is as good; less [nats]: by how much less likely it makes the data; tie [nats]:
    how far behind any candidate is as good."""
    alike = share > SAME_SHARE or less < SAME_LIKELIHOOD
    return behind < tie or (alike and behind < SAME_NATS)


def _simplest_first(best: Candidate, same: list[Candidate]) -> tuple[Candidate, list[Candidate]]:
    """Name the candidate of a tie with the fewest values, none unusual, first, before others a
    special case of the best one; a force that can stand for much else only if nothing else is as
    good. What the extra values of the best one are worth is in its evidence, along with how broad
    the priors of sizes are: of a special case that is not significantly less likely no more than
    that makes the difference."""
    general = best.hypothesis.effect
    highest = max(c.evidence for c in (best, *same))  # fitted anew, the best one may be so no more
    tied = [
        c
        for c in (best, *same)
        if highest - c.evidence < TIE_NATS
        or (is_special_case(c.hypothesis.effect, general) and _less(c, best) < SAME_LIKELIHOOD)
    ]
    first = min(
        tied,
        key=lambda c: (
            _is_unusual(c),
            c.hypothesis.effect.stands_for_others,
            _number_of_values(c),
            not is_special_case(c.hypothesis.effect, general),
            -c.evidence,
        ),
    )
    return first, [c for c in (best, *same) if c is not first]


def _is_unusual(one: Candidate) -> bool:
    """Return whether a quantity is significantly further from zero than it mostly is."""
    mostly = np.isin(one.term.names, one.hypothesis.effect.nearly_zero)
    if not mostly.any():
        return False
    least = np.abs(one.values()) - NORMAL_QUANTILE * one.sd()
    return bool((least > SIZE_PRIOR_SD * one.term.scale)[mostly].any())


def _number_of_values(one: Candidate) -> int:
    """Return how many values a candidate has: what a prior holds explains nothing by itself, but
    where all values are held near a start, as those of a bar, the data have chosen that."""
    free = int(np.isinf(one.term.prior).sum())
    return free or len(one.term.prior)


def _end_first(best: Candidate, same: list[Candidate]) -> tuple[Candidate, list[Candidate]]:
    """Name an effect of an end before one of the rope next to it: what acts so near an end is seen
    as a moment about it, whatever exerts it."""
    end = _end_beside(best)
    if end is None:
        return best, same
    return _preferred(best, same, lambda e: (e.locus, e.kind, e.end) == ("end", "physics", end))


def _end_beside(one: Candidate) -> int | None:
    """Return which end an effect at a point of the rope is next to, if any."""
    effect = one.hypothesis.effect
    if effect.locus != "point":
        return None
    arc_length = one.values()[effect.names.index("arc_length")]
    return end_next_to(arc_length / float(one.fit.forward.base.properties.length.sum()))


def _measurement_first(best: Candidate, same: list[Candidate]) -> tuple[Candidate, list[Candidate]]:
    """Name the measurement first in a tie between physics and measurement."""
    if not _is_physics(best):
        return best, same
    return _preferred(best, same, lambda e: e.kind == "measurement")


def _preferred(
    best: Candidate, same: list[Candidate], wanted: Callable[[Effect], bool]
) -> tuple[Candidate, list[Candidate]]:
    """Name the first of the others whose effect is wanted before the best one, if there is any."""
    first = next((c for c in same if wanted(c.hypothesis.effect)), best)
    return first, [c for c in (best, *same) if c is not first]
