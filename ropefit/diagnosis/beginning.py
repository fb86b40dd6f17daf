"""Where the fit of a candidate, or of two at once, begins: from a start that settles, with the
smaller model's values moved to where they need not stand for what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.calm import calm, distorted
from ropefit.diagnosis.coarse_mesh import on_coarse_mesh
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.scan import Projection
from ropefit.inference.known import settled
from ropefit.inference.least_squares import Fit, sensitivity
from ropefit.models.model import Model
from ropefit.models.response import Point
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup

START_SHARES = (1.0, 0.4, 0.15)  # of a start's size, until every frame settles
LATE_GAIN = 3.0  # nats: least first-order gain from which a late effect is fitted
MUCH_LESS = 0.5  # of the rms of the data about the model
UNMOVED = 1e-8  # m: less is rounding
JUMPED = 5.0  # times the smaller model's χ²: a distant equilibrium, slow to settle in
HOPELESS = 100.0  # times that: no fit leads back from there
CLOSE = 0.1  # usual sizes: starts so close to each other lead to the same
INSENSITIVE = 1.0  # whitened change of all data by a factor e of a parameter


@dataclass
class Beginning:
    """The smaller model's fit that candidates begin from, the larger model with their terms, its
    search variables (P,), its point at the start, and what it leaves there of the whitened
    residual, squared, the model refitted to first order."""

    origin: Fit
    terms: list[Term]
    forward: Model
    values: np.ndarray
    point: Point
    misfit: float

    def promising(self) -> bool:
        """Return whether a fit from here may come near the data: it does not lead back from the
        other side of what is touched."""
        return self.misfit < HOPELESS * float(self.origin.z @ self.origin.z)


def beginning(
    smaller: Fit, hypothesis: Hypothesis, start: np.ndarray, least_gain: float = 0.0
) -> Beginning | None:
    """Return where a hypothesis begins on top of a model, from `start` (k + p,) in SI; None if it
    does not settle there, or gains less than `least_gain` [nats] to first order."""
    begun = settled_start(smaller, [(hypothesis, start)])
    if begun is None:
        return None
    moved = _whitened_change(smaller, begun.point.seen)
    if least_gain and _gain_along(smaller, moved)[0] < least_gain:
        return None
    if begun.origin is smaller and distorted(smaller):
        begun.values = _undistorted(smaller, begun, moved)
    return begun


def most_promising_first(
    smaller: Fit, choices: list[tuple[Hypothesis, np.ndarray]]
) -> list[tuple[Hypothesis, np.ndarray]]:
    """Return alternative starts, of contact in the order of what they leave where they begin, on a
    coarse mesh: from some the rope comes to lie on the wrong side. Those from which some frame does
    not settle at once, which is slow, are compared only where no other one settles."""
    effect = choices[0][0].effect if choices else None
    if effect is None or len(choices) == 1 or not effect.slow or effect.path_dependent:
        return choices
    coarse = on_coarse_mesh(smaller)
    left = _left_at(coarse, choices, at_once=True) or _left_at(coarse, choices, at_once=False)
    order = [k for _, k in sorted(left)]
    return [choices[k] for k in (*order, *sorted({*range(len(choices))} - {*order}))]


def _left_at(
    smaller: Fit, choices: list[tuple[Hypothesis, np.ndarray]], at_once: bool
) -> list[tuple[float, int]]:
    """Return what starts that settle, and touch the rope, leave where they begin, and which they
    are. Not compared are those after one that begins better than the smaller model, and those close
    to one from which the rope snaps to a distant equilibrium."""
    usual = choices[0][0].scales(smaller.forward.base)
    left: list[tuple[float, int]] = []
    jumped: list[np.ndarray] = []
    for k, (hypothesis, start) in enumerate(choices):
        if any((np.abs(start - other) < CLOSE * usual).all() for other in jumped):
            continue
        begun = settled_start(smaller, [(hypothesis, start)], at_once=at_once)
        if begun is None or not touches(begun):
            continue
        left.append((begun.misfit, k))
        without = float(begun.origin.z @ begun.origin.z)
        if begun.misfit < without:
            break
        if begun.misfit > JUMPED * without:
            jumped.append(start)
    return left


def touches(begun: Beginning) -> bool:
    """Return whether an effect moves the rope where it begins: else there is no gradient."""
    seen = begun.origin.point.seen
    return not np.allclose(begun.point.seen, seen, rtol=0, atol=UNMOVED, equal_nan=True)


def first_order_move(smaller: Fit, hypothesis: Hypothesis, start: np.ndarray) -> np.ndarray | None:
    """Return (M, D) [m] what an effect of values `start` (k + p,) in SI does to the stations, times
    what fits best, to first order; None if that gains too little for a fit."""
    begun = settled_start(smaller, [(hypothesis, start)], of_any_size=True)
    if begun is None:
        return None
    moved = _whitened_change(smaller, begun.point.seen)
    gain, multiple = _gain_along(smaller, moved)
    if gain < LATE_GAIN:
        return None
    return smaller.whitener.undo(multiple * moved).reshape(smaller.stations.residual.shape)


def settled_start(
    smaller: Fit, starts: Sequence[tuple[Hypothesis, np.ndarray]], of_any_size: bool = False,
    at_once: bool = False,
) -> Beginning | None:  # fmt: skip
    """Return where hypotheses begin on top of a model, from their values (k + p,) in SI, with
    smaller sizes if those make the misfit no smaller, the model refitted to first order; None if
    they do not settle, or drag the rope far off at their least. of_any_size: the first that
    settle, whatever they make of the misfit; at_once: None also if some frame settles only anew."""
    setup = smaller.forward.base
    # What depends on the way there moves the frames after, too: none is without it.
    some = any(h.effect.slow and not h.effect.path_dependent for h, _ in starts)
    origin = calm(smaller) if some else smaller
    project, best, least = Projection(origin), None, np.inf
    shares, all_compared = _shares(starts)
    for share in shares:
        terms = [
            _started(setup, h, start, 1.0 if all_compared and not h.effect.start_shares else share)
            for h, start in starts
        ]
        forward = smaller.forward.with_terms(
            [*smaller.forward.terms, *terms], origin.point.solution
        )
        forward = forward.settling_at_once() if at_once else forward
        if best is not None and best.point.setup.remembers:
            forward.remember(best.point)  # frames that are settled one by one start from there
        begin = np.concatenate([_revived(origin), *(np.zeros(term.size) for term in terms)])
        first = settled(forward, begin)
        if not (first.converged.all() and first.setup.possible):
            continue
        change, without = _whitened_change(origin, first.seen), float(project.z @ project.z)
        left = project.z - change
        if all_compared and float(left @ left) > JUMPED * without:
            break  # so much friction drags it along, and more does not less
        left = project.z - project(change)
        misfit = float(left @ left)
        if best is None or misfit < least:
            best, least = Beginning(origin, terms, forward, begin, first, misfit), misfit
        if of_any_size or (not all_compared and least < without):
            break
    return best


def _shares(starts: Sequence[tuple[Hypothesis, np.ndarray]]) -> tuple[tuple[float, ...], bool]:
    """Return the shares of sizes to begin with, and whether all of them are to be compared."""
    own = max((h.effect.start_shares for h, _ in starts), key=len)
    if own:
        return own, True
    return START_SHARES if all(h.effect.linear for h, _ in starts) else (1.0,), False


def _started(setup: Setup, hypothesis: Hypothesis, start: np.ndarray, share: float) -> Term:
    """Return a term that starts at a share of its sizes, inside its bounds."""
    limits = hypothesis.term(setup, start)
    at = start * np.where(np.arange(len(start)) < hypothesis.size, share, 1.0)
    return hypothesis.term(setup, np.clip(at, limits.lower + 1e-9, limits.upper - 1e-9))


def _revived(smaller: Fit) -> np.ndarray:
    """Return (P,) where a larger model starts: at the smaller one's values.

    Positive parameters without a prior that ran to where the data are insensitive to them start
    anew: without a gradient they would stay there. (A rope that is too short becomes as soft as
    its bounds allow.)
    """
    u, terms = smaller.point.u.copy(), smaller.forward.terms
    logs = np.repeat([t.log for t in terms], [t.size for t in terms])
    unseen = np.linalg.norm(smaller.jacobian, axis=0) < INSENSITIVE
    u[logs & unseen & ~smaller.prior.held] = 0.0
    return u


def _undistorted(smaller: Fit, begun: Beginning, moved: np.ndarray) -> np.ndarray:
    """Return (P,) where to begin beside an effect that moves the rope by `moved` (M D,) so that no
    error stands for that effect: the smaller model refitted to first order, or all errors zero,
    where that misses the data by much less (a large effect has no first order); as it had begun
    where the rope settles with neither."""
    size = begun.terms[0].size
    refitted, plain = begun.values.copy(), begun.values.copy()
    refitted[:-size] = _refitted_beside(smaller, moved)
    plain[:-size][smaller.prior.held] = 0.0
    missed = _missed_by(smaller, begun, refitted)
    if _missed_by(smaller, begun, plain) < MUCH_LESS * missed:
        return plain
    return refitted if np.isfinite(missed) else begun.values


def _missed_by(smaller: Fit, begun: Beginning, values: np.ndarray) -> float:
    """Return the rms [m] of the data about the larger model at values (P,), matched anew; inf if a
    frame does not settle at once or no data are near."""
    point = settled(begun.forward.settling_at_once(), values)
    if not point.converged.all():
        return np.inf
    missed = smaller.problem.match(point.seen).residual
    return float(np.sqrt((missed**2).mean())) if missed.size else np.inf


def _whitened_change(smaller: Fit, seen: np.ndarray) -> np.ndarray:
    """Return (M D,) by how much an effect that makes the rope `seen` (F, K, 3) changes it."""
    s = smaller.stations
    return sensitivity((seen - smaller.point.seen)[None], s, s, smaller.whitener)[:, 0]


def _gain_along(smaller: Fit, moved: np.ndarray) -> tuple[float, float]:
    """Return by how many nats an effect that moves the rope along `moved` (M D,) would lower the
    misfit, to first order, the smaller model refitted; and by which multiple of it."""
    project = Projection(smaller)
    along, kept = float(moved @ project.z), max(float(moved @ project(moved)), 1e-300)
    return 0.5 * along**2 / kept, along / kept


def _refitted_beside(smaller: Fit, moved: np.ndarray) -> np.ndarray:
    """Return (P,) the best values of the smaller model, to first order, beside an effect that
    moves its rope by `moved` (M D,): they need not stand for that effect any more."""
    u = smaller.point.u
    project = Projection(smaller)
    pull = smaller.prior.information @ u
    step = project.inverse @ (project.jacobian.T @ (smaller.z - moved) - pull)
    low, high = smaller.forward.bounds()
    return np.clip(u + step, low, high)
