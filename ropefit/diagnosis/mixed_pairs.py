"""Two effects of different kinds at once, where one after the other leads astray.

The first effect that is accepted stands for all that is missing, and the second is chosen beside
it: neither gives way alone where only both together are wrong. A scan over all pairs of hypotheses
and places costs no further solve. Its order is of the first order: the leading pairs are fitted to
few frames, and the best of these to all and compared with what was accepted. Where much is missed
the first order leads astray: what scores highest beside each of the best single candidates, as
fitted, is compared with them. One of a pair may be right while the other stands for what is really
there: where the best pair leaves something, so is what scores highest beside either of its two.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from ropefit.diagnosis.accepted import Accepted, least_evidence
from ropefit.diagnosis.candidate import Candidate, cost_for
from ropefit.diagnosis.coarse_mesh import on_coarse_mesh
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.explored_pairs import (
    LEFT_OF_FEW,
    MOST_FITTED,
    Explored,
    Kinds,
    ScannedPair,
    best_explored,
    explored,
)
from ropefit.diagnosis.few_frames import FAR_BEHIND, on_few_frames
from ropefit.diagnosis.full_scan import Scan, sensitivities
from ropefit.diagnosis.hypotheses import Hypothesis, hypotheses
from ropefit.diagnosis.nested import is_special_case
from ropefit.diagnosis.pairs import PRIOR_SIZE, accepted_pair, fitted_pair, together
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.reassessment import without_effects
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.scan import Projection
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.diagnosis.tied_pairs import with_ties
from ropefit.diagnosis.unexplained import leaves_something
from ropefit.effects import Effect
from ropefit.inference.least_squares import Fit, attempted

MOST_EXPLORED = 8  # pairs fitted to few frames
MOST_SINGLES, MOST_SECONDS = 3, 4  # candidates, and what is put beside each
MOST_BESIDE_CONTACT = 2  # candidates of the first round: fits beside contact are slow
LEAST_SHARE = 0.8  # of the best pair's evidence: first order is not exact
MOST_ALIKE = 3  # hypotheses fitted in place of one of a pair


def two_instead(
    current: Fit, accepted: list[Accepted], threshold: float, rules: Rules,
    singles: Sequence[Candidate] = (), contact: float = 0.0,
) -> tuple[Fit, list[Accepted]]:  # fmt: skip
    """Return a model with two effects of different kinds and these, in place of the accepted ones,
    where they are better together by more than a tie; else what was given, with its ties.

    accepted: two at most. rules: which effects are looked for. singles: fits of one effect each on
    top of the model without any. contact: log evidence [nats] of contact beside the accepted one,
    with which pairs compete.
    """
    held, names = [a.candidate for a in accepted], rules.effects
    if any(c.hypothesis.effect.slow for c in held):
        return current, accepted
    base = without_effects(current, *held) if held else current
    if base is None:
        return current, accepted
    now = contact + (together(base, current, len(held)) if held else 0.0)
    coarse = on_coarse_mesh(base)  # the scan only leads on
    found = scanned(coarse, sensitivities(coarse, [], names, linear=True))
    tried = len(hypotheses(base.point.setup, names))
    leading = [
        (evidence, one, other)
        for evidence, one, other in found
        if evidence > max(LEAST_SHARE * max(found[0][0], now), TIE_NATS)
        and not _as_accepted(accepted, one[0].effect, other[0].effect)
    ]
    starts = _distinct(leading)[:MOST_EXPLORED] + _beside_singles(singles, base, names)
    best_starts = _best_on_few_frames(base, starts, names, least_evidence(threshold, now))
    best, least = None, now + TIE_NATS
    for both in best_starts:
        pair = fitted_pair(base, both, threshold, least)
        if pair is not None:
            best, least = pair, together(base, pair[1])
    if best is None:
        return with_ties(current, accepted, best_starts, tried)
    one, other = (candidate.hypothesis for candidate, _ in best[0])
    alike = [_alike(found, one, other), _alike(found, other, one)]
    named, whole = accepted_pair(best, tried, alike)
    return whole, named


def beside_contact(accepted: list[Accepted], singles: Sequence[Candidate]) -> list[list[Start]]:
    """Return where fits of what explained most before contact was accepted begin beside it: about
    a rope that touches something the scan leads elsewhere, and pairs are not compared."""
    if len(accepted) != 1 or not accepted[0].candidate.hypothesis.effect.slow:
        return []
    best = [c for c in _quick(singles) if c.evidence > 0][:MOST_BESIDE_CONTACT]
    return [[(c.hypothesis, c.values())] for c in best]


def _quick(singles: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates that a scan shows and that are no contact."""
    effects = ((c, c.hypothesis.effect) for c in singles)
    return [c for c, effect in effects if effect.linear and not effect.slow]


