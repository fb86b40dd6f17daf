"""Markers: already ordered; what is missing is their arc length and a curve between them."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from ropefit.perception.trace import FrameRejected, Trace

MOST_STRETCH = 1.3  # chords longer than this times the rope are no rope
MANY = 100  # frames among which some show each piece of the rope nearly straight
STRAIGHT = 0.95  # their quantile
NORMAL = 1.645  # that quantile of a normal law, in sd


def marker_arc(
    positions: np.ndarray, ends: np.ndarray, length: float | None
) -> tuple[np.ndarray, float]:
    """Arc length of each marker (M,) and the rope's length [m], from all frames.

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
        raise FrameRejected("neighbouring markers coincide or no two were seen together")
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
    """[m] of rope between two markers so far apart (F,), frame after frame; NaN of none."""
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
    dense: int = 100,
) -> Trace:
    """One frame: markers (M, 3) [m], NaN where unseen, at arc (M,) of a rope of `length`.

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
    at = np.linspace(knots[0], knots[-1], dense)
    spacing = float(np.median(np.diff(arc)))
    return Trace(
        points=points[seen],
        point_arc=arc[seen],
        centreline=spline(at),
        arc=at,
        length=length,
        reach=min(spacing / 2, length / 30),
    )


def marker_noise(positions: np.ndarray, time: np.ndarray) -> tuple[float, str]:
    """(sd [m] per coordinate, how it was found) from markers (F, M, 3) at time (F,) [s].

    From what is rough in time where the sampling is fast (third differences of a smooth motion
    vanish),
    else from what is rough along the rope (fourth differences, an upper bound: real curvature
    counts too), whichever is smaller.
    """
    found = []
    if len(time) >= 8 and np.median(np.diff(time)) < 0.05:
        rough = np.diff(positions, n=3, axis=0) / np.sqrt(20.0)
        found.append((_robust(rough), "roughness in time"))
    if positions.shape[1] >= 6:
        rough = np.diff(positions, n=4, axis=1) / np.sqrt(70.0)
        found.append((_robust(rough), "roughness along the rope (upper bound)"))
    found = [item for item in found if np.isfinite(item[0]) and item[0] > 0]
    return min(found) if found else (1e-3, "assumed: too few markers to measure it")


def _robust(values: np.ndarray) -> float:
    """sd from the median absolute value, NaN left out."""
    flat = np.abs(values[np.isfinite(values)])
    return float(1.4826 * np.median(flat)) if flat.size else np.nan
