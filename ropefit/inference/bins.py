"""What a recording says about the rope's place, station by station along it.

A cloud's points have no counterpart on the rope: only their offset across the curve counts. The
points that fall to the same short stretch make one station, robustly, with the white noise that
they show (round_surface.py); nothing is lost, since no shape changes within a stretch.
Markers are stations as they are, in three dimensions. Of pictures without depth only the offset to
the side of the ray counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from ropefit.inference.round_surface import axis, information
from ropefit.solvers.kernels.jit import exact_helper, exact_kernel

WINDOW = 0.08  # of the length: how far a point may lie from where preprocess put it
FINE = 4  # points of the curve for every segment
STRIDE = 4  # segments of the curve that are passed over at once
FEWEST = 3  # points of a station that say anything


@dataclass(frozen=True)
class Data:
    """Points (F, P, 3) [m], their share of the rope's length (F, P) and mask (F, P).

    material: the shares are known (markers), so that all three components count. eye (3,) [m]:
    where the sensor is. firm: every masked point counts, whatever the curve; fits that are compared
    need the same points. before (F, P) [m]: how far the points were moved onto the axis from the
    surface of a rope of `radius` [m]; 0 where no surface was seen. depth: False where points are
    pixels, which tell their rays only.
    """

    points: np.ndarray
    share: np.ndarray
    mask: np.ndarray
    material: bool
    eye: np.ndarray
    firm: bool = False
    before: np.ndarray | None = None
    radius: float = 0.0
    depth: bool = True

    def frames(self, index: np.ndarray) -> Data:
        return replace(
            self, points=self.points[index], share=self.share[index], mask=self.mask[index],
            before=None if self.before is None else self.before[index],
        )  # fmt: skip

    def as_deep_as(self, x: np.ndarray) -> Data:
        """Return the points carried along their rays to the depth of the curve through nodes x
        (F, K, 3), where they tell no depth of their own."""
        if self.depth:
            return self
        frame, slot = np.nonzero(self.mask)
        ray = self.points[frame, slot] - self.eye
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        far = ((_on_curve(x, frame, self.share[frame, slot])[3] - self.eye) * ray).sum(1)
        points = self.points.copy()
        points[frame, slot] = self.eye + far[:, None] * ray
        return replace(self, points=points)

    def settled(self, x: np.ndarray) -> Data:
        """Return only the points that count against the curve through nodes x (F, K, 3), from now
        on."""
        if self.material:
            return self
        loose = replace(self, firm=False)
        return replace(self, mask=offsets(loose, np.nan_to_num(x))[1], firm=True)


@dataclass(frozen=True)
class Stations:
    """M stations against a model's curve; D = 2 components across it, 3 for markers, 1 for pixels.

    frame, bin (M,); share (M,) of the length; count (M,) points; residual (M, D) [m] data minus
    model; basis (M, D, 3); segment (M,), weight (M, 4): the station's place is
    Σ_k weight_k x[segment - 1 + k]; scatter (M, D) [m²] white variance of a point, pooled; fall
    (M, 2) of the points' surface (round_surface.py).
    """

    frame: np.ndarray
    bin: np.ndarray
    share: np.ndarray
    count: np.ndarray
    residual: np.ndarray
    basis: np.ndarray
    segment: np.ndarray
    weight: np.ndarray
    scatter: np.ndarray
    fall: np.ndarray

    @property
    def offset(self) -> np.ndarray:
        """Return (M, 3) [m] the residuals in space, from model to data."""
        return np.einsum("md,mda->ma", self.residual, self.basis)

    def white(self) -> np.ndarray:
        """Return (M, D, D) [m²] white covariance of the stations' residuals."""
        dims = self.scatter.shape[1]
        if dims != 2:
            return np.einsum("md,de->mde", self.scatter, np.eye(dims)) / self.count[:, None, None]
        side, both, deep = information(self.count, self.fall, self.scatter)
        share = side * deep - both**2
        rows = np.stack([deep, -both, -both, side], axis=1) / share[:, None]
        return rows.reshape(-1, 2, 2)

    def among(self, frames: np.ndarray) -> tuple[np.ndarray, Stations]:
        """Return which stations (m,) lie in some frames (f,), and these, of those frames alone."""
        place = np.full(max(self.frame.max(initial=0), frames.max(initial=0)) + 1, -1)
        place[frames] = np.arange(len(frames))
        mine = np.flatnonzero(place[self.frame] >= 0)
        few = Stations(*(getattr(self, one.name)[mine] for one in fields(self)))
        return mine, replace(few, frame=place[few.frame])

    def places(self, x: np.ndarray) -> np.ndarray:
        """Return (..., M, 3) of the stations for nodes, or changes of nodes, x (..., F, K, 3)."""
        out = np.zeros((*x.shape[:-3], len(self.frame), 3))
        for k in range(4):
            node = np.clip(self.segment - 1 + k, 0, x.shape[-2] - 1)
            out += self.weight[:, k, None] * x[..., self.frame, node, :]
        return out

    def project(self, dx: np.ndarray) -> np.ndarray:
        """Return (M, D, P) what changes dx (P, F, K, 3) of the nodes change at the stations."""
        return np.einsum("mda,pma->mdp", self.basis, self.places(dx))


