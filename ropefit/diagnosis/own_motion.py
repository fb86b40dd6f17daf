"""A rope that is slowly moved, fitted again with the motion that its model has.

Inertia and the drag of the air act by the motion that was observed. Its accelerations have errors:
noise, and where the ends are recorded by another clock, an end of the observed line that is not
where it should be. A share of the inertia that is fitted to them is too small (regression
dilution). The motion of the fitted rope has neither.
"""

from __future__ import annotations

import numpy as np

from ropefit.diagnosis.last_fit import stays
from ropefit.gaps import unbroken
from ropefit.inference.least_squares import Fit, attempted
from ropefit.models.rates import WINDOW, rates
from ropefit.rod.setup import Motion

ROUNDS = 3  # at most: the motion is that of the fit before
EVALUATIONS = 20


def with_own_motion(found: Fit) -> Fit:
    """Return the fit of a rope at rest in every frame under the inertia and drag of its own motion,
    where that explains the data better than the observed one; of any other rope as it is."""
    for _ in range(ROUNDS):
        motion = _own_motion(found)
        if motion is None:
            break
        forward = found.forward
        forward = forward.of_setup(
            forward.base._replace(motion=motion), found.point.solution, forward.terms
        )
        again = attempted(forward, found.problem, found.point.u, EVALUATIONS, tolerance=1e-6)
        if again is None or len(again.z) != len(found.z) or not again.cost < found.cost:
            break
        before, found = found, again
        if stays(before, found):
            break
    return found


def _own_motion(found: Fit) -> Motion | None:
    """Return the motion of a fitted rope in its frames, that observed where its ends are outside
    of their recorded path; None where nothing acts by it, or frames are too few or do not settle.
    """
    setup = found.point.setup
    if not found.forward.instantaneous or setup.motion is None or setup.load.ndim < 3:
        return None
    whole, shown = setup.whole()
    outside = False if whole.end_path is None else whole.end_path.outside(0.0)
    known = np.flatnonzero(~np.broadcast_to(outside, len(whole.ends)))
    clips = unbroken(whole.clock[known])
    if not len(known) or min(len(clip) for clip in clips) < 2 * WINDOW + 1:
        return None
    assert whole.motion is not None
    point = found.forward.of_setup(whole._replace(past=None)).at(np.empty(0))
    if not point.converged.all():
        return None
    velocity, acceleration = (item.copy() for item in whole.motion)
    velocity[known], acceleration[known] = rates(whole.clock[known], point.solution.x[known], clips)
    return Motion(velocity, acceleration).frames(shown)