def _beside_singles(
    singles: Sequence[Candidate], base: Fit, names: tuple[str, ...] | None
) -> list[ScannedPair]:
    """Return pairs of a single candidate, of those that leave least, and what scores highest beside
    it."""
    out: list[ScannedPair] = []
    for one in sorted(_quick(singles), key=lambda c: c.fit.cost)[:MOST_SINGLES]:
        start: Start = (one.hypothesis, one.values())
        out += _scored_beside(on_coarse_mesh(one.fit), start, base, names)
    return out


def _best_on_few_frames(
    base: Fit, pairs: list[ScannedPair], names: tuple[str, ...] | None, least: float
) -> list[list[Start]]:
    """Return where fits of pairs begin that explain few frames best, as fitted to these; where the
    best leaves something, also of those with one of the two and what scores highest beside it.
    least: log evidence [nats] of both together from which a pair counts."""
    few = on_few_frames(base) or base
    needed = cost_for(few, least * len(few.z) / len(base.z))
    ended: dict[Kinds, list[Explored]] = defaultdict(list)
    every = explored(few, pairs, ended, MOST_FITTED - 1, needed)
    best = best_explored(every)
    if best and leaves_something(best[0].fit, LEFT_OF_FEW):
        further = [pair for one in best for pair in _with_another(one, few, names)]
        every += explored(few, further, ended, 0, needed)
        best = best_explored(every)
    return [one.starts for one in best if one.evidence > best[0].evidence - FAR_BEHIND]


def _with_another(pair: Explored, few: Fit, names: tuple[str, ...] | None) -> Iterator[ScannedPair]:
    """Yield each of a pair's effects, as fitted, with what scores highest beside it: one may be
    right while the other stands for what is really there."""
    *terms, first, second = pair.fit.forward.terms
    *u, of_first, of_second = pair.fit.forward.split(pair.fit.point.u)
    for start, term, part in zip(pair.starts, (first, second), (of_first, of_second), strict=True):
        forward = pair.fit.forward.with_terms([*terms, term], few.point.solution)
        # Left where it is: fitted alone it would stand for all that is missing.
        held = attempted(forward, few.problem, np.concatenate([*u, part]), 1, tolerance=1e-4)
        if held is not None and len(held.z) == len(few.z):
            yield from _scored_beside(held, start, few, names)


def _scored_beside(
    one: Fit, start: Start, base: Fit, names: tuple[str, ...] | None
) -> Iterator[ScannedPair]:
    """Yield an effect, as fitted on top of a model, and where what scores highest beside it begins,
    in stretches of every width; with their log evidence over the model, to first order."""
    scores = Scan(one, partial(sensitivities, one, [], names, linear=True)).scores
    higher = [s for s in scores if s.log_factor > TIE_NATS]
    alone = 0.5 * (base.cost - one.cost)
    for score in higher[:MOST_SECONDS]:
        for begin in score.widths or score.starts()[:1]:
            yield alone + score.log_factor, start, (score.hypothesis, np.concatenate(begin))


def _distinct(leading: list[ScannedPair]) -> list[ScannedPair]:
    """Return pairs, but those that another one equals in which one effect stands for its like."""
    out: list[ScannedPair] = []
    for evidence, one, other in leading:
        keys = {one[0].key, other[0].key}
        if not any(
            better - evidence < TIE_NATS and keys & {h.key for h, _ in starts}
            for better, *starts in out
        ):
            out.append((evidence, one, other))
    return out


