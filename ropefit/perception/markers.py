"""Markers: already ordered; what is missing is their arc length and a curve between them."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from ropefit.perception.trace import FrameRejected, Trace

DENSE = 100  # vertices of a spline
MOST_STRETCH = 1.3  # chords longer than this times the rope are no rope
MANY = 100  # frames among which some show each piece of the rope nearly straight
STRAIGHT = 0.95  # their quantile
NORMAL = 1.645  # that quantile of a normal law, in sd
LEAST_REPEATED, SLOWEST = 4, 0.25  # frames; share of consecutive pairs that are slow or repeated
LEAST_LEFT, MOST_CURVES = 3, 200  # markers beyond a curve's coefficients; frames that are fitted


def marker_arc(
    positions: np.ndarray, ends: np.ndarray, length: float | None
) -> tuple[np.ndarray, float]:
    """Return arc length of each marker (M,) and the rope's length [m], from all frames.

    positions (F, M, 3), ends (F, 2, 3), NaN where unknown. Chords between neighbours, from end 0 if
    it is known; scaled to `length` if the whole rope is spanned. Of few frames their median, of
    many what the straightest show: where a rope always bends, its chords are too short.
    Raises FrameRejected where the markers do not make a line.
    """
    both = np.concatenate([ends[:, :1], positions, ends[:, 1:]], axis=1)
    chords = np.linalg.norm(np.diff(both, axis=1), axis=2)
    with np.errstate(all="ignore"):
        chord = np.array([_piece(c[np.isfinite(c)]) for c in chords.T])
    inner = chord[1:-1]
    if np.isnan(inner).any() and np.isfinite(inner).any():
        # A pair never seen together: as far apart as neighbours usually are.
        inner = np.where(np.isnan(inner), np.nanmedian(inner), inner)
    if not (inner > 0).all():
        raise FrameRejected("neighbouring markers coincide or no two are visible in the same frame")
    lead, tail = np.nan_to_num(chord[0]), np.nan_to_num(chord[-1])
    arc = lead + np.concatenate([[0.0], np.cumsum(inner)])
    total = float(arc[-1] + tail)
    if length is not None:
        spans = np.isfinite(chord[[0, -1]]).all()
        if spans or total > length:
            arc, total = arc * length / total, length
        else:
            total = length
    return arc, total


def _piece(chords: np.ndarray) -> float:
    """Return [m] of rope between two markers so far apart (F,), frame after frame; NaN of none."""
    if not chords.size:
        return np.nan
    middle = float(np.median(chords))
    if len(chords) < MANY:
        return middle
    noise = _robust(np.diff(chords, n=3) / np.sqrt(20.0))
    return max(middle, float(np.quantile(chords, STRAIGHT)) - NORMAL * noise)


def trace_markers(
    points: np.ndarray,
    arc: np.ndarray,
    length: float,
    ends: np.ndarray,
    tangents: np.ndarray,
) -> Trace:
    """Trace one frame: markers (M, 3) [m], NaN where unseen, at arc (M,) of a rope of `length`.

    Between the markers runs a cubic spline through them and the known ends (2, 3), along the known
    tangents (2, 3). Raises FrameRejected with fewer than two markers.
    """
    seen = np.isfinite(points).all(axis=1)
    if seen.sum() < 2:
        raise FrameRejected(f"{int(seen.sum())} of {len(points)} markers seen")
    knots, values = arc[seen], points[seen]
    chords = float(np.linalg.norm(np.diff(values, axis=0), axis=1).sum())
    if chords > MOST_STRETCH * length:
        raise FrameRejected(f"its markers span {chords:.4g} m of a {length:.4g} m rope: one jumps")
    gap = 1e-3 * length
    if np.isfinite(ends[0]).all() and knots[0] > gap:
        knots, values = np.r_[0.0, knots], np.vstack([ends[0], values])
    if np.isfinite(ends[1]).all() and knots[-1] < length - gap:
        knots, values = np.r_[knots, length], np.vstack([values, ends[1]])
    at_end = (knots[0] <= gap, knots[-1] >= length - gap)
    conditions = tuple(
        (1, tangent) if np.isfinite(tangent).all() and there else (2, np.zeros(3))
        for tangent, there in zip(tangents, at_end, strict=True)
    )
    spline = CubicSpline(knots, values, bc_type=conditions)  # type: ignore[arg-type]
    at = np.linspace(knots[0], knots[-1], DENSE)
    spacing = float(np.median(np.diff(arc)))
    return Trace(
        points=points[seen],
        point_arc=arc[seen],
        centreline=spline(at),
        arc=at,
        length=length,
        reach=min(spacing / 2, length / 30),
    )


def marker_noise(
    positions: np.ndarray, time: np.ndarray | None, arc: np.ndarray
) -> tuple[float, str, bool]:
    """Return the sd [m] per coordinate, how it was found, and whether it was measured.

    Markers (F, M, 3) at time (F,) [s], if known, and arc (M,) [m]. What is rough in time where the
    sampling is fast measures it (third differences of a smooth motion vanish). All others are upper
    bounds: differences between the slowest consecutive frames (motion counts, too), roughness along
    the rope, and what smooth curves along it leave (curvature counts, too). The smallest is taken.
    """
    found = []
    if time is not None and len(time) >= 8 and np.median(np.diff(time)) < 0.05:
        rough = np.diff(positions, n=3, axis=0) / np.sqrt(20.0)
        found.append((_robust(rough), "roughness in time", True))
    if len(positions) >= LEAST_REPEATED:
        still = [_robust(pair) / np.sqrt(2.0) for pair in np.diff(positions, axis=0)]
        slow = float(np.nanquantile(still, SLOWEST)) if np.isfinite(still).any() else np.nan
        found.append((slow, "slowest consecutive frames (upper bound)", False))
    if positions.shape[1] >= 6:
        rough = np.diff(positions, n=4, axis=1) / np.sqrt(70.0)
        found.append((_robust(rough), "roughness along the rope (upper bound)", False))
        found.append((_left_by_curves(positions, arc), "smooth curves (upper bound)", False))
    found = [item for item in found if np.isfinite(item[0]) and item[0] > 0]
    return min(found) if found else (1e-3, "assumed: too few markers to measure it", False)


def _left_by_curves(positions: np.ndarray, arc: np.ndarray) -> float:
    """Return the sd [m] that the best smooth curve along the rope leaves; NaN of few markers.

    Polynomials in arc length of every degree that leaves a few degrees of freedom, counted off. Of
    those that leave no more than the best, within two standard errors of it, the lowest: the least
    of several uncertain values would be too small.
    """
    place = 2 * (arc - arc[0]) / (arc[-1] - arc[0]) - 1
    some = np.unique(np.linspace(0, len(positions) - 1, MOST_CURVES).astype(int))
    whole = positions[some][np.isfinite(positions[some]).all(axis=(1, 2))]
    if not len(whole):
        return np.nan
    left = []
    for degree in range(3, len(arc) - LEAST_LEFT):
        basis = np.linalg.qr(np.polynomial.chebyshev.chebvander(place, degree))[0]
        rest = whole - np.einsum("mb,nb,fnx->fmx", basis, basis, whole)
        count = 3 * (len(arc) - degree - 1)
        middle = count * (1 - 2 / (9 * count)) ** 3  # the median of chi squared
        sd = float(np.sqrt(np.median((rest**2).sum(axis=(1, 2))) / middle))
        left.append((sd, sd * (1 + 2 / np.sqrt(2 * count * len(whole)))))
    if not left:
        return np.nan
    most = min(left)[1]
    return next(sd for sd, _ in left if sd <= most)


def _robust(values: np.ndarray) -> float:
    """Return sd from the median absolute value, ignoring NaN."""
    flat = np.abs(values[np.isfinite(values)])
    return float(1.4826 * np.median(flat)) if flat.size else np.nan
