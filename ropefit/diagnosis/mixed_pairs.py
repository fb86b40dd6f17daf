"""Two effects of different kinds at once, where one after the other leads astray.

The first effect that is accepted stands for all that is missing, and the second is chosen beside
it: neither gives way alone where only both together are wrong. A scan over all pairs of hypotheses
and places costs no further solve; the best of them is fitted and compared with what was accepted.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.full_scan import sensitivities
from ropefit.diagnosis.nested import is_special_case
from ropefit.diagnosis.pairs import (
    PRIOR_SIZE,
    accepted_pair,
    fitted_pair,
    together,
)
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.reassessment import without_effects
from ropefit.diagnosis.scan import Projection
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.effects import Effect
from ropefit.inference.least_squares import Fit

MOST_FITTED = 2  # pairs
LEAST_SHARE = 0.9  # of the best pair's evidence: first order is not exact


def two_instead(
    current: Fit, accepted: list[Accepted], threshold: float, names: tuple[str, ...] | None
) -> tuple[Fit, list[Accepted]]:
    """Return a model with two effects of different kinds and these, in place of the accepted ones,
    where they are better together by more than a tie; else what was given.

    accepted: two at most. names: of the effects that are looked for; None: all.
    """
    held = [a.candidate for a in accepted]
    base = without_effects(current, *held) if held else current
    if base is None or any(c.hypothesis.effect.slow for c in held):
        return current, accepted
    now = together(base, current, len(held)) if held else 0.0
    known = sensitivities(base, [], names)
    found = scanned(base, known)
    others = [
        (one, other)
        for evidence, one, other in found
        if evidence > max(LEAST_SHARE * max(found[0][0], now), TIE_NATS)
        and not _as_accepted(accepted, one[0].effect, other[0].effect)
    ]
    pairs = [fitted_pair(base, [*both], threshold) for both in others[:MOST_FITTED]]
    settled = [pair for pair in pairs if pair is not None]
    best = max(settled, key=lambda pair: together(base, pair[1]), default=None)
    if best is None or together(base, best[1]) <= now + TIE_NATS:
        return current, accepted
    named, whole = accepted_pair(best, len(known))
    return whole, named


def scanned(base: Fit, known: list[Sensitivity]) -> list[tuple[float, Start, Start]]:
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
        sizes = np.linalg.solve(whole + np.eye(k + m) / PRIOR_SIZE**2, pull[..., None])[..., 0]
        cost = np.linalg.slogdet(np.eye(k + m) + PRIOR_SIZE**2 * whole)[1]
        evidence = 0.5 * ((sizes * pull).sum(-1) - cost)
        for s, size in zip(two, (sizes[..., 0], sizes[..., k]), strict=True):
            evidence = np.where(s.hypothesis.positive & (size < 0), -np.inf, evidence)
        best = np.unravel_index(int(np.argmax(evidence)), evidence.shape)
        starts = [
            (s.hypothesis, np.concatenate([s.hypothesis.scales(setup) * v, s.hypothesis.places[n]]))
            for s, v, n in zip(two, (sizes[best][:k], sizes[best][k:]), best, strict=True)
        ]
        out.append((float(evidence[best]), *starts))
    return sorted(out, key=lambda pair: -pair[0])


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
