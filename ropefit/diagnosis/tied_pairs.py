"""Two accepted effects, with what is as good in the place of one beside the other.

Effects that were accepted as a pair were compared with other pairs as a whole, of which only a
better one takes their place. One that is as good, and has one of the two, is a tie of the other.
"""

from __future__ import annotations

from dataclasses import replace

from ropefit.diagnosis.acceptance import refusal
from ropefit.diagnosis.accepted import Accepted, accept, close_cost
from ropefit.diagnosis.candidate import comparable, compared, fit_candidate
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.reassessment import without_effects
from ropefit.inference.least_squares import Fit


def with_ties(
    current: Fit, accepted: list[Accepted], pairs: list[list[Start]], tried: int
) -> tuple[Fit, list[Accepted]]:
    """Return two accepted effects with their ties, of pairs that explain few frames about as well;
    at most one of them gives way to what is named before it, and the fit is then that one's.

    tried: how many hypotheses were scanned.
    """
    if len(accepted) != 2:
        return current, accepted
    for k, one in enumerate(accepted):
        starts = _in_place_of(one, accepted[1 - k], pairs)
        without = without_effects(current, one.candidate) if starts else None
        if without is None or not comparable(current, without):
            continue
        held = compared(one.candidate.hypothesis, one.candidate.term, without, current)
        needed = close_cost(without, held.fit)
        fits = [fit_candidate(without, *start, needed=needed) for start in starts]
        others = [c for c in fits if c is not None and not refusal(c, without)]
        now = accept(held, [held, *others], without, tried)
        names = {c.hypothesis.name for c in (now.candidate, *now.equivalent)}
        known = [one.candidate, *one.equivalent]
        if names <= {c.hypothesis.name for c in known}:
            continue
        same = [*now.equivalent, *(c for c in one.equivalent if c.hypothesis.name not in names)]
        now = replace(now, equivalent=same, beaten=one.beaten)
        out = [now if a is one else a for a in accepted]
        if now.candidate.hypothesis.name != one.candidate.hypothesis.name:
            return now.candidate.fit, out
        accepted = out
    return current, accepted


def _in_place_of(one: Accepted, other: Accepted, pairs: list[list[Start]]) -> list[Start]:
    """Return where what stands beside the other effect in some pairs begins, but the effect itself
    and its ties; the first of each."""
    known = {c.hypothesis.name for c in (one.candidate, *one.equivalent)}
    beside = other.candidate.hypothesis.name
    out: dict[tuple[str, int], Start] = {}
    for both in pairs:
        for start, (companion, _) in (both, both[::-1]):
            if companion.name == beside and start[0].name not in known:
                out.setdefault(start[0].key, start)
    return list(out.values())
