"""Least squares of a forward model on noise-whitened stations, with exact Jacobians."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, stats
from threadpoolctl import threadpool_limits

from ropefit.inference.bins import Stations, aligned
from ropefit.inference.discrepancy import inflation
from ropefit.inference.known import Known
from ropefit.inference.noise import Whitener
from ropefit.inference.problem import FitProblem
from ropefit.models.model import Model
from ropefit.models.response import Point
from ropefit.runs.journal import Arrays

FAR = 1e3  # whitened residual of a frame that did not settle: no fit goes there


@dataclass
class Fit:
    """The best point and everything the fit knows there.

    problem: what the model was fitted to; z (M D,): whitened residual; jacobian (M D, P) of the
    model in the search variables, whitened;
    covariance (P, P) of the search variables; cost: χ² with the priors' share; scale: sd of z;
    spread: by how much the variance of estimates exceeds that by the noise alone.
    """

    forward: Model
    problem: FitProblem
    point: Point
    stations: Stations
    whitener: Whitener
    z: np.ndarray
    jacobian: np.ndarray
    prior: np.ndarray
    covariance: np.ndarray
    cost: float
    spread: float
    freedom: int
    converged: bool
    evaluations: int
    trace: list[float]
    calm: Fit | None = None  # without the frames that stand out, once made: `diagnosis/calm.py`

    @property
    def scale(self) -> float:
        """sd of the whitened residual per degree of freedom."""
        return float(np.sqrt((self.z @ self.z) / self.freedom))

    @property
    def quantile(self) -> float:
        """Student's t for 95 %."""
        return float(stats.t.ppf(0.975, self.freedom))

    def sd(self) -> np.ndarray:
        """(P,) of the search variables; larger than their prior they never get."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))


Report = Callable[[float], None]


def fit(
    forward: Model,
    problem: FitProblem,
    start: np.ndarray | None = None,
    evaluations: int = 60,
    report: Report | None = None,
    tolerance: float = 1e-7,
) -> Fit:
    """Minimise the whitened residual and the priors, from `start` (search variables).

    Raises ArithmeticError when the start itself does not settle in any frame, or is not possible:
    a fit stays where length, rigidity and density are positive.
    """
    u = forward.start() if start is None else np.asarray(start, dtype=float)
    prior = forward.prior()
    held = np.isfinite(prior)
    known = Known(forward, u)
    first = known.first
    settled, used = first.converged, problem
    if not first.setup.possible:
        raise ArithmeticError("the start is a rope that no matter makes")
    if not settled.any():
        raise ArithmeticError("no frame reaches an equilibrium from the start")
    if not settled.all():
        used = problem.without(~settled)
    seen = _fill(first.seen, settled)
    stations = used.match(seen)
    if problem.noise.white is not None and not problem.data.material:
        same = np.broadcast_to(problem.noise.white, stations.residual.shape).copy()
        stations = replace(stations, scatter=same)
    whitener = Whitener.of(stations, problem.noise)
    low, high = forward.bounds()
    trace: list[float] = []
    cache: dict[bytes, tuple[Point, Stations, np.ndarray]] = {}

    def evaluate(v: np.ndarray) -> tuple[Point, Stations, np.ndarray]:
        key = v.tobytes()
        if key not in cache:
            point = known.at(v)
            bad = np.isnan(point.seen).any(axis=(1, 2)) & settled
            if not point.setup.possible:
                bad = settled
            now = used.match(_fill(point.seen, settled & ~bad))
            residual = aligned(now, stations, now.residual)
            z = whitener(residual)
            if bad.any():
                hit = np.repeat(bad[stations.frame], residual.shape[1])
                z[hit] = FAR
            cache.clear()
            cache[key] = (point, now, z)
        return cache[key]

    def jacobian_at(v: np.ndarray) -> np.ndarray:
        point, now, _ = evaluate(v)
        return sensitivity(forward.jacobian(point), now, stations, whitener)

    def residual(v: np.ndarray) -> np.ndarray:
        z = known.rows("z", v, lambda: evaluate(v)[2])
        rows = np.concatenate([z, (v / prior)[held]])
        trace.append(float(rows @ rows))
        if report:
            report(trace[-1])
        return rows

    def slope(v: np.ndarray) -> np.ndarray:
        rows = known.rows("slope", v, lambda: jacobian_at(v))
        return np.concatenate([-rows, np.diag(1 / prior)[held]])

    def minimum() -> tuple[Arrays, Point]:
        if not u.size:  # nothing is free; not every scipy takes that
            rows = residual(u)
            told = np.array([0.5 * float(rows @ rows), 1, 1])
            return {"u": u, "told": told, "trace": np.array(trace)}, evaluate(u)[0]
        with threadpool_limits(1, "blas"):  # small matrices: threads only wait for each other
            result = optimize.least_squares(
                residual,
                u,
                slope,  # type: ignore[arg-type]
                bounds=(low, high),
                x_scale="jac",
                max_nfev=evaluations,
                ftol=tolerance,
                xtol=1e-9,
                gtol=1e-10,
            )
        told = np.array([result.cost, result.status, result.nfev])
        found = {"u": result.x, "told": told, "trace": np.array(trace)}
        return found, evaluate(result.x)[0]

    best = known.result(minimum)
    point, now, z = evaluate(best["u"])
    cost, status, nfev = best["told"]
    jacobian = jacobian_at(best["u"])
    freedom = max(len(z) - int((~held).sum()), 1)
    elsewhere = forward.instantaneous and problem.noise.repeats > 1  # of a motion: measured here
    spread = inflation(stations, z, float(np.sqrt(z @ z / freedom)), point.seen, elsewhere)
    # What the model misses scales the data's share of the information, not the priors'.
    scaled = jacobian.T @ jacobian / spread + np.diag(np.where(held, 1 / prior**2, 0.0))
    current = replace(stations, residual=aligned(now, stations, now.residual))
    return Fit(
        forward, problem, point, current, whitener, z, jacobian, prior,
        np.linalg.pinv(scaled, rcond=1e-14), 2 * float(cost), spread, freedom, bool(status > 0),
        int(nfev), best["trace"].tolist(),
    )  # fmt: skip


def attempted(
    forward: Model, problem: FitProblem, start: np.ndarray, evaluations: int, tolerance: float
) -> Fit | None:
    """The same; None where a rope so described does not settle, or its numbers run away."""
    try:
        return fit(forward, problem, start, evaluations, tolerance=tolerance)
    except (ArithmeticError, ValueError):  # of which a singular matrix is one
        return None


def sensitivity(
    dx: np.ndarray, now: Stations, stations: Stations, whitener: Whitener
) -> np.ndarray:
    """(M D, P) whitened change of the model at the stations for changes dx (P, F, K, 3)."""
    return whitener(aligned(now, stations, now.project(dx)))


def _fill(seen: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Frames that did not settle are replaced by one that did: their data are blanked or marked."""
    if good.all():
        return seen
    out = seen.copy()
    out[~good] = seen[np.argmax(good)]
    return out
