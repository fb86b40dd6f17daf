"""What to do next, in words: the motion that would tell the remaining explanations apart."""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Diagnosis
from ropefit.reporting.words import millimetres

SEEN = 0.5  # of the noise of a point: a smaller difference is beyond what a recording shows
NO_MOTION = (
    "The explanations that are not ruled out would look alike under every motion tried: only "
    "another measurement (a plumb line, a weighing, a wrist force) can decide."
)


def next_step(d: Diagnosis) -> str:
    """Return how to tell apart what is not ruled out; empty where only one explanation is left."""
    if not d.motion:
        return NO_MOTION if any(c.equivalent_to for c in d.causes.values()) else ""
    apart = separation(d)
    if apart is not None and apart < SEEN * d.noise_white:
        return (
            f"{NO_MOTION} The best motion would make them differ by {millimetres(apart)}, where "
            f"noise is {millimetres(d.noise_white)}."
        )
    return (
        f"To tell {' and '.join(name.replace('_', ' ') for name in d.separates)} apart, {d.motion}."
    )


def separation(d: Diagnosis) -> float | None:
    """Return how far apart [m, rms] both explanations are in that motion, where it is known."""
    if d.motion_x is None:
        return None
    return float(np.sqrt(((d.motion_x[0] - d.motion_x[1]) ** 2).sum(-1).mean()))
