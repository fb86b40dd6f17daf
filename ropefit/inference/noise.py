"""The noise of stations: white, correlated along the rope, and that of the measured ends.

The white part is shown by the points of a station. Another part is correlated along the rope:
sd² exp(-|Δs|/length), component by component. Ends are measured frame by frame, and a whole rope
follows its ends. Frames are independent. What is not known is estimated by maximum likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ropefit.inference.bins import Stations, aligned

FLOOR = 2e-5  # m: what a discrete rod of some eighty segments does not resolve
LENGTHS = (0.03, 0.06, 0.12, 0.25, 0.6)  # of the rope
RATIOS = (0.35, 0.6, 1.0, 1.6, 2.5, 4.0, 7.0, 12.0)  # correlated to white sd
# m, sd of an end in one frame
POSITIONS = (0.0, 5e-5, 1e-4, 1.5e-4, 2e-4, 3e-4, 5e-4, 8e-4, 1.2e-3)
TILTS = (0.0, 1e-3, 2e-3, 4e-3, 8e-3)  # rad, of a clamp
MISFIT = 1.25  # times the noise: more is what the model misses
PLACES = ("frame", "bin", "share", "count", "scatter", "fall")  # what covariances depend on
MOST_KEPT = 2  # whiteners of one noise
AT_ONCE = 8192  # rows that are whitened at once: their copies are small
COST = 2.0  # nats that a further kind of noise must earn
PAST = 2  # growing sd in a row that are less likely than a smaller one, after which none is tried


@dataclass(frozen=True)
class EndNoise:
    """What errors of the ends in single frames do to the stations there.

    stations: whose rows these are; position (M, D, P) per metre, tilt (M, D, Q) per radian; sd of
    both [m], [rad].
    """

    stations: Stations
    position: np.ndarray
    tilt: np.ndarray
    sd: tuple[float, float] = (0.0, 0.0)

    def columns(self, s: Stations) -> np.ndarray:
        """Return (M, D, P + Q) for the stations of another match, of one sd each."""
        own = np.concatenate([self.sd[0] * self.position, self.sd[1] * self.tilt], axis=-1)
        return own if s is self.stations else aligned(self.stations, s, own)

    def frames(self, index: np.ndarray) -> EndNoise:
        """Return the noise of some frames (f,) alone."""
        rows, few = self.stations.among(index)
        return EndNoise(few, self.position[rows], self.tilt[rows], self.sd)


@dataclass(frozen=True)
class Noise:
    """sd [m] of the correlated part and its length, a share of the rope's; marker: sd [m] of
    markers, whose scatter cannot be seen within one frame; repeats: of how many samples one is
    independent, where what a motion misses wanders; unequal (F,): variance of each frame's markers
    over marker squared; sensor: sd [m] of markers by themselves; white
    (D,) [m²]: variance of a point, measured at the start of a fit if not given; ends. Fits that are
    compared must share it."""

    correlated: float = 0.0
    length: float = 0.06
    marker: float = 0.0
    repeats: float = 1.0
    unequal: tuple[float, ...] | None = None
    sensor: float = 0.0
    white: tuple[float, ...] | None = None
    ends: EndNoise | None = None

    @cached_property
    def whiteners(self) -> list[tuple[Stations, Whitener]]:
        """Return the latest whiteners of this noise, and of which stations they are."""
        return []

    @property
    def misfit(self) -> bool:
        """Return whether it is mostly what a model of the same rope missed elsewhere."""
        return self.marker > MISFIT * self.sensor > 0

    @property
    def coloured(self) -> bool:
        """Return whether it is more than white."""
        return self.correlated > 0 or (self.ends is not None and any(self.ends.sd))

    def frames(self, index: np.ndarray) -> Noise:
        """Return the noise of some frames (f,) alone."""
        unequal = None if self.unequal is None else tuple(np.array(self.unequal)[index])
        ends = None if self.ends is None else self.ends.frames(index)
        return replace(self, unequal=unequal, ends=ends)


@dataclass
class Whitener:
    """Cholesky factors (n, k, k) of the stations' covariance and their inverses, of all frames
    with as many stations, or of single stations where these are independent.

    rows (n, k): of (M D,) values, for each of these frames or stations.
    """

    rows: list[np.ndarray]
    factors: list[np.ndarray]
    inverses: list[np.ndarray]

    @staticmethod
    def of(s: Stations, noise: Noise) -> Whitener:
        """Return the whitener of stations: one for all fits that compare the same places."""
        for known, whitener in noise.whiteners:
            if all(np.array_equal(getattr(known, name), getattr(s, name)) for name in PLACES):
                return whitener
        rows, factors = [], []
        for part, covariance in covariances(s, noise):
            rows.append(part)
            factors.append(np.linalg.cholesky(covariance))
        whitener = Whitener(rows, factors, [np.linalg.inv(factor) for factor in factors])
        noise.whiteners[MOST_KEPT - 1 :] = []
        noise.whiteners.insert(0, (s, whitener))
        return whitener

    def __call__(self, values: np.ndarray, own: bool = False) -> np.ndarray:
        """Return whitened rows of values (M, D) or (M, D, P): (M D,) or (M D, P); in their place,
        where they are the caller's own."""
        flat = values.reshape(values.shape[0] * values.shape[1], -1)
        out = flat if own else np.empty_like(flat)
        for rows, inverse in zip(self.rows, self.inverses, strict=True):
            for k, part in some_of(rows):
                out[part] = inverse[k] @ flat[part]
        return out[:, 0] if values.ndim == 2 else out

    def undo(self, z: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return (M D, ...) in metres from whitened values (M D, ...), which may be `out`."""
        out = np.empty_like(z) if out is None else out
        for rows, factor in zip(self.rows, self.factors, strict=True):
            for k, part in some_of(rows):
                own = z[part]
                whole = factor[k] @ own.reshape(*part.shape, -1)
                out[part] = whole.reshape(own.shape)
        return out

    def weighted(self, z: np.ndarray) -> np.ndarray:
        """Return the inverse covariance's product with values of which z (M D, P) are the whitened
        ones."""
        out = np.empty_like(z)
        for rows, inverse in zip(self.rows, self.inverses, strict=True):
            out[rows] = np.swapaxes(inverse, 1, 2) @ z[rows]
        return out


def some_of(rows: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield some of rows (n, k) at once, and which of the n they are, until all are."""
    few = max(1, AT_ONCE // rows.shape[1])
    for k in range(0, len(rows), few):
        yield slice(k, k + few), rows[k : k + few]


def covariances(s: Stations, noise: Noise) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield of n frames with as many stations, or of n independent stations, their rows (n, k) in
    (M D,), and the covariances (n, k, k) [m²]."""
    dims = s.residual.shape[1]
    marker = np.full(len(s.frame), noise.repeats * noise.marker**2)
    if noise.unequal is not None:
        marker *= np.array(noise.unequal)[s.frame]
    white = s.white() + (FLOOR**2 + marker)[:, None, None] * np.eye(dims)
    if not noise.coloured:
        yield np.arange(white.shape[0] * dims).reshape(-1, dims), white
        return
    ends = noise.ends.columns(s) if noise.ends is not None and any(noise.ends.sd) else None
    starts = np.flatnonzero(np.diff(s.frame, prepend=-1))
    counts = np.diff(starts, append=len(s.frame))
    for many in np.unique(counts):
        part = starts[counts == many][:, None] + np.arange(many)
        frames, size, each = len(part), many * dims, np.arange(many)
        out = np.zeros((frames, many, dims, many, dims))
        if noise.correlated:
            apart = np.abs(s.share[part][:, :, None] - s.share[part][:, None, :])
            common = noise.correlated**2 * np.exp(-apart / noise.length)
            for k in range(dims):
                out[:, :, k, :, k] = common
        out[:, each, :, each, :] += np.moveaxis(white[part], 1, 0)
        out = out.reshape(frames, size, size)
        if ends is not None:
            own = ends[part].reshape(frames, size, -1)
            out += own @ np.swapaxes(own, 1, 2)
        yield (part[..., None] * dims + np.arange(dims)).reshape(frames, size), out


def estimate(s: Stations, known: Noise, design: np.ndarray | None = None) -> Noise:
    """Return the noise model under which the stations' residuals (M, D) are most likely.

    known: the parts that are given (marker, white), and the ends' columns where their noise counts.
    design (M D, P) [m]: what else may be in the residual, of one prior sd each; it is integrated
    out, so that it is not taken for noise, nor noise for it (restricted maximum likelihood).
    Without it, whatever the model misses counts as noise: intervals become wider, never narrower.
    """
    return likeliest(s, known, design)[0]


def likeliest(s: Stations, known: Noise, design: np.ndarray | None = None) -> tuple[Noise, float]:
    """Return the same, and its negative log likelihood [nats] but for a constant, with what each
    kind of noise costs: comparable between designs for the same stations."""
    flat = s.residual.reshape(-1)
    design = np.zeros((len(flat), 0)) if design is None else design
    own = np.diagonal(s.white(), axis1=1, axis2=2) + FLOOR**2 + known.marker**2
    typical = float(np.sqrt(np.median(own)))

    computed: dict[tuple[float, ...], float] = {}

    def worth(noise: Noise) -> float:
        kinds = (noise.correlated, *(noise.ends.sd if noise.ends else ()))
        key = (noise.length, *kinds)
        if key not in computed:
            computed[key] = against(noise, kinds)
        return computed[key]

    def against(noise: Noise, kinds: tuple[float, ...]) -> float:
        total = COST * sum(kind > 0 for kind in kinds)
        gram = np.zeros((design.shape[1] + 1, design.shape[1] + 1))
        for rows, covariance in covariances(s, noise):
            factor = np.linalg.cholesky(covariance)
            total += float(np.log(np.diagonal(factor, axis1=1, axis2=2)).sum())
            inverse = np.linalg.inv(factor)
            for k, part in some_of(rows):  # many frames in one go, which is quicker than each
                both = np.concatenate([design[part], flat[part][..., None]], axis=-1)
                white = (inverse[k] @ both).reshape(part.size, -1)
                gram += white.T @ white
        total += 0.5 * float(gram[-1, -1])
        left = np.linalg.cholesky(gram[:-1, :-1] + np.eye(len(gram) - 1))
        fitted = np.linalg.solve(left, gram[:-1, -1])
        return total + float(np.log(np.diag(left)).sum()) - 0.5 * float(fitted @ fitted)

    best = replace(known, correlated=0.0)
    # One kind of noise after the other, twice: they hardly trade.
    for _ in range(2 if known.ends else 1):
        for choices in (_positions, _tilts, _correlated):
            best = _likeliest_of(choices(best, typical), worth)
    return best, worth(best)


def _likeliest_of(choices: list[list[Noise]], worth: Callable[[Noise], float]) -> Noise:
    """Return the noise of the lowest `worth` (negative log likelihood). Each list is of growing sd,
    in which the likelihood is taken to have one maximum: past it, the rest is not computed."""
    known: list[tuple[float, Noise]] = []
    for growing in choices:
        row: list[float] = []
        for noise in growing:
            row.append(worth(noise))
            known.append((row[-1], noise))
            if len(row) > PAST and min(row[-PAST:]) > min(row[:-PAST]):
                break
    return min(known, key=lambda one: one[0])[1]


def _positions(noise: Noise, typical: float) -> list[list[Noise]]:
    ends = noise.ends
    if ends is None:
        return [[noise]]
    none, *some = (replace(noise, ends=replace(ends, sd=(sd, ends.sd[1]))) for sd in POSITIONS)
    return [[none], some]


def _tilts(noise: Noise, typical: float) -> list[list[Noise]]:
    ends = noise.ends
    if ends is None or not ends.tilt.shape[-1]:
        return [[noise]]
    none, *some = (replace(noise, ends=replace(ends, sd=(ends.sd[0], sd))) for sd in TILTS)
    return [[none], some]


def _correlated(noise: Noise, typical: float) -> list[list[Noise]]:
    none = replace(noise, correlated=0.0, length=LENGTHS[0])
    return [[none]] + [
        [replace(noise, correlated=ratio * typical, length=length) for ratio in RATIOS]
        for length in LENGTHS
    ]
