"""What is believed: a rival must be plausible, and held-out frames must support it."""

from __future__ import annotations

import numpy as np

from ropefit.inference.diagnosis.weigh import Rival, heldout_rms, touches
from ropefit.inference.least_squares import Fit

IMPLAUSIBLE = 30.0  # usual sizes: what large no rope or set-up has
NEUTRAL = 1.0  # nats that a held-out block may gain by chance
AT_MOST = 0.3  # of what blocks gain may others lose


def winner_of(
    rivals: list[Rival], threshold: float, current: Fit, refused: list[str]
) -> Rival | None:
    """The strongest rival that passes every gate; current: the model without any of them."""
    for rival in rivals:
        if rival.evidence < threshold:
            return None
        along = touches(rival.fit)
        worse = heldout_rms(rival.fit, along)[0] > 1.01 * heldout_rms(current, along)[0]
        # A calibration error far outside its prior explains held-out frames as well as the effect
        # of the same kind does: there the evidence is in the prior.
        effect = rival.family.effect
        believed = effect.kind == "measurement" or effect.calibrated
        sizes = np.abs(rival.values()[: rival.family.size]) / rival.term.scale[: rival.family.size]
        if rival.family.effect.linear and sizes.max() > IMPLAUSIBLE:
            refused.append(f"{rival.family.name}: larger than anything plausible")
        elif rival.clear() < 1:
            refused.append(f"{rival.family.name}: its size could as well be nothing")
        elif worse or not (believed or agreeing(rival.gains)):
            refused.append(f"{rival.family.name}: held-out frames do not support it")
        else:
            return rival
    return None


def agreeing(gains: np.ndarray) -> bool:
    """Whether held-out blocks support an effect, by their gains [nats]: more than one gains, and
    the others lose little against that. A rope may touch a plane in few frames; the others gain
    and lose nothing, and what is barely visible gains and loses by chance.
    """
    lost, gained = -gains[gains < 0].sum(), gains[gains > 0].sum()
    return bool((gains > NEUTRAL).sum() > 1 and lost <= AT_MOST * gained)
