"""By how much estimates scatter from clip to clip of a motion.

What a model misses of one clip it misses for as long as that clip lasts: how the rope was gripped
again, or which way it swung. Blocks within a clip then do not count as independent, whatever lag
their correlation is cut off at; clips do (delete-a-group jackknife: Hansen 2023, CV3).
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from ropefit.inference.verdict import NORMAL_QUANTILE

FEWEST = 6  # clips that tell a scatter


def scatter(
    jacobian: np.ndarray, z: np.ndarray, clip: np.ndarray, information: np.ndarray
) -> np.ndarray | None:
    """Return (P,) standard errors by the jackknife over clips, one Gauss-Newton step for each; None
    of fewer clips than tell.

    jacobian (R, P), z (R,): whitened; clip (R,): which one each row is of, -1 for none;
    information (P, P): of the priors. Widened by Student's t of so many clips over the normal
    quantile.
    """
    labels = np.unique(clip[clip >= 0])
    if len(labels) < FEWEST:
        return None
    whole = jacobian.T @ jacobian + information
    steps = []
    for label in labels:
        own, left = jacobian[clip == label], z[clip == label]
        # At the minimum the whole gradient is zero: without a clip it is minus that clip's.
        steps.append(np.linalg.pinv(whole - own.T @ own, rcond=1e-14) @ (own.T @ left))
    deviation = np.array(steps) - np.mean(steps, axis=0)
    count = len(labels)
    variance = (count - 1) / count * (deviation**2).sum(0)
    return np.sqrt(variance) * float(stdtrit(count - 1, 0.975)) / NORMAL_QUANTILE
