"""Least squares of a forward model on noise-whitened stations, with exact Jacobians."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import stdtrit

from ropefit.inference import clipwise
from ropefit.inference.bins import Stations, aligned, collected
from ropefit.inference.directions import TangentBasis, tangent_basis
from ropefit.inference.discrepancy import inflation, inflation_of_repeated, misled
from ropefit.inference.noise import MISFIT, Whitener
from ropefit.inference.objective import STOPPED, Objective
from ropefit.inference.problem import FitProblem
from ropefit.inference.steps import foreseen, with_priors
from ropefit.inference.verdict import NORMAL_QUANTILE
from ropefit.models.model import Model
from ropefit.models.prior import Prior
from ropefit.models.response import Parts, Point

AS_MATCHED = 0.002  # m: points match a rope whose nodes have moved by less as they did before
MATCHED = 10  # evaluations of a fit to the points as matched where it ended
BOUND_TOLERANCE = 1e-9  # search variables: a parameter nearer to its bound is at it


@dataclass
class Fit:
    """The best point and everything the fit knows there.

    problem: what the model was fitted to; z (M D,): whitened residual; jacobian (M D, P) of the
    model in the search variables, whitened;
    covariance (P, P) of the search variables; cost: χ² with the priors' share; scale: sd of z;
    spread: by how much the variance of estimates exceeds that by the noise alone; independent: the
    degrees of freedom with which that variance is known.
    """

    forward: Model
    problem: FitProblem
    point: Point
    stations: Stations
    whitener: Whitener
    z: np.ndarray
    jacobian: np.ndarray
    prior: Prior
    cost: float
    spread: float
    freedom: int
    samples: float
    converged: bool
    evaluations: int
    trace: list[float]
    stopped: bool = False  # before its minimum: there was no prospect of what was needed
    moved: float = 0.0  # m, the most of any node from where the fit began
    # Residuals that were predicted with stretches (True) or frames held out, once computed.
    held_out: dict[bool, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    firm: np.ndarray | None = None  # (M D,) the rows that are predicted, once known
    calm: Fit | None = None  # without the frames that stand out, once made: `diagnosis/calm.py`
    coarse: Fit | None = None  # on fewer segments, once made: `diagnosis/coarse_mesh.py`
    # [m rms], once computed of this very point: `diagnosis/innovations.py`.
    innovations: float | None = field(default=None, init=False)

    @property
    def scale(self) -> float:
        """Return sd of the whitened residual per degree of freedom."""
        return float(np.sqrt((self.z @ self.z) / self.freedom))

    @property
    def as_matched(self) -> bool:
        """Return whether points match the rope where the fit ended as they did where it began."""
        by_shape = self.forward.instantaneous and not self.problem.data.material
        return not by_shape or self.moved < AS_MATCHED

    @property
    def markers_at_rest(self) -> bool:
        """Return whether it is of markers on a rope at rest."""
        return self.problem.data.material and self.forward.instantaneous

    @property
    def misses(self) -> bool:
        """Return whether the model misses more of markers at rest than their noise, here or in the
        recording that the rope is known from."""
        return self.markers_at_rest and (self.problem.noise.misfit or self.scale > MISFIT)

    @property
    def known_elsewhere(self) -> bool:
        """Return whether the rope is known from another recording of its markers at rest: what that
        knows of it holds here up to what its model misses."""
        return self.markers_at_rest and bool(self.prior.together)

    @cached_property
    def left_to_gain(self) -> float:
        """Return by how much a linear step lowers χ², as large as noise makes it: of a fit that has
        arrived next to nothing."""
        u = self.point.u
        rows = np.concatenate([self.z, self.prior.rows(u)])
        slopes = with_priors(self.jacobian, self.prior)
        return foreseen(rows, slopes, u, *self.forward.bounds())

    @cached_property
    def by_noise(self) -> np.ndarray:
        """Return (P, P) covariance of the search variables, what is missed taken for noise: it
        scales the data's share of the information, not the priors'. None of what neither tells."""
        return self._by_noise(self.prior)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Return (P, P) of the search variables; at rest what the model misses misleads them, and
        in motion they scatter from clip to clip.

        Data may tell nothing of a direction, as of a steady load's part along gravity, which acts
        as a heavier, stiffer rope does. A pseudo-inverse has no variance there; the truth is as
        wide as the broad prior of the effects' sizes.
        """
        prior = self.prior.with_broad(self.forward.broad())
        if not (self.misses or self.known_elsewhere):
            return self._widened(self._by_noise(prior))
        basis, jacobian, held = self._basis, self.jacobian, prior.information
        if basis is not None:
            jacobian, held = jacobian @ basis.vectors, basis.information(prior)
        data, s = jacobian.T @ jacobian, self.stations
        inverse = np.linalg.pinv(data + held, rcond=1e-14)
        lever = inverse @ self.whitener.weighted(jacobian).T
        noise = self.problem.noise
        # Of a rope that is known from elsewhere the sensor's noise is known beside what is missed.
        sensor = noise.sensor if self.known_elsewhere else 0.0
        fresh = min((sensor / noise.marker) ** 2, 1.0) if sensor else 0.0
        score = data * max(max(self.scale**2, 1.0) / noise.repeats, fresh)
        out = inverse @ (score + held) @ inverse
        bias = misled(s, lever.reshape(-1, *s.residual.shape), noise.marker, sensor)
        wider = np.sqrt(1 + bias**2 / np.maximum(np.diag(out), np.finfo(float).tiny))
        out = wider[:, None] * out * wider
        return out if basis is None else basis.covariance(out)

    @cached_property
    def _basis(self) -> TangentBasis | None:
        return tangent_basis(self.forward, self.point.u)

    def _widened(self, covariance: np.ndarray) -> np.ndarray:
        """Return the covariance (P, P) of a motion, no narrower than estimates scatter by clip."""
        if self.forward.instantaneous:
            return covariance
        scattered = clipwise.scatter(
            self.jacobian, self.z, self.clip_of_rows(), self.prior.information
        )
        if scattered is None:
            return covariance
        sd = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        wider = np.maximum(scattered / sd, 1.0)
        return wider[:, None] * covariance * wider

    def clip_of_rows(self) -> np.ndarray:
        """Return (M D,) which clip each row of the Jacobian is of, -1 for none."""
        clip = np.full(len(self.point.seen), -1)
        for number, frames in enumerate(self.forward.clips):
            clip[frames] = number
        return np.repeat(clip[self.stations.frame], self.stations.residual.shape[1])

    def _by_noise(self, prior: Prior) -> np.ndarray:
        basis, jacobian, held = self._basis, self.jacobian, prior.information
        if basis is not None:
            jacobian, held = jacobian @ basis.vectors, basis.information(prior)
        information = jacobian.T @ jacobian / self.spread + held
        out = np.linalg.pinv(information, rcond=1e-14)
        return out if basis is None else basis.covariance(out)

    @property
    def student(self) -> float:
        """Return Student's t for 95 %, of the variance by noise."""
        return float(stdtrit(self.samples, 0.975))

    @property
    def quantile(self) -> float:
        """Return the standard errors of a 95 % interval."""
        return NORMAL_QUANTILE if self.misses else self.student

    def sd(self) -> np.ndarray:
        """Return (P,) of the search variables; larger than their prior they never get."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))


def inside(fitted: Fit) -> np.ndarray:
    """Return (P,) bool: the search variables that are not at a bound."""
    low, high = fitted.forward.bounds()
    u = fitted.point.u
    return (u > low + BOUND_TOLERANCE) & (u < high - BOUND_TOLERANCE)


def fit(
    forward: Model,
    problem: FitProblem,
    start: np.ndarray | None = None,
    evaluations: int = 60,
    tolerance: float = 1e-7,
    needed: float = np.inf,
    highest: float = np.inf,
    thorough: bool = False,
) -> Fit:
    """Minimise the whitened residual and the priors, from `start` (search variables).

    needed: a cost; a fit that, by its linear steps, has no prospect of it is stopped. highest: the
    cost above which it is stopped where it begins. thorough: shapes at rest that touch
    nothing are fitted also along a narrow, curved valley.

    Raises ArithmeticError when the start itself does not settle in any frame, or is not possible:
    a fit stays where length, rigidity and density are positive.
    """
    problem.work.begin()
    u = forward.start() if start is None else np.asarray(start, dtype=float)
    objective = Objective(forward, problem, u, needed, highest)
    best = objective.known.result(lambda: objective.minimum(u, evaluations, tolerance, thorough))
    point, now, z = objective.at(best["u"])
    cost, status, nfev = best["summary"]
    problem.work.add(int(nfev), objective.touches)
    jacobian, prior = objective.jacobian(best["u"]), objective.prior
    free = int((~prior.held).sum())
    freedom = max(len(z) - free, 1)
    stations = objective.stations
    repeats = problem.noise.repeats
    if repeats > 1 and forward.instantaneous:
        spread, share = inflation_of_repeated(z, repeats, free), 1.0
    else:
        scale = float(np.sqrt(z @ z / freedom))
        spread, share = inflation(objective.stations, z, scale, point.seen, repeats > 1)
    samples = max(share * len(z) / repeats - free, 1.0)
    current = replace(stations, residual=aligned(now, stations, now.residual))
    return Fit(
        forward, problem, point, current, objective.whitener, z, jacobian, prior,
        2 * float(cost), spread, freedom, samples, bool(status > 0), int(nfev),
        best["trace"].tolist(), bool(status == STOPPED), objective.moved(point.seen),
    )  # fmt: skip


def attempted(
    forward: Model, problem: FitProblem, start: np.ndarray, evaluations: int, tolerance: float,
    needed: float = np.inf, matched: bool = True, highest: float = np.inf, thorough: bool = False,
) -> Fit | None:  # fmt: skip
    """Return the same, of shapes at rest with the points matched to the rope where the fit ends;
    None where a rope so described does not settle, or its numbers run away.

    Where it began the rope had another shape. Points matched to that one have another minimum, and
    another scatter: costs after different matches do not compare. matched: whether that is asked
    for; not of a fit that is continued anyway.
    """
    try:
        found = fit(forward, problem, start, evaluations, tolerance, needed, highest, thorough)
        if found.stopped or found.as_matched or not matched:
            return found
        forward = found.forward.starting_from(found.point.solution)
        again = fit(
            forward, problem, found.point.u, min(evaluations, MATCHED), tolerance, thorough=thorough
        )
        return again if len(again.z) == len(found.z) else found
    except (ArithmeticError, ValueError):  # of which a singular matrix is one
        return None


def sensitivity(
    dx: np.ndarray, now: Stations, stations: Stations, whitener: Whitener
) -> np.ndarray:
    """Return (M D, P) whitened change of the model at the stations for changes dx (P, F, K, 3)."""
    return whitener(aligned(now, stations, now.project(dx)))


def by_parts(fitted: Fit, parts: Parts, many: int) -> np.ndarray:
    """Return (M D, P) the same at a fit's own stations for `many` changes, some frames at once."""
    s = fitted.stations
    return fitted.whitener(collected(s, s, parts, many), own=True)