def match(data: Data, x: np.ndarray, bins: int) -> Stations:
    """Return stations of data against the curve through nodes x (F, K, 3), `bins` a frame."""
    if data.material:
        return _markers(data, x)
    data, frames = data.as_deep_as(x), len(x)
    fine = _refine(x)
    share, offset, good = feet(data.points, data.share, data.mask, fine, WINDOW)
    good = data.mask if data.firm else good
    slot = np.clip((data.share * bins).astype(np.int64), 0, bins - 1)
    key = (np.arange(frames)[:, None] * bins + slot)[good]
    offset, share = offset[good], share[good]
    total = frames * bins
    count = np.bincount(key, minlength=total)
    used = np.flatnonzero(count >= FEWEST)
    mean_share = np.bincount(key, share, total)[used] / count[used]
    frame, bin_ = np.divmod(used, bins)
    segment, weight, tangent, place = _on_curve(x, frame, mean_share)
    ray = place - data.eye
    basis = _across(tangent, ray)
    of = np.full(total, -1)
    of[used] = np.arange(len(used))
    kept = of[key] >= 0
    station = of[key[kept]]
    values = np.einsum("nda,na->nd", basis[station], offset[kept])
    if data.before is not None:
        values[:, 1] -= data.before[good][kept]
    residual, effective, scatter, fall = axis(values, station, len(used), data.radius)
    scatter = np.broadcast_to(scatter, residual.shape).copy()
    dims = 2 if data.depth else 1
    return Stations(
        frame, bin_, mean_share, effective, residual[:, :dims], basis[:, :dims], segment, weight,
        scatter[:, :dims], fall,
    )  # fmt: skip


def aligned(now: Stations, stations: Stations, values: np.ndarray) -> np.ndarray:
    """Return values (M', D, ...) of the stations of another match, for those of the first; else
    zero."""
    many = int(max(now.bin.max(initial=0), stations.bin.max(initial=0))) + 1
    key, wanted = now.frame * many + now.bin, stations.frame * many + stations.bin
    out = np.zeros((len(wanted), *values.shape[1:]))
    _, here, there = np.intersect1d(wanted, key, assume_unique=True, return_indices=True)
    out[here] = values[there]
    return out


