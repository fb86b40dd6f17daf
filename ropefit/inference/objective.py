"""What a least-squares fit minimises: whitened residuals and slopes of a model, and its priors."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy import optimize
from threadpoolctl import ThreadpoolController

from ropefit.inference.bins import Stations, aligned, collected
from ropefit.inference.known import Known
from ropefit.inference.noise import Whitener
from ropefit.inference.problem import FitProblem
from ropefit.inference.steps import along_valley, foreseen, linear_step, with_priors
from ropefit.inference.turned import turned_jacobian, turned_residual
from ropefit.models.model import Model
from ropefit.models.response import Point
from ropefit.runs.journal import Arrays

STOPPED, UNCONVERGED, ENDED = -2, 0, 1  # status of a fit
OPTIMISM = 4.0  # times what a linear step gains: no fit is expected to gain more
FEWEST_SLOPES = 3  # of a fit, before it may be stopped without a wider margin
EARLY = 4.0  # times that: no fit is expected to gain more at the slope before the fewest
PACE_OF = 4  # evaluations, the latest, whose pace is compared with what is needed
PACE_OPTIMISM = 2.0  # times that pace: no fit is expected to gain faster in those left
FAR = 0.01  # of the cost needed: only one that misses it by more is stopped for its pace
NEGLIGIBLE = 5e-3  # of χ²: a decrease below which a fit ends
FORESEEN = 0.3  # of the decrease below which a fit ends, if a linear step promises no more
# Evaluations in a row without such a decrease, after which a fit ends: what a linear step predicts
# is not achieved, as where points change stations; with friction, where nodes stick and slip.
FRUITLESS, FRUITLESS_WITH_FRICTION = 5, 3
FLAT, FLAT_FOR = 0.05, 2  # the same, where such evaluations differ by no more than so much of χ²
SHORTER = (0.5, 0.25, 0.1)  # of a linear step, on which a contact may be lost
PROMISING = 2.0  # of χ²: what a linear step must foresee to be taken in part
KEPT_SHARE = 0.3  # least share of what it foresees there that is gained
MOST_SHORTENED = 5  # steps of a fit
# Of χ², as large as noise makes it: what a linear step may promise where a fit ends (a minimum that
# is so far is 0.7 standard errors away), where a valley was followed, and of one that converged.
LEFT, LEAST_LEFT, MOST_LEFT = 0.5, 0.05, 1.0
VALLEY_EVALUATIONS = 40
UNSETTLED_RESIDUAL = 1e3  # whitened residual of a frame that did not settle: no fit goes there


@dataclass
class _Evaluation:
    """A model at search variables `key`: its point, its stations, the whitened residual (M D,),
    and its derivatives (M D, P) once they are known."""

    key: bytes
    point: Point
    now: Stations
    z: np.ndarray
    slopes: np.ndarray | None = None


class _Stopped(Exception):
    """A fit ends at u (P,), with a cost and a status: it cannot reach the cost that is needed, or
    has hardly anything to gain."""


class Objective:
    """Whitened residuals and slopes of a model on the stations of its start, with the priors.

    Raises ArithmeticError when the start settles in no frame, or is a rope that no matter makes.
    """

    def __init__(
        self, forward: Model, problem: FitProblem, u: np.ndarray, needed: float = np.inf,
        highest: float = np.inf,
    ) -> None:  # fmt: skip
        self.forward, self.known = forward, Known(forward, u)
        self.needed, self.highest, self.count, self.most = needed, highest, 0, 0
        self.prior = forward.prior()
        first = self.known.begin()
        self.settled = first.converged
        if not first.setup.possible:
            raise ArithmeticError("the start is a rope that no matter makes")
        if not self.settled.any():
            raise ArithmeticError("no frame reaches an equilibrium from the start")
        self.began = first.seen
        self.problem = problem if self.settled.all() else problem.without(~self.settled)
        stations = self.problem.match(_fill(first.seen, self.settled))
        if problem.noise.white is not None and not problem.data.material:
            same = np.broadcast_to(problem.noise.white, stations.residual.shape).copy()
            stations = replace(stations, scatter=same)
        self.stations, self.whitener = stations, Whitener.of(stations, problem.noise)
        self.trace: list[float] = []
        self.best, self.tolerance = u, 0.0
        self.touches = bool(first.setup.potentials)
        self.rubs = first.setup.rubs
        bodies = any(p.hardness is not None or p.cornered for p in first.setup.potentials)
        self.smooth = forward.instantaneous and not (bodies or self.rubs)
        self.latest = np.empty(0)
        self._last: _Evaluation | None = None
        self._best: _Evaluation | None = None  # of shapes at rest

    def at(self, u: np.ndarray) -> tuple[Point, Stations, np.ndarray]:
        """Return the point at u (P,), its stations, and the whitened residual (M D,)."""
        one = self._at(u)
        return one.point, one.now, one.z

    def _at(self, u: np.ndarray) -> _Evaluation:
        key = u.tobytes()
        if self._best is not None and self._best.key == key:
            self.forward.remember(self._best.point)
            return self._best
        if self._last is None or self._last.key != key:
            self._last = None  # a motion is large: one at a time
            point = self.known.at(u)
            bad = np.isnan(point.seen).any(axis=(1, 2)) & self.settled
            if not point.setup.possible:
                bad = self.settled
            now = self.problem.match(_fill(point.seen, self.settled & ~bad))
            residual = aligned(now, self.stations, now.residual)
            z = self.whitener(residual)
            if bad.any():
                z[np.repeat(bad[self.stations.frame], residual.shape[1])] = UNSETTLED_RESIDUAL
            self._last = _Evaluation(key, point, now, z)
        return self._last

    def moved(self, seen: np.ndarray) -> float:
        """Return the most [m] that any node of `seen` (F, K, 3) is from where the fit began."""
        apart = np.linalg.norm(seen - self.began, axis=-1)
        return float(np.nanmax(apart, initial=0.0))

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """Return (M D, P) whitened derivatives of the prediction."""
        one = self._at(u)
        if one.slopes is None:
            at = one.now.nodes(one.point.seen.shape[1])
            parts = one.point.parts(self.forward.changes(u), nodes=at)
            rows = collected(one.now, self.stations, parts, len(u), at)
            one.slopes = self.whitener(rows, own=True)
        return one.slopes

    def whole(self, u: np.ndarray) -> np.ndarray:
        """Return residual rows, those of the priors last."""
        return np.concatenate([self.at(u)[2], self.prior.rows(u)])

    def rows(self, u: np.ndarray) -> np.ndarray:
        """Return (P + 1,) the rows turned onto one; see `turned.py`."""

        def square() -> np.ndarray:
            rows = self.whole(u)
            return np.array([rows @ rows])

        found = float(self.known.rows("square", u, square)[0])
        self.latest = turned_residual(found, len(u))
        if found < min(self.trace, default=np.inf):
            self.best = u.copy()
            if self._last is not None and self._last.key == u.tobytes():
                self.known.improved(self._last.point)
                if self.forward.instantaneous:
                    self._best = self._last
        self.trace.append(found)
        return self.latest.copy()

    def patient_rows(self, u: np.ndarray, begun: int) -> np.ndarray:
        """Return the rows; end the fit where evaluations since `begun` have not lowered χ²."""
        out = self.rows(u)
        flat = max(self.trace[-FLAT_FOR:]) < min(self.trace) + FLAT
        steps = FLAT_FOR if flat else FRUITLESS_WITH_FRICTION if self.rubs else FRUITLESS
        if len(self.trace) - begun > steps:
            lowest = min(self.trace)
            if lowest > min(self.trace[:-steps]) - NEGLIGIBLE:
                raise _Stopped(self.best, lowest, ENDED)
        return out

    def slopes(self, u: np.ndarray) -> np.ndarray:
        """Return (P + 1, P) the derivatives of the rows, turned with them."""

        def turned() -> np.ndarray:
            # Both with the other sign, which turns out the same and needs no copy.
            z, own = self.at(u)[2], self.prior
            return turned_jacobian([(self.jacobian(u), -z), (-own.factor, -own.rows(u))])

        out = self.known.rows("slope", u, turned)
        self.count += 1
        hopeful = self.needed == np.inf or self.count < FEWEST_SLOPES - 1
        low, high = self.forward.bounds()
        cost = float(self.latest @ self.latest)  # slopes are asked for where rows just were
        if self.count == 1 and cost > self.highest:
            raise _Stopped(u.copy(), cost, STOPPED)
        gain = linear_step(out, self.latest, low - u, high - u)[1]
        most = OPTIMISM * gain * (EARLY if self.count < FEWEST_SLOPES else 1.0)
        if not hopeful and (cost - most > self.needed or self._too_slow(cost)):
            raise _Stopped(u.copy(), cost, STOPPED)
        if gain < self._negligible(cost):
            raise _Stopped(u.copy(), cost, ENDED)
        return out

    def _negligible(self, cost: float) -> float:
        """Return what a linear step must gain for another evaluation."""
        if self.rubs:
            return max(NEGLIGIBLE, self.tolerance * cost)
        return FORESEEN * self.tolerance * cost if self.forward.instantaneous else NEGLIGIBLE

    def _too_slow(self, cost: float) -> bool:
        """Return whether the evaluations left lead nowhere near the cost that is needed, at twice
        the pace of the latest."""
        before, left = self.trace[:-PACE_OF], self.most - len(self.trace)
        if not before:
            return False
        reach = cost - PACE_OPTIMISM * left * (min(before) - cost) / PACE_OF
        return reach > (1 + FAR) * self.needed

    def minimum(
        self, u: np.ndarray, evaluations: int, tolerance: float, thorough: bool = False
    ) -> tuple[Arrays, Point]:
        """Minimise from u (P,); thorough: also along a narrow, curved valley."""
        self.most, self.tolerance = evaluations, tolerance
        if not u.size:  # nothing is free; not every scipy takes that
            self.rows(u)
            summary = np.array([0.5 * self.trace[-1], 1, 1])
            return {"u": u, "summary": summary, "trace": np.array(self.trace)}, self.at(u)[0]
        try:
            with _blas_alone():
                best, summary = self._by_trust_region(u, evaluations, tolerance)
                for _ in range(MOST_SHORTENED if self.touches and not self.rubs else 0):
                    left = evaluations - len(self.trace)
                    further = self._by_shorter_step(best) if left > len(SHORTER) else None
                    if further is None:
                        break
                    left = evaluations - len(self.trace)
                    if left < 1:  # the last one was that step's
                        best = further
                        summary = np.array([0.5 * self.trace[-1], 0, len(self.trace)])
                        break
                    best, summary = self._by_trust_region(further, left, tolerance)
        except _Stopped as stopped:
            best, cost, status = stopped.args
            summary = np.array([0.5 * cost, status, len(self.trace)])
        if thorough and self.smooth and summary[1] != STOPPED:
            best, summary[1] = self._along_valley(best, summary[1])
            summary[0], summary[2] = 0.5 * min(self.trace), len(self.trace)
        best = self.forward.with_unit_directions(best)  # their lengths drift from fit to fit
        return {"u": best, "summary": summary, "trace": np.array(self.trace)}, self.at(best)[0]

    def _by_trust_region(
        self, u: np.ndarray, evaluations: int, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Minimise from u (P,): the best (P,), and half its cost, status and evaluations (3,)."""
        # Among scipy's closures are circles: what they hold stays until the collector comes.
        asked, begun = [self], len(self.trace)
        try:
            result = optimize.least_squares(
                lambda at: asked[0].patient_rows(at, begun),
                u,
                lambda at: asked[0].slopes(at),  # type: ignore[arg-type]
                bounds=self.forward.bounds(),
                x_scale="jac",
                max_nfev=evaluations,
                ftol=tolerance,
                xtol=1e-9,
                gtol=1e-10,
            )
        except _Stopped as stopped:
            best, cost, status = stopped.args
            if status != ENDED:
                raise
            return best, np.array([0.5 * cost, status, len(self.trace)])
        finally:
            asked.clear()
        return result.x, np.array([result.cost, result.status, len(self.trace)])

    def _along_valley(self, u: np.ndarray, status: float) -> tuple[np.ndarray, float]:
        """Return where what is left to gain is small (P,), and the status, from where a fit ended
        with a status."""
        low, high = self.forward.bounds()

        def slopes(at: np.ndarray) -> np.ndarray:
            return with_priors(self.jacobian(at), self.prior)

        def left(at: np.ndarray) -> float:
            return foreseen(self.whole(at), slopes(at), at, low, high)

        with _blas_alone():
            if left(u) < LEFT:
                return u, status
            u = along_valley(self.whole, slopes, u, low, high, LEAST_LEFT, VALLEY_EVALUATIONS)
            self.rows(u)
            return u, ENDED if left(u) < MOST_LEFT else UNCONVERGED

    def _by_shorter_step(self, u: np.ndarray) -> np.ndarray | None:
        """Return where a part of the linear step from u (P,) leads, if that lowers the cost.

        The whole step may lose a contact. A trust region then also turns the step away from
        directions that the data tell little of, and ends far from the minimum.
        """
        before = float(np.sum(self.rows(u) ** 2))
        latest, (low, high) = self.latest, self.forward.bounds()
        step, gain = linear_step(self.slopes(u), latest, low - u, high - u)
        for share in SHORTER if gain > PROMISING else ():
            trial = np.clip(u + share * step, low, high)
            if float(np.sum(self.rows(trial) ** 2)) < before - KEPT_SHARE * share * gain:
                return trial
        return None


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()  # to look for them takes a millisecond


def _blas_alone() -> AbstractContextManager[Any]:
    """Return where matrix products take one thread: on small ones several only wait."""
    return _libraries().limit(limits=1, user_api="blas")


def _fill(seen: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return frames that did not settle are replaced by one that did: their data are blanked or
    marked."""
    if good.all():
        return seen
    out = seen.copy()
    out[~good] = seen[np.argmax(good)]
    return out
