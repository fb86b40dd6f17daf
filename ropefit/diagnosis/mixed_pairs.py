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
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.few_frames import on_few_frames
from ropefit.diagnosis.full_scan import Scan, sensitivities
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.nested import is_special_case
from ropefit.diagnosis.pairs import PRIOR_SIZE, accepted_pair, fitted_pair, together
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.reassessment import without_effects
from ropefit.diagnosis.scan import Projection
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.diagnosis.unexplained import leaves_something
from ropefit.effects import Effect
from ropefit.inference.least_squares import Fit, attempted

MOST_EXPLORED = 8  # pairs fitted to few frames
EVALUATIONS = 10  # of such a fit
MOST_SINGLES, MOST_SECONDS = 3, 4  # candidates, and what is put beside each
MOST_BESIDE_CONTACT = 2  # candidates of the first round: fits beside contact are slow
HARDLY_MORE = 1.2  # times the least cost so far: a fit without prospect of it is stopped
LEFT_OF_FEW = 1.0  # standard errors of χ²: few frames show little
ALIKE, ENOUGH = 1.0, 3  # of χ², within which fits of one pair are the same; so many are enough
MOST_FITTED = 3  # pairs fitted to all, and the best one from where else it may be
APART = 0.1  # of the length: places so far from each other are other minima
LEAST_SHARE = 0.8  # of the best pair's evidence: first order is not exact
FAR_BEHIND = 10.0  # nats, in few frames, and by that share: such a pair is not fitted to all
MOST_ALIKE = 3  # hypotheses fitted in place of one of a pair

ScannedPair = tuple[float, Start, Start]  # log evidence [nats]
Kinds = frozenset[tuple[str, int]]


def two_instead(
    current: Fit, accepted: list[Accepted], threshold: float, names: tuple[str, ...] | None,
    singles: Sequence[Candidate] = (),
) -> tuple[Fit, list[Accepted]]:  # fmt: skip
    """Return a model with two effects of different kinds and these, in place of the accepted ones,
    where they are better together by more than a tie; else what was given.

    accepted: two at most. names: of the effects that are looked for; None: all. singles: fits of
    one effect each on top of the model without any.
    """
    held = [a.candidate for a in accepted]
    if any(c.hypothesis.effect.slow for c in held):
        return current, accepted
    base = without_effects(current, *held) if held else current
    if base is None:
        return current, accepted
    now = together(base, current, len(held)) if held else 0.0
    known = sensitivities(base, [], names)
    found = scanned(base, known)
    leading = [
        (evidence, one, other)
        for evidence, one, other in found
        if evidence > max(LEAST_SHARE * max(found[0][0], now), TIE_NATS)
        and not _as_accepted(accepted, one[0].effect, other[0].effect)
    ]
    explored = _distinct(leading)[:MOST_EXPLORED] + _beside_singles(singles, names)
    best_starts = _best_on_few_frames(base, explored, names)
    pairs = [fitted_pair(base, both, threshold) for both in best_starts]
    settled = [pair for pair in pairs if pair is not None]
    best = max(settled, key=lambda pair: together(base, pair[1]), default=None)
    if best is None or together(base, best[1]) <= now + TIE_NATS:
        return current, accepted
    one, other = (candidate.hypothesis for candidate, _ in best[0])
    alike = [_alike(found, one, other), _alike(found, other, one)]
    named, whole = accepted_pair(best, len(known), alike)
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
    singles: Sequence[Candidate], names: tuple[str, ...] | None
) -> list[list[Start]]:
    """Return pairs of a single candidate, of those that leave least, and what scores highest beside
    it."""
    out: list[list[Start]] = []
    for one in sorted(_quick(singles), key=lambda c: c.fit.cost)[:MOST_SINGLES]:
        start: Start = (one.hypothesis, one.values())
        out += [[start, other] for other in _scored_beside(one.fit, names)]
    return out


@dataclass(frozen=True)
class Explored:
    """Where the fit of a pair to few frames ended, and its log evidence there [nats]."""

    evidence: float
    starts: list[Start]
    fit: Fit

    @property
    def kinds(self) -> Kinds:
        return _kinds(self.starts)

    def far_from(self, starts: list[Start]) -> bool:
        """Return whether one of the two effects is elsewhere than where it starts."""
        least = APART * float(self.fit.forward.base.properties.length.sum())
        ours, theirs = (dict(map(_place, both)) for both in (self.starts, starts))
        return any(abs(place - theirs[key]) > least for key, place in ours.items())