def _alike(found: list[ScannedPair], one: Hypothesis, beside: Hypothesis) -> list[Start]:
    """Return what explains about as much as a hypothesis beside another, and where it begins."""
    of = [
        (evidence, *((p, q) if q[0].key == beside.key else (q, p)))
        for evidence, p, q in found
        if beside.key in (p[0].key, q[0].key)
    ]
    least = LEAST_SHARE * max((evidence for evidence, *_ in of), default=0.0)
    alike = [start for evidence, start, _ in of if evidence > least and start[0].key != one.key]
    return alike[:MOST_ALIKE]


def scanned(base: Fit, known: list[Sensitivity]) -> list[ScannedPair]:
    """Return for every two hypotheses the log evidence of their best places [nats], to first order
    and with broad priors of their sizes, and where a fit of both begins; highest first."""
    project, setup = Projection(base), base.forward.base
    usable = [s for s in known if s.hypothesis.effect.linear]
    flat = np.concatenate([s.values.reshape(len(s.values), -1) for s in usable], axis=1)
    a, b = flat.T @ project(flat), flat.T @ project.z
    at = np.cumsum([0, *(s.values.shape[1] * s.values.shape[2] for s in usable)])
    out = []
    for i, j in combinations(range(len(usable)), 2):
        two = usable[i], usable[j]
        (p, k), (q, m) = (s.values.shape[1:] for s in two)
        mine, other = slice(at[i], at[i + 1]), slice(at[j], at[j + 1])
        whole = np.zeros((p, q, k + m, k + m))
        whole[..., :k, :k] = np.einsum("pkpl->pkl", a[mine, mine].reshape(p, k, p, k))[:, None]
        whole[..., k:, k:] = np.einsum("qkql->qkl", a[other, other].reshape(q, m, q, m))
        whole[..., :k, k:] = a[mine, other].reshape(p, k, q, m).transpose(0, 2, 1, 3)
        whole[..., k:, :k] = whole[..., :k, k:].swapaxes(-1, -2)
        pull = np.zeros((p, q, k + m))
        pull[..., :k], pull[..., k:] = b[mine].reshape(p, 1, k), b[other].reshape(q, m)
        evidence, sizes = _evidence(whole, pull)
        bounded = np.concatenate([[q.lower == 0 for q in s.hypothesis.effect.quantities[:n]]
                                  for s, n in zip(two, (k, m), strict=True)])  # fmt: skip
        beyond = bounded & (sizes < 0)
        if beyond.any():  # a quantity at its bound, as the stiffness of a steady pull
            pull = np.where(beyond, 0.0, pull)
            whole = np.where(beyond[..., None] | beyond[..., None, :], 0.0, whole)
            evidence, held = _evidence(whole, pull)
            sizes = np.where(beyond, sizes, held)
        for s, size in zip(two, (sizes[..., 0], sizes[..., k]), strict=True):
            evidence = np.where(s.hypothesis.positive & (size < 0), -np.inf, evidence)
        best = np.unravel_index(int(np.argmax(evidence)), evidence.shape)
        starts = [
            (s.hypothesis, np.concatenate([s.hypothesis.scales(setup) * v, s.hypothesis.places[n]]))
            for s, v, n in zip(two, (sizes[best][:k], sizes[best][k:]), best, strict=True)
        ]
        out.append((float(evidence[best]), *starts))
    return sorted(out, key=lambda pair: -pair[0])


def _evidence(whole: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the log evidences (...) [nats] and the best sizes (..., n) of effects with broad
    priors, from their information (..., n, n) and gradient (..., n)."""
    one = np.eye(whole.shape[-1])
    sizes = np.linalg.solve(whole + one / PRIOR_SIZE**2, pull[..., None])[..., 0]
    cost = np.linalg.slogdet(one + PRIOR_SIZE**2 * whole)[1]
    return 0.5 * ((sizes * pull).sum(-1) - cost), sizes


def _as_accepted(accepted: list[Accepted], one: Effect, other: Effect) -> bool:
    """Return whether two effects are those that were accepted, or what is as good in their place,
    a special case of it or the contrary."""
    if len(accepted) < 2:
        return False

    def stands(effect: Effect, for_: Accepted) -> bool:
        known = [c.hypothesis.effect for c in (for_.candidate, *for_.equivalent)]
        return any(
            type(e) is type(effect) or is_special_case(e, effect) or is_special_case(effect, e)
            for e in known
        )

    first, second = accepted
    return (stands(one, first) and stands(other, second)) or (
        stands(one, second) and stands(other, first)
    )
