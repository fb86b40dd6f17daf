"""What observations say of their own errors: noise, and priors of the set-up's."""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Observations
from ropefit.inference.bins import Data
from ropefit.inference.noise import Noise
from ropefit.models.priors import PAIR, Priors


def noise_of(o: Observations, data: Data) -> Noise:
    """Return white noise only: that of markers is measured by preprocess, that of points by
    stations."""
    return Noise(marker=float(np.median(o.noise)) if data.material else 0.0)


def priors_of(o: Observations) -> Priors:
    """Return the recording's own priors over the defaults. Two markers tell a clamp's direction
    badly."""
    given = {k: v for k, v in o.priors.model_dump().items() if v is not None}
    pairs = {} if o.end_twist_known else {"end_orientation": PAIR}
    return Priors(**(pairs | given))
