"""What a recording says about the rope's place, station by station along it.

A cloud's points have no counterpart on the rope: only their offset across the curve counts. The
points that fall to the same short stretch make one station, robustly, with the white noise that
they show (round_surface.py); nothing is lost, since no shape changes within a stretch.
Markers are stations as they are, in three dimensions. Of pictures without depth only the offset to
the side of the ray counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from ropefit.inference.curve import across, feet, on_curve, refined
from ropefit.inference.round_surface import axis, information

WINDOW = 0.08  # of the length: how far a point may lie from where preprocess put it
FEWEST = 3  # points of a station that say anything
LEAST_BESIDE = 0.5  # of a frame's points lie beside the curve: else the curve is off, not they


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
        """Return the points moved along their rays to the depth of the curve through nodes x
        (F, K, 3), where they tell no depth of their own."""
        if self.depth:
            return self
        frame, slot = np.nonzero(self.mask)
        ray = self.points[frame, slot] - self.eye
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        far = ((on_curve(x, frame, self.share[frame, slot])[3] - self.eye) * ray).sum(1)
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

    def nodes(self, many: int) -> np.ndarray:
        """Return (K',) which of so many nodes the stations' places depend on, in order."""
        near = self.segment[:, None] + np.arange(-1, 3)
        return np.unique(np.clip(near, 0, many - 1))

    def places(self, x: np.ndarray, at: np.ndarray | None = None) -> np.ndarray:
        """Return (..., M, 3) of the stations for nodes, or changes of nodes, x (..., F, K, 3); at
        (K,): which nodes these are, of `nodes`; None: all."""
        *many, frames, nodes, axes = x.shape
        rows = x.reshape(*many, frames * nodes, axes)  # of which to take is quicker
        out = np.zeros((*many, len(self.frame), axes))
        for k in range(4):
            node = np.clip(self.segment - 1 + k, 0, nodes - 1 if at is None else at[-1])
            node = node if at is None else np.searchsorted(at, node)
            part = rows.take(self.frame * nodes + node, axis=-2)
            part *= self.weight[:, k, None]
            out += part
        return out

    def project(self, dx: np.ndarray, at: np.ndarray | None = None) -> np.ndarray:
        """Return (M, D, P) what changes dx (P, F, K, 3) of the nodes change at the stations; at:
        as of `places`."""
        return np.einsum("mda,pma->mdp", self.basis, self.places(dx, at))


def match(data: Data, x: np.ndarray, bins: int) -> Stations:
    """Return stations of data against the curve through nodes x (F, K, 3), `bins` a frame."""
    if data.material:
        return _markers(data, x)
    data, frames = data.as_deep_as(x), len(x)
    fine = refined(x)
    share, offset, good = feet(data.points, data.share, data.mask, fine, WINDOW)
    good = _counted(data, good)
    slot = np.clip((data.share * bins).astype(np.int64), 0, bins - 1)
    key = (np.arange(frames)[:, None] * bins + slot)[good]
    offset, share = offset[good], share[good]
    total = frames * bins
    count = np.bincount(key, minlength=total)
    used = np.flatnonzero(count >= FEWEST)
    mean_share = np.bincount(key, share, total)[used] / count[used]
    frame, bin_ = np.divmod(used, bins)
    segment, weight, tangent, place = on_curve(x, frame, mean_share)
    ray = place - data.eye
    basis = across(tangent, ray)
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
    out = np.zeros((len(stations.frame), *values.shape[1:]))
    here, there = shared(now, stations)
    out[here] = values[there]
    return out


def collected(
    now: Stations, stations: Stations, parts: Iterator[tuple[np.ndarray, np.ndarray]], many: int,
    at: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Return (M, D, P) what changes of the nodes change at the stations of a first match, where
    another match has them.

    parts: indices (f,) of frames with `many` changes (P, f, K, 3) there; at: as of `places`.
    """
    rows = np.zeros((*stations.residual.shape, many))
    here, there = shared(now, stations)
    place = np.full(len(now.frame), -1)
    place[there] = here
    for frames, dx in parts:
        mine, few = now.among(frames)
        kept = place[mine] >= 0
        rows[place[mine][kept]] = few.project(dx, at)[kept]
        del dx  # before the next part is made
    return rows


def shared(now: Stations, stations: Stations) -> tuple[np.ndarray, np.ndarray]:
    """Return indices of the same stations among the second and the first of two matches."""
    many = int(max(now.bin.max(initial=0), stations.bin.max(initial=0))) + 1
    key, wanted = now.frame * many + now.bin, stations.frame * many + stations.bin
    return np.intersect1d(wanted, key, assume_unique=True, return_indices=True)[1:]


def offsets(data: Data, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (F, P, 3) [m] from the curve through nodes x (F, K, 3) to the points, and which
    count."""
    if data.material:
        frame, slot = np.nonzero(data.mask)
        place = on_curve(x, frame, data.share[frame, slot])[3]
        out = np.zeros_like(data.points)
        out[frame, slot] = data.points[frame, slot] - place
        return out, data.mask
    data = data.as_deep_as(x)
    _, offset, good = feet(data.points, data.share, data.mask, refined(x), WINDOW)
    return offset, _counted(data, good)


def _counted(data: Data, beside: np.ndarray) -> np.ndarray:
    """Return which points (F, P) count; beside: those that lie across from an inner point of their
    window. In a frame most of whose points do not, all count, at the window's edge: else a curve
    that is far off would have few data against it."""
    if data.firm:
        return data.mask
    off = beside.sum(axis=1) < LEAST_BESIDE * data.mask.sum(axis=1)
    return np.where(off[:, None], data.mask, beside)


def _markers(data: Data, x: np.ndarray) -> Stations:
    frame, slot = np.nonzero(data.mask)
    share = data.share[frame, slot]
    segment, weight, _, place = on_curve(x, frame, share)
    residual = data.points[frame, slot] - place
    basis = np.broadcast_to(np.eye(3), (len(frame), 3, 3)).copy()
    one = np.ones(len(frame))
    return Stations(
        frame, slot, share, one, residual, basis, segment, weight, np.zeros_like(residual),
        np.zeros((len(frame), 2)),
    )  # fmt: skip