def _best_on_few_frames(
    base: Fit, pairs: list[list[Start]], names: tuple[str, ...] | None
) -> list[list[Start]]:
    """Return where fits of pairs begin that explain few frames best, as fitted to these; where the
    best leaves something, also of those with one of the two and what scores highest beside it."""
    few = on_few_frames(base) or base
    ended: dict[Kinds, list[Explored]] = defaultdict(list)
    explored = _explored(few, pairs, np.inf, ended)
    best = _best(explored)
    if best and leaves_something(best[0].fit, LEFT_OF_FEW):
        further = [both for one in best for both in _with_another(one, few, names)]
        explored += _explored(few, further, best[0].fit.cost, ended)
        best = _best(explored)
    most = best[0].evidence if best else 0.0
    least = min(LEAST_SHARE * most, most - FAR_BEHIND)
    return [one.starts for one in best if one.evidence > least]


def _explored(
    few: Fit, pairs: list[list[Start]], least: float, ended: dict[Kinds, list[Explored]]
) -> list[Explored]:
    """Return the fits of pairs to few frames; least: cost of the best one so far; ended: the
    fits of every two hypotheses, which are not begun again about where several have ended alike."""
    out: list[Explored] = []
    for both in pairs:
        before = ended[_kinds(both)]
        lowest = min((one.fit.cost for one in before), default=np.inf)
        alike = [one for one in before if one.fit.cost < lowest + ALIKE]
        if len(alike) >= ENOUGH and not alike[0].far_from(both):
            continue
        begun = settled_start(few, both)
        if begun is None:
            continue
        fitted = attempted(
            begun.forward, few.problem, begun.values, EVALUATIONS, tolerance=1e-4,
            needed=HARDLY_MORE * least,
        )  # fmt: skip
        if fitted is None or fitted.stopped or len(fitted.z) != len(few.z):
            continue
        least = min(least, fitted.cost)
        parts = fitted.forward.split(fitted.point.u)[-2:]
        values = [term.value(part) for term, part in zip(begun.terms, parts, strict=True)]
        starts = [(h, v) for (h, _), v in zip(both, values, strict=True)]
        out.append(Explored(together(few, fitted), starts, fitted))
        before.append(out[-1])
    return out


def _kinds(both: list[Start]) -> Kinds:
    return frozenset(hypothesis.key for hypothesis, _ in both)


def _place(start: Start) -> tuple[tuple[str, int], float]:
    """Return which hypothesis a start is of, and where that is: the arc length or centre [m]."""
    (hypothesis, values), names = start, start[0].effect.names
    places = [float(values[names.index(n)]) for n in ("arc_length", "centre") if n in names]
    return hypothesis.key, places[0] if places else 0.0


def _best(explored: list[Explored]) -> list[Explored]:
    """Return the best fit of each two hypotheses, few of them, best first; last the best fit of the
    first two with one of them elsewhere."""
    best: dict[Kinds, Explored] = {}
    every = sorted(explored, key=lambda one: -one.evidence)
    for one in every:
        best.setdefault(one.kinds, one)
    out = list(best.values())[:MOST_FITTED]
    alike = [one for one in every if out and one.kinds == out[0].kinds]
    return out + [one for one in alike if one.far_from(out[0].starts)][:1]


def _with_another(pair: Explored, few: Fit, names: tuple[str, ...] | None) -> Iterator[list[Start]]:
    """Yield each of a pair's effects, as fitted, with what scores highest beside it: one may be
    right while the other stands for what is really there."""
    *terms, first, second = pair.fit.forward.terms
    *u, of_first, of_second = pair.fit.forward.split(pair.fit.point.u)
    for start, term, part in zip(pair.starts, (first, second), (of_first, of_second), strict=True):
        forward = pair.fit.forward.with_terms([*terms, term], few.point.solution)
        # Left where it is: fitted alone it would stand for all that is missing.
        held = attempted(forward, few.problem, np.concatenate([*u, part]), 1, tolerance=1e-4)
        if held is not None and len(held.z) == len(few.z):
            for other in _scored_beside(held, names):
                yield [start, other]


def _scored_beside(one: Fit, names: tuple[str, ...] | None) -> Iterator[Start]:
    """Yield where what scores highest beside a fit begins, in stretches of every width."""
    scores = Scan(one, partial(sensitivities, one, [], names)).scores
    linear = [s for s in scores if s.hypothesis.effect.linear and s.log_factor > TIE_NATS]
    for score in linear[:MOST_SECONDS]:
        for begin in score.widths or score.starts()[:1]:
            yield score.hypothesis, np.concatenate(begin)


def _distinct(leading: list[ScannedPair]) -> list[list[Start]]:
    """Return pairs, but those that another one equals in which one effect stands for its like."""
    out: list[ScannedPair] = []
    for evidence, one, other in leading:
        keys = {one[0].key, other[0].key}
        if not any(
            better - evidence < TIE_NATS and keys & {h.key for h, _ in starts}
            for better, *starts in out
        ):
            out.append((evidence, one, other))
    return [[one, other] for _, one, other in out]


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
