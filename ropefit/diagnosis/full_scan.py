"""The scan of a round: every hypothesis against what a fit leaves, and the latent force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.hypotheses import hypotheses
from ropefit.diagnosis.latent_force import LatentForce, latent_force
from ropefit.diagnosis.proposals import Start, proposals, uneven
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.scan import Projection, Score, Scorer
from ropefit.diagnosis.sensitivities import Sensitivities, Sensitivity
from ropefit.diagnosis.unexplained import unexplained
from ropefit.inference.least_squares import Fit

MARGIN = 10.0  # nats: of noise, that a fit takes up


class Scan:
    """All hypotheses scored against what a fit leaves, highest first, and the latent force; each
    once it is asked for."""

    def __init__(self, current: Fit, known: Callable[[], list[Sensitivity]]) -> None:
        self.current, self._known = current, known
        self.project = Projection(current)

    @cached_property
    def sensitivities(self) -> list[Sensitivity]:
        return self._known()

    @cached_property
    def scorers(self) -> list[Scorer]:
        setup = self.current.point.setup
        every = self.sensitivities
        return [Scorer(s, self.project, s.hypothesis.scales(setup)) for s in every]

    @cached_property
    def scores(self) -> list[Score]:
        every = [score(self.project.z) for score in self.scorers]
        return sorted(every, key=lambda s: -s.log_factor)

    @cached_property
    def latent(self) -> LatentForce:
        return latent_force(self.current, self.project)

    def contact(self, rules: Rules, needed: float = 0.0) -> list[list[Start]]:
        """Return starts of slow fits, if anything is missing (contact acts in some frames), and a
        fit down to the noise would have the evidence `needed` [nats]."""
        if 0.5 * unexplained(self.current) < needed - MARGIN or not self.anything(rules):
            return []
        return proposals(self.current, slow=True, names=rules.effects)

    def anything(self, rules: Rules) -> bool:
        """Return whether anything is missing."""
        strongest = max(self.latent.evidence, self.scores[0].log_factor)
        return strongest > rules.any_mismatch or uneven(self.current)


def sensitivities(
    current: Fit, accepted: list[Accepted], names: tuple[str, ...] | None = None,
    nearby: Sequence[Sensitivity] = (), linear: bool = False,
) -> list[Sensitivity]:  # fmt: skip
    """Return the sensitivities to every hypothesis, but to accepted ones with no other place.

    nearby: known ones, of the same model in perhaps nearly the same shapes; linear: only of effects
    that are, which pairs are made of.
    """
    responses = Sensitivities(current)
    known = [one.candidate.hypothesis for one in accepted]
    taken = {h.key for h in known if not h.effect.place_names}
    before = {one.hypothesis.key: one for one in nearby}
    every = [h for h in hypotheses(current.point.setup, names) if h.effect.linear or not linear]
    return [responses.of(h, before.get(h.key)) for h in every if h.key not in taken]
