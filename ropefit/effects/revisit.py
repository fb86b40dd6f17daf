"""Whether a recording can show path dependence: poses of the ends that are revisited."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from ropefit.rod.quaternion import director
from ropefit.rod.setup import Setup

CLOSE_SHARE = 0.1  # of how far the ends went in between
EXCURSION_SHARE = 0.05  # of the length: how far they must have gone
FEWEST = 8  # frames


def revisits(setup: Setup) -> bool:
    """Return whether the ends come back, from far enough, to nearly where they were.

    Where nothing holds the ends' directions, turning all about the vertical changes no shape.
    """
    whole, _ = setup.whole()
    if len(whole.ends) < FEWEST:
        return False
    length = float(whole.properties.length.sum())
    up = whole.up
    held = ~np.isnan(whole.ends[0]).any(-1)
    parts = []
    if bool(held.all()):
        chord = whole.ends[:, 0] - whole.ends[:, 1]
        rise = chord @ up
        flat = chord - rise[:, None] * up
        across = flat if any(whole.clamped) else np.linalg.norm(flat, axis=-1, keepdims=True)
        parts += [rise[:, None], across]
    for end in range(2):
        if whole.clamped[end]:
            parts.append(0.5 * length * director(whole.clamp[:, end]))
    if not parts:
        return False
    pose = np.concatenate(parts, axis=-1)
    apart = cdist(pose, pose)
    # Of the poses between two, from the first of them.
    farthest = np.maximum.accumulate(np.triu(apart), axis=1)
    back = (farthest > EXCURSION_SHARE * length) & (apart < CLOSE_SHARE * farthest)
    return bool(np.triu(back, 2).any())
