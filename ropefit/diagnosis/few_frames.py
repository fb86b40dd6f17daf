"""A fit on few of its frames and a coarse mesh, where starts of costly fits are compared."""

from __future__ import annotations

import numpy as np

from ropefit.diagnosis.coarse_mesh import on_coarse_mesh
from ropefit.inference.least_squares import Fit, attempted

FEW_FRAMES = 10  # frames: shapes between them are like them
LEAST_SAVED = 0.6  # of the frames: with more of them left it is not worth the further fit
EVALUATIONS = 5
FAR_BEHIND = 20.0  # nats, in few frames: what is so far behind there is not the best in all


def far_behind(best: Fit) -> float:
    """Return the cost from which a fit is far behind the best one."""
    return best.cost + 2 * FAR_BEHIND * max(1.0, best.spread)


def on_few_frames(fitted: Fit) -> Fit | None:
    """Return a fit at rest as fitted to `FEW_FRAMES` of its frames, evenly spaced; None where there
    are hardly more, and of a rope that has been through all of them."""
    frames = len(fitted.point.seen)
    if not fitted.forward.instantaneous or frames * LEAST_SAVED < FEW_FRAMES:
        return None
    if fitted.point.setup.remembers:
        return None
    fitted = on_coarse_mesh(fitted)
    index = np.unique(np.linspace(0, frames - 1, FEW_FRAMES).round().astype(int))
    forward = fitted.forward.of_setup(
        fitted.forward.base.frames(index),
        fitted.point.solution.frames(index),
        fitted.forward.terms,
    )
    return attempted(
        forward, fitted.problem.frames(index), fitted.point.u, EVALUATIONS, tolerance=1e-4
    )
