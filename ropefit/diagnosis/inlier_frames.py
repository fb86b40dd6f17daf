"""A model as fitted to the few frames that it explains, as by least trimmed squares.

What acts in most frames (a table that the rope is dragged over) leaves no usual frame to compare
with: a fit to all of them, and to those that stand out least, has calibration errors without limit
and a rigidity far off. But the frames in which the rope hangs free tell its rigidity.
"""

from __future__ import annotations

import numpy as np

from ropefit.inference.known import settled
from ropefit.inference.least_squares import Fit, attempted
from ropefit.models.response import Point

FEWEST = 3  # frames that must be explained
RIGIDITIES = 14  # tried, over what the rope's weight and length allow
ALIKE = 2.0  # times the rms of those, up to which other frames are inliers, too
FAR = 5.0  # times, by which the median frame is worse than those
ROUNDS, EVALUATIONS = 3, 8


def on_inlier_frames(fitted: Fit) -> Fit | None:
    """Return the model, with all frames, as fitted to those that it can explain with nearly no
    calibration errors; None where these are fewer than three, or the other frames hardly worse."""
    found = _begun(fitted)
    if found is None:
        return None
    u, rms = found
    for _ in range(ROUNDS):
        best = np.sort(rms)[:FEWEST].mean()
        few = attempted(
            fitted.forward, fitted.problem.without(~(rms <= ALIKE * best)), u, EVALUATIONS, 1e-3
        )
        if few is None:
            return None
        before, u, rms = rms, few.point.u, _rms(fitted, few.point)
        if ((rms <= ALIKE * best) == (before <= ALIKE * best)).all():
            break
    seen = np.isfinite(rms)
    if np.median(rms[seen]) < FAR * np.sort(rms)[:FEWEST].mean():
        return None
    return attempted(fitted.forward, fitted.problem, u, 1, tolerance=1e-3)


def _begun(fitted: Fit) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the search variables (P,) without calibration errors, of the rigidity that explains
    three frames best, and the rms [m] of every frame there (F,)."""
    forward, held = fitted.forward, fitted.prior.held
    terms = forward.terms
    rigid = ~held & np.repeat([t.log and t.effect is None for t in terms], [t.size for t in terms])
    low, high = forward.bounds()
    best = None
    shares = np.linspace(0.0, 1.0, RIGIDITIES + 2)[1:-1]
    for share in shares if rigid.any() else shares[:1]:
        u = np.where(held, 0.0, fitted.point.u)
        u[rigid] = (1 - share) * low[rigid] + share * high[rigid]
        rms = _rms(fitted, settled(forward, u))
        level = float(np.sort(rms)[:FEWEST].mean())
        if best is None or level < best[0]:
            best = level, u, rms
    return None if best is None or not np.isfinite(best[0]) else best[1:]


def _rms(fitted: Fit, point: Point) -> np.ndarray:
    """Return (F,) the rms [m] of the data about the rope in each frame; inf in those without data
    or equilibrium."""
    problem, frames = fitted.problem.without(~point.converged), len(point.seen)
    s = problem.match(np.where(point.converged[:, None, None], point.seen, 0.0))
    count = np.bincount(s.frame, minlength=frames)
    square = np.bincount(s.frame, (s.residual**2).sum(axis=-1), frames)
    return np.where(count > 0, np.sqrt(square / np.maximum(count, 1)), np.inf)
