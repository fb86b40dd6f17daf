"""The last fit of a diagnosis at rest, from which sizes and intervals are reported.

Points are matched to the rope where a fit begins. Where it ends elsewhere the match is a wrong one,
and so is the minimum, along a valley by more than an interval: the fit is repeated until it stays.
So is one that ended, with small steps, where a linear step promises more: along its valley.

Some of what it then has the data may leave open. Shapes at rest show only ratios of forces to the
weight: a steady load along gravity does what a heavier, stiffer rope does, and a fit ends anywhere
along that valley, with all other forces as wrong as the weight. Where the data tell less of a
direction than the broad prior of the sizes, the least sizes are taken, as that prior has it
(`Fit.covariance` has its width).
"""

from __future__ import annotations

import numpy as np

from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.objective import LEFT

ROUNDS = 4  # at most, of either; one where fits are slow, or there have been too many
STILL = 0.05  # standard errors: a fit that moves by less stays
EVALUATIONS = 20
EVALUATIONS_WITH_FRICTION = 6  # nodes stick and slip: more lead nowhere
OPEN = 0.5  # of the prior's variance: left open by the data
SHARES = (1.0, 0.5)  # of the way to the least sizes, until a fit there is as good
LEAST_MOVE = 0.05  # usual sizes
SHORTER = 0.7  # times the step before: else it leads nowhere
NO_WORSE = 3.0  # of the cost: what is open costs nothing, but each fit matches the data anew


def last_fit(found: Fit) -> Fit:
    """Return the fit of accepted effects, at the minimum for the data as matched to its own rope,
    and at the least sizes where these are open; of a motion as it is."""
    if not found.forward.instantaneous:
        return found
    slow = any(term.effect is not None and term.effect.slow for term in found.forward.terms)
    gained = np.inf
    for _ in range(1 if slow else _rounds(found)):
        arrived = slow or min(found.left_to_gain, gained) < LEFT
        ended = found.converged and found.as_matched and arrived
        again = None if ended else _refitted(found, np.zeros_like(found.point.u), thorough=True)
        if again is None:
            break
        before, found = found, again
        gained = before.cost - found.cost
        if stays(before, found):
            break
    return _with_least_sizes(found)


def _rounds(found: Fit) -> int:
    return 1 if found.problem.work.exhausted else ROUNDS


def stays(before: Fit, after: Fit) -> bool:
    """Return whether a fit that was repeated moved by next to nothing."""
    moved = np.abs(after.point.u - before.point.u) / np.maximum(after.sd(), 1e-12)
    return bool(moved.max(initial=0.0) < STILL)


def _with_least_sizes(found: Fit) -> Fit:
    before = np.inf
    for _ in range(_rounds(found)):
        step = _to_least_sizes(found)
        size = 0.0 if step is None else float(np.linalg.norm(step))
        if step is None or size > SHORTER * before:  # each fit goes back to where it was
            break
        before = size
        most = found.cost + NO_WORSE
        fits = (_refitted(found, share * step, needed=most) for share in SHARES)
        moved = next((f for f in fits if f is not None and f.cost < most), None)
        if moved is None:
            break
        found = moved
    return found


def _refitted(
    found: Fit, step: np.ndarray, thorough: bool = False, needed: float = np.inf
) -> Fit | None:
    """Return the fit from a step (P,) away, stopped where it cannot reach a cost that is `needed`;
    None if it cannot be compared."""
    low, high = found.forward.bounds()
    forward = found.forward.starting_from(found.point.solution)
    begin = np.clip(found.point.u + step, low, high)
    most = EVALUATIONS_WITH_FRICTION if found.point.setup.rubs else EVALUATIONS
    again = attempted(forward, found.problem, begin, most, 1e-6, needed, thorough=thorough)
    if again is None or len(again.z) != len(found.z) or not again.point.converged.all():
        return None
    return again


def _to_least_sizes(found: Fit) -> np.ndarray | None:
    """Return the step (P,) to the least sizes, to first order; None where nothing is open."""
    broad = found.forward.broad()
    mine = np.flatnonzero(np.isfinite(broad))
    if not len(mine):
        return None
    parts = zip(found.forward.terms, found.forward.split(found.point.u), strict=True)
    sizes = np.concatenate([(t.value(u) / t.scale) for t, u in parts])[mine] / broad[mine]
    to_prior = found.covariance[:, mine] / broad[mine]
    share, directions = np.linalg.eigh(to_prior[mine] / broad[mine, None])
    left_open = directions[:, share > OPEN]
    away = left_open.T @ sizes
    if np.linalg.norm(away) * float(broad[mine].max()) < LEAST_MOVE:
        return None
    return -to_prior @ (left_open @ away)
