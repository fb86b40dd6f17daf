"""What is fitted quickly on top of a model, as the inertia of a rope in motion, and whether all
frames are left alike then."""

from __future__ import annotations

import numpy as np

from ropefit.diagnosis.calm import excess
from ropefit.diagnosis.candidate import Candidate, fit_candidate
from ropefit.diagnosis.proposals import UNEVEN_SD, proposals
from ropefit.inference.least_squares import Fit

MAD_TO_SD = 1.4826  # of a normal distribution


def quick_ones(
    smaller: Fit, least_evidence: float, names: tuple[str, ...] | None
) -> list[Candidate]:
    """Return what effects propose that is fitted quickly and has at least this evidence, each on
    top of the one before."""
    out: list[Candidate] = []
    for choices in proposals(smaller, slow=False, names=names):
        fitted = (fit_candidate(out[-1].fit if out else smaller, *start) for start in choices)
        found = next((c for c in fitted if c is not None), None)
        if found is not None and found.evidence > least_evidence:
            out.append(found)
    return out


def unknown_frames(candidate: Candidate) -> np.ndarray:
    """Return (F,) bool: frames in which a candidate acts by what is not in the recording."""
    point = candidate.fit.point
    return candidate.hypothesis.effect.begun_before(point.setup, point.solution.x)


def alike(fitted: Fit, lost: np.ndarray | None = None) -> bool:
    """Return whether no frame, but the `lost` (F,), is left far worse than the median one, by the
    scatter of the frames: a rope in motion is not explained down to the noise."""
    left = excess(fitted)
    if lost is not None:
        left = left[~lost]
    scatter = MAD_TO_SD * float(np.median(np.abs(left)))
    return bool((left <= UNEVEN_SD * max(scatter, 1.0)).all())