def offsets(data: Data, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (F, P, 3) [m] from the curve through nodes x (F, K, 3) to the points, and which
    count."""
    if data.material:
        frame, slot = np.nonzero(data.mask)
        place = _on_curve(x, frame, data.share[frame, slot])[3]
        out = np.zeros_like(data.points)
        out[frame, slot] = data.points[frame, slot] - place
        return out, data.mask
    data = data.as_deep_as(x)
    _, offset, good = feet(data.points, data.share, data.mask, _refine(x), WINDOW)
    return offset, data.mask if data.firm else good


def _markers(data: Data, x: np.ndarray) -> Stations:
    frame, slot = np.nonzero(data.mask)
    share = data.share[frame, slot]
    segment, weight, _, place = _on_curve(x, frame, share)
    residual = data.points[frame, slot] - place
    basis = np.broadcast_to(np.eye(3), (len(frame), 3, 3)).copy()
    one = np.ones(len(frame))
    return Stations(
        frame, slot, share, one, residual, basis, segment, weight, np.zeros_like(residual),
        np.zeros((len(frame), 2)),
    )  # fmt: skip


def _weights(t: np.ndarray) -> np.ndarray:
    """Return (M, 4) of the Catmull-Rom cubic at t in 0..1 between its second and third node."""
    return 0.5 * np.stack(
        [-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2],
        axis=-1,
    )


def _slopes(t: np.ndarray) -> np.ndarray:
    return 0.5 * np.stack(
        [-1 + 4 * t - 3 * t**2, -10 * t + 9 * t**2, 1 + 8 * t - 9 * t**2, 3 * t**2 - 2 * t], axis=-1
    )


def _padded(x: np.ndarray) -> np.ndarray:
    """Return nodes with one more at either end, so that the cubic is a parabola there."""
    first = 3 * x[:, :1] - 3 * x[:, 1:2] + x[:, 2:3]
    last = 3 * x[:, -1:] - 3 * x[:, -2:-1] + x[:, -3:-2]
    return np.concatenate([first, x, last], axis=1)


def _refine(x: np.ndarray) -> np.ndarray:
    """Return (F, FINE (K-1) + 1, 3) points of the cubic through the nodes."""
    wide, n = _padded(x), x.shape[1] - 1
    t = np.arange(FINE) / FINE
    quads = np.stack([wide[:, k : k + n] for k in range(4)], axis=2)  # (F, n, 4, 3)
    fine = np.einsum("tk,fnka->fnta", _weights(t), quads).reshape(len(x), -1, 3)
    return np.concatenate([fine, x[:, -1:]], axis=1)


def _on_curve(x, frame, share):
    """Return segment (M,), weights (M, 4), unit tangents and places (M, 3) at shares of the
    length."""
    n = x.shape[1] - 1
    at = np.clip(share, 0, 1) * n
    segment = np.minimum(at.astype(np.int64), n - 1)
    t = at - segment
    weight, slope = _weights(t), _slopes(t)
    # Beyond the ends: the parabola's node in terms of the three next.
    for row in (weight, slope):
        first, last = segment == 0, segment == n - 1
        row[first] += row[first, :1] * np.array([0.0, 3.0, -3.0, 1.0])
        row[first, 0] = 0.0
        row[last] += row[last, 3:] * np.array([1.0, -3.0, 3.0, 0.0])
        row[last, 3] = 0.0
    place, tangent = np.zeros((len(frame), 3)), np.zeros((len(frame), 3))
    for k in range(4):
        node = np.clip(segment - 1 + k, 0, n)
        place += weight[:, k, None] * x[frame, node]
        tangent += slope[:, k, None] * x[frame, node]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return segment, weight, tangent, place


def _across(tangent: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Return (M, 2, 3): across the rope sideways to the ray, and across it along the ray."""
    side = np.cross(tangent, ray)
    size = np.linalg.norm(side, axis=1, keepdims=True)
    axis = np.eye(3)[np.abs(tangent).argmin(axis=1)]
    side = np.where(
        size > 1e-6 * np.linalg.norm(ray, axis=1, keepdims=True), side, np.cross(tangent, axis)
    )
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return np.stack([side, np.cross(side, tangent)], axis=1)


@exact_helper
def _square(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@exact_kernel
def feet(points, guess, mask, curve, window):
    """Find the nearest points of curves (F, M, 3) to points (F, P, 3) within `window` of their
    guess.

    Returns the foot's share of the curve (F, P), the offset (F, P, 3), and whether the foot is an
    inner point of the window, so that the offset lies across the curve.
    """
    frames, count = guess.shape
    last = curve.shape[1] - 1
    share = np.zeros((frames, count))
    offset = np.zeros((frames, count, 3))
    good = np.zeros((frames, count), dtype=np.bool_)
    for f in range(frames):
        reach = 0.0  # of the curve from a place, over the next STRIDE segments
        for k in range(last):
            reach = max(reach, STRIDE * math.sqrt(_square(curve[f, k], curve[f, k + 1])))
        for p in range(count):
            if not mask[f, p]:
                continue
            low = max(0, math.floor((guess[f, p] - window) * last))
            high = min(last, math.ceil((guess[f, p] + window) * last))
            # The foot is no further than the curve is where it was guessed.
            near = min(max(math.floor(guess[f, p] * last), low), high)
            furthest = (math.sqrt(_square(points[f, p], curve[f, near])) + reach) ** 2
            best, close = np.inf, False
            for k in range(low, high):
                if (k - low) % STRIDE == 0:
                    close = _square(points[f, p], curve[f, k]) <= furthest
                if not close:
                    continue
                e0 = curve[f, k + 1, 0] - curve[f, k, 0]
                e1 = curve[f, k + 1, 1] - curve[f, k, 1]
                e2 = curve[f, k + 1, 2] - curve[f, k, 2]
                d0 = points[f, p, 0] - curve[f, k, 0]
                d1 = points[f, p, 1] - curve[f, k, 1]
                d2 = points[f, p, 2] - curve[f, k, 2]
                t = (d0 * e0 + d1 * e1 + d2 * e2) / (e0 * e0 + e1 * e1 + e2 * e2)
                inside = 0.0 <= t <= 1.0
                # The end of the rope is a foot too if the point lies hardly beyond it.
                if t < 0.0:
                    inside = k > low or (k == 0 and t > -0.5)
                    t = 0.0
                elif t > 1.0:
                    inside = k < high - 1 or (k == last - 1 and t < 1.5)
                    t = 1.0
                d0 -= t * e0
                d1 -= t * e1
                d2 -= t * e2
                square = d0 * d0 + d1 * d1 + d2 * d2
                if square < best:
                    best = square
                    share[f, p] = (k + t) / last
                    offset[f, p, 0], offset[f, p, 1], offset[f, p, 2] = d0, d1, d2
                    good[f, p] = inside
    return share, offset, good
