"""The rules of the diagnosis as values: thresholds, noise, and how candidates are selected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from ropefit.diagnosis.acceptance import first_acceptable
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.candidates import MOST_SHOWN, fit_candidates
from ropefit.diagnosis.fits import Progress, silent
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.scan import Score
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.starts import cheaper
from ropefit.solvers.equilibrium.branches import overwound

RESTART_EVALUATIONS = 20
MORE_BESIDE_CONTACT = 2


class Selection:
    """How each round selects a candidate: by evidence, held-out data, and the restarted nominal."""

    def candidates(
        self, current: Fit, scan: list[Score], quick: list[list[Start]], slow: list[list[Start]],
        threshold: float, names: tuple[str, ...] | None, progress: Progress = silent,
        known: Sequence[Candidate] = (),
    ) -> list[Candidate]:  # fmt: skip
        """Return the candidates of a round, highest evidence first; see `fit_candidates`."""
        return fit_candidates(current, scan, quick, slow, threshold, names, progress, known=known)

    def restarted(self, current: Fit, best: Candidate, share: float) -> Fit | None:
        """Return the smaller model as fitted from the best candidate's values, if that is better.

        The smaller model had then been in a local minimum. A rope that the candidate has wound up
        by a turn is not the smaller model's. share: of the candidate's evidence, at least gained
        without it.
        """
        begin = best.fit.point.u[: current.forward.size]
        forward = current.forward.with_terms(current.forward.terms, best.fit.point.solution)
        gain = share * best.evidence
        again = attempted(
            forward, current.problem, begin, RESTART_EVALUATIONS, tolerance=1e-5,
            needed=current.cost - gain,
        )  # fmt: skip
        chosen = cheaper(current, again or current, gain)
        if chosen is current:
            return None
        if forward.instantaneous and overwound(chosen.point.solution, current.point.solution).any():
            return None
        return chosen

    def supported(
        self, candidates: list[Candidate], threshold: float, current: Fit, refused: list[str]
    ) -> list[Candidate]:
        """Return the candidates that what is known beside the recording does not refute."""
        return candidates

    def acceptable(
        self, candidates: list[Candidate], threshold: float, current: Fit, refused: list[str]
    ) -> Candidate | None:
        """Return the candidate that is accepted, if any; see `first_acceptable`."""
        return first_acceptable(candidates, threshold, current, refused)


@dataclass(frozen=True)
class Rules:
    """Thresholds and choices.

    least_evidence [nats]: no effect is accepted below (at 5 one clean recording in a hundred had
    one). replicates: number of simulated clean recordings; false_alarms: share of them in which
    some effect may reach the threshold; latent_margin [nats] that a latent force must have over
    them. most_effects: with more, anything could be explained, and the verdict is unknown.
    any_mismatch [nats]: evidence of anything missing, below which contact is not tried.
    restart_share: of a candidate's evidence, gained without it by a restart of the smaller model.
    scan_explains: share of the misfit that a scan explains in one place, above which the noise is
    measured without further fits. calibration: whether fits include calibration errors. noise:
    measured with its correlation, or assumed white. effects: names of those that are looked for;
    None: all. most_evaluations: of the model (`inference.problem.Work`), after which a search ends;
    `most_beside`: twice as many once contact was accepted, beside which ropes rub along a path.
    """

    least_evidence: float = 6.0
    replicates: int = 100
    false_alarms: float = 0.01
    latent_margin: float = 10.0
    most_effects: int = 2
    any_mismatch: float = 2.0
    restart_share: float = 0.2
    scan_explains: float = MOST_SHOWN
    calibration: bool = True
    noise: Literal["measured", "white"] = "measured"
    effects: tuple[str, ...] | None = None
    most_evaluations: float = float("inf")
    selection: Selection = field(default_factory=Selection)

    def most_beside(self, accepted: Sequence[Accepted]) -> float:
        """Return after how many evaluations a search ends that has accepted some effects."""
        slow = any(one.candidate.hypothesis.effect.slow for one in accepted)
        return MORE_BESIDE_CONTACT * self.most_evaluations if slow else self.most_evaluations


RULES = Rules()
