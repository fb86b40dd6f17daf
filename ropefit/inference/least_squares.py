"""Least squares of a forward model on noise-whitened stations, with exact Jacobians.

The noise of a station has a white part, which its points show, and a part that is correlated along
the rope: C = diag(white) + sd² exp(-|Δs|/length), component by component, frames independent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, stats
from threadpoolctl import threadpool_limits

from ropefit.inference.forward import Forward, Point
from ropefit.inference.stations import Data, Stations, match

FAR = 1e3  # whitened residual of a frame that did not settle: no fit goes there
FLOOR = 2e-5  # m: what a discrete rod of some eighty segments does not resolve


@dataclass(frozen=True)
class Noise:
    """sd [m] of the correlated part and its length, a share of the rope's; marker: sd [m] of
    markers, whose scatter cannot be seen within one frame; white (D,) [m²]: variance of a point,
    measured at the start of a fit if not given. Fits that are compared must share it."""

    correlated: float = 0.0
    length: float = 0.06
    marker: float = 0.0
    white: tuple[float, ...] | None = None


@dataclass
class Whitener:
    """Inverse Cholesky factors of the stations' covariance, by frame and component."""

    rows: list[np.ndarray]
    inverses: list[np.ndarray]

    @staticmethod
    def of(s: Stations, noise: Noise) -> Whitener:
        white = s.scatter / s.count[:, None] + FLOOR**2 + noise.marker**2
        rows, inverses = [], []
        dims = s.residual.shape[1]
        starts = np.flatnonzero(np.diff(s.frame, prepend=-1))
        for part in np.split(np.arange(len(s.frame)), starts[1:]):
            apart = np.abs(s.share[part, None] - s.share[None, part])
            common = noise.correlated**2 * np.exp(-apart / noise.length)
            for d in range(dims):
                rows.append(part * dims + d)
                factor = np.linalg.cholesky(common + np.diag(white[part, d]))
                inverses.append(np.linalg.inv(factor))
        return Whitener(rows, inverses)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Whitened rows of values (M, D) or (M, D, P): (M D,) or (M D, P)."""
        flat = values.reshape(values.shape[0] * values.shape[1], -1)
        out = np.empty_like(flat)
        for rows, inverse in zip(self.rows, self.inverses, strict=True):
            out[rows] = inverse @ flat[rows]
        return out[:, 0] if values.ndim == 2 else out

    def undo(self, z: np.ndarray) -> np.ndarray:
        """(M D,) in metres from whitened values (M D,)."""
        out = np.empty_like(z)
        for rows, inverse in zip(self.rows, self.inverses, strict=True):
            out[rows] = np.linalg.solve(inverse, z[rows])
        return out


@dataclass
class Fit:
    """The best point and everything the fit knows there.

    z (M D,): whitened residual; jacobian (M D, P) of the model in the search variables, whitened;
    covariance (P, P) of the search variables; cost: χ² with the priors' share; scale: sd of z.
    """

    forward: Forward
    point: Point
    stations: Stations
    whitener: Whitener
    z: np.ndarray
    jacobian: np.ndarray
    prior: np.ndarray
    covariance: np.ndarray
    cost: float
    freedom: int
    converged: bool
    evaluations: int
    trace: list[float]

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
    forward: Forward,
    data: Data,
    noise: Noise,
    bins: int,
    start: np.ndarray | None = None,
    evaluations: int = 60,
    report: Report | None = None,
    tolerance: float = 1e-7,
) -> Fit:
    """Minimise the whitened residual and the priors, from `start` (search variables).

    Raises ArithmeticError when the start itself does not settle in any frame.
    """
    u = forward.start() if start is None else np.asarray(start, dtype=float)
    prior = forward.prior()
    held = np.isfinite(prior)
    first = forward.at(u)
    settled = first.solution.converged
    if not settled.any():
        raise ArithmeticError("no frame reaches an equilibrium from the start")
    if not settled.all():
        data = data_without(data, ~settled)
    seen = _fill(first.seen, settled)
    stations = match(data, seen, bins)
    if noise.white is not None and not data.material:
        same = np.broadcast_to(noise.white, stations.residual.shape).copy()
        stations = replace(stations, scatter=same)
    whitener = Whitener.of(stations, noise)
    low, high = forward.bounds()
    trace: list[float] = []
    cache: dict[bytes, tuple[Point, Stations, np.ndarray]] = {}

    def evaluate(v: np.ndarray) -> tuple[Point, Stations, np.ndarray]:
        key = v.tobytes()
        if key not in cache:
            point = forward.at(v)
            bad = np.isnan(point.seen).any(axis=(1, 2)) & settled
            now = match(data, _fill(point.seen, settled & ~bad), bins)
            residual = aligned(now, stations, now.residual)
            z = whitener(residual)
            if bad.any():
                hit = np.repeat(bad[stations.frame], residual.shape[1])
                z[hit] = FAR
            cache.clear()
            cache[key] = (point, now, z)
        return cache[key]

    def residual(v: np.ndarray) -> np.ndarray:
        z = evaluate(v)[2]
        rows = np.concatenate([z, (v / prior)[held]])
        trace.append(float(rows @ rows))
        if report:
            report(trace[-1])
        return rows

    def slope(v: np.ndarray) -> np.ndarray:
        point, now, _ = evaluate(v)
        rows = sensitivity(forward.jacobian(point), now, stations, whitener)
        return np.concatenate([-rows, np.diag(1 / prior)[held]])

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
    point, now, z = evaluate(result.x)
    jacobian = sensitivity(forward.jacobian(point), now, stations, whitener)
    freedom = max(len(z) - int((~held).sum()), 1)
    spread = max(float(z @ z) / freedom, 1e-12)
    # The residual's own size scales the data's share of the information, not the priors'.
    scaled = jacobian.T @ jacobian / spread + np.diag(np.where(held, 1 / prior**2, 0.0))
    current = Stations(
        stations.frame, stations.bin, stations.share, stations.count,
        aligned(now, stations, now.residual), stations.basis, stations.segment,
        stations.weight, stations.scatter,
    )  # fmt: skip
    return Fit(
        forward, point, current, whitener, z, jacobian, prior, np.linalg.pinv(scaled, rcond=1e-14),
        2 * float(result.cost), freedom, result.status > 0, int(result.nfev), trace,
    )  # fmt: skip


def data_without(data: Data, dropped: np.ndarray) -> Data:
    """The data with some frames (F,) bool blanked."""
    return Data(data.points, data.share, data.mask & ~dropped[:, None], data.material, data.eye)


def sensitivity(
    dx: np.ndarray, now: Stations, stations: Stations, whitener: Whitener
) -> np.ndarray:
    """(M D, P) whitened change of the model at the stations for changes dx (P, F, K, 3)."""
    return whitener(aligned(now, stations, now.project(dx)))


def aligned(now: Stations, stations: Stations, values: np.ndarray) -> np.ndarray:
    """Values (M', D, ...) of the stations of another match, for those of the first; else zero."""
    many = int(max(now.bin.max(initial=0), stations.bin.max(initial=0))) + 1
    key, wanted = now.frame * many + now.bin, stations.frame * many + stations.bin
    out = np.zeros((len(wanted), *values.shape[1:]))
    _, here, there = np.intersect1d(wanted, key, assume_unique=True, return_indices=True)
    out[here] = values[there]
    return out


def _fill(seen: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Frames that did not settle are replaced by one that did: their data are blanked or marked."""
    if good.all():
        return seen
    out = seen.copy()
    out[~good] = seen[np.argmax(good)]
    return out
