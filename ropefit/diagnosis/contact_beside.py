"""What contact explains beside an accepted effect.

Pairs of effects that are compared at once hold no contact, which has no small beginnings: two of
them may stand for one and a table that is touched in a few frames.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ropefit.diagnosis.acceptance import refusal
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.fits import Fits
from ropefit.diagnosis.proposals import proposals
from ropefit.inference.least_squares import Fit


@dataclass(frozen=True)
class ContactBeside:
    """Candidates of contact on top of a model, best first; evidence [nats]: of the best one, 0 if
    none would be accepted; explains: whether that one leaves next to nothing, in all frames
    alike."""

    current: Fit | None = None
    candidates: list[Candidate] = field(default_factory=list)
    evidence: float = 0.0
    explains: bool = False

    def on(self, current: Fit) -> list[Candidate]:
        """Return the candidates, if they are on top of this very model."""
        return self.candidates if current is self.current else []


def by_contact(current: Fit, threshold: float, names: tuple[str, ...] | None) -> ContactBeside:
    """Return the candidates of contact on top of a model. names: of the effects that may be
    proposed; None: all."""
    fits = Fits(current, threshold, names=names)
    for choices in proposals(current, slow=True, names=names):
        effect = choices[0][0].effect
        if effect.slow and not (effect.late or effect.path_dependent):
            fits.add(choices)
    fits.add_elsewhere()  # from the first start, a fit may end where it touches too little
    best = fits.best()
    if best is None or best.evidence < threshold or refusal(best, current):
        return ContactBeside(current, fits.found())
    explains = fits.enough() and fits.explained_by(best)
    return ContactBeside(current, fits.found(), best.evidence, explains)
