"""What contact explains beside an accepted effect.

Pairs of effects that are compared at once hold no contact, which has no small beginnings: two of
them may stand for one and a table that is touched in a few frames.
"""

from __future__ import annotations

from ropefit.diagnosis.acceptance import refusal
from ropefit.diagnosis.fits import Fits
from ropefit.diagnosis.proposals import proposals
from ropefit.inference.least_squares import Fit


def by_contact(current: Fit, threshold: float, names: tuple[str, ...] | None) -> float:
    """Return the log evidence [nats] of the best contact on top of a model; 0 if none would be
    accepted. names: of the effects that may be proposed; None: all."""
    fits = Fits(current, threshold, names=names)
    for choices in proposals(current, slow=True, names=names):
        effect = choices[0][0].effect
        if effect.slow and not (effect.late or effect.path_dependent):
            fits.add(choices)
    best = fits.best()
    accepted = best is not None and best.evidence >= threshold and not refusal(best, current)
    return best.evidence if best and accepted else 0.0
