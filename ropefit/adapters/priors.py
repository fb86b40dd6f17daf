"""What observations say of their own errors: noise, and priors of the set-up's."""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Observations
from ropefit.inference.bins import Data
from ropefit.inference.noise import Noise
from ropefit.models.priors import PAIR, Priors

UNKNOWN_OFFSET = 0.005  # m: of markers on a rope of unknown diameter


def noise_of(o: Observations, data: Data) -> Noise:
    """Return white noise only: that of markers is measured by preprocess, that of points by
    stations.

    Markers off the axis are no fresh error in every frame (`wander.with_what_is_missed_alike`).
    """
    if not data.material:
        return Noise()
    own = float(np.median(o.noise))
    if not o.marker_offset:
        return Noise(marker=own)
    return Noise(marker=float(np.hypot(own, o.marker_offset / 3**0.5)), sensor=own)


def off_axis_sd(o: Observations) -> float:
    """Return [m] one sigma of the offset of markers from the rope's axis, in each direction across
    it: from the recording, else from its radius; 0 for other sensors."""
    if o.source != "markers":
        return 0.0
    on_surface = 0.5 * o.diameter if o.diameter else UNKNOWN_OFFSET
    return (o.marker_offset or on_surface) / 2**0.5


def priors_of(o: Observations) -> Priors:
    """Return the recording's own priors over the defaults.

    Two markers determine a clamp's direction badly. Ends that are seen, not recorded, lie where
    the visible rope ends: as uncertain as its length is from frame to frame, and as a point of it.
    """
    given = {k: v for k, v in o.priors.model_dump().items() if v is not None}
    usual: dict[str, float] = {} if o.end_twist_known else {"end_orientation": PAIR}
    if o.ends_assumed:
        seen = (Priors.end_position, float(np.median(o.noise)), o.length_sd or 0.0)
        usual["end_position"] = float(np.linalg.norm(seen))
    return Priors(**(usual | given))
