"""How a rope moved, from its observed centrelines: what inertia and friction act by."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from ropefit.artifacts import Observations
from ropefit.errors import BadInput
from ropefit.gaps import unbroken
from ropefit.models.rates import WINDOW, rates
from ropefit.rod.setup import Motion

SLOWEST = 0.1  # s: frames further apart than this show no motion
JUMP = 0.05  # of the length: nodes move less than this from frame to frame, or it is no film
FEWEST = 5  # markers, or nodes that were seen, that make a line
END_MARKER = 1e-3  # m: a marker so close to an end is the end
LEAST_FORCE = 1e-3  # of its weight: accelerations that matter to a rope


def motion_of(o: Observations, arc: np.ndarray) -> Motion | None:
    """Return motion of the nodes at rest arc length arc (N+1,) [m] of the rod, in all frames.

    None where frames have no times or lie too far apart in them, where a centreline has gaps or
    was not measured in depth, or where the rope hardly accelerates.
    """
    if o.time is None or not o.depth_measured:
        return None
    clips = clips_of(o.time)
    if min(len(c) for c in clips) < 2 * WINDOW + 1:
        return None
    x = centrelines(o, arc)
    if not np.isfinite(x).all():
        return None
    steps = [np.linalg.norm(np.diff(x[c], axis=0), axis=-1).max(1) for c in clips]
    if np.median(np.concatenate(steps)) > JUMP * o.length:
        return None
    velocity, acceleration = rates(o.time, x, clips)
    size = np.sqrt((acceleration**2).sum(-1).mean())
    if size < LEAST_FORCE * np.linalg.norm(o.gravity):
        return None
    return Motion(velocity, acceleration)


def centrelines(o: Observations, arc: np.ndarray) -> np.ndarray:
    """Return (F, N+1, 3) [m] the observed rope at arc length arc (N+1,) [m]: a spline through what
    was seen of it and its held ends, NaN in frames where that is too little."""
    out = np.full((len(o.frames), len(arc), 3), np.nan)
    alike: dict[bytes, tuple[np.ndarray, list[int], list[np.ndarray]]] = {}
    for t in range(len(o.frames)):
        at, points = _seen_of(o, t)
        if len(at) >= FEWEST:  # one spline for all frames that show the rope at the same places
            _, rows, lines = alike.setdefault(at.tobytes(), (at, [], []))
            rows.append(t)
            lines.append(points)
    for at, rows, lines in alike.values():
        out[rows] = CubicSpline(at, np.stack(lines), axis=1)(arc)
    return out


def _seen_of(o: Observations, t: int) -> tuple[np.ndarray, np.ndarray]:
    """Return arc lengths (M,) [m], increasing, and points (M, 3) [m] of what frame t shows,
    with its held ends."""
    if o.source == "markers":
        rows = slice(o.point_start[t], o.point_start[t + 1])
        at, points = o.point_arc[rows], o.points[rows]
    else:
        seen = np.isfinite(o.centreline[t]).all(-1)
        at, points = o.node_arc[seen], o.centreline[t, seen]
    for end, place in ((0, 0.0), (1, o.length)):
        held = np.isfinite(o.end_position[t, end]).all()
        if held and np.abs(at - place).min(initial=np.inf) > END_MARKER:
            at, points = np.append(at, place), np.vstack([points, o.end_position[t, end]])
    order = np.argsort(at)
    return at[order], points[order]


def times_of(o: Observations) -> np.ndarray:
    """Return (F,) [s] the times of the frames. Raises BadInput where the recording has none."""
    if o.time is None:
        raise BadInput(
            "the recording has no times, and a motion is made of them; give them in the column "
            "time, or use --solver equilibrium for shapes at rest"
        )
    return o.time


def clips_of(time: np.ndarray) -> list[np.ndarray]:
    """Return indices of the frames that follow each other without a gap, `SLOWEST` included."""
    return unbroken(time, SLOWEST)
