"""What simulated clean recordings show: from which evidence on an effect is there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.full_scan import Scan
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.scan import null_residuals

INEXACT_SHARE = 0.1  # of what is explained, where an effect is not exact: a third of its size
EULER = 0.5772  # of Gumbel's law


@dataclass
class Limits:
    """What simulated clean recordings show: threshold [nats] of an effect and of the latent force;
    the size and unit of each effect that would reach the threshold."""

    threshold: float
    latent: float
    detectable: dict[str, float]
    units: dict[str, str]

    def needed(self, accepted: list[Accepted]) -> float:
        """Return the evidence [nats] that a further effect needs.

        Beside one that is not exact: more than errors of what is accepted leave to be explained.
        Where what is equivalent to an accepted effect has more evidence: more by that, as it may
        leave nothing.
        """
        exact = all(one.candidate.hypothesis.effect.exact for one in accepted)
        explained = 0.0 if exact else sum(one.evidence for one in accepted)
        ahead = (c.evidence - one.evidence for one in accepted for c in one.equivalent)
        return max(self.threshold + max((0.0, *ahead)), INEXACT_SHARE * explained)


def clean_limits(scan: Scan, rng: np.random.Generator, rules: Rules) -> Limits:
    """Simulate clean recordings with this recording's noise and calibration errors."""
    null = null_residuals(scan.current, scan.project, rules.replicates, rng)
    highest = np.max([s.averaged(null) for s in scan.scorers], axis=0)
    # The quantile of a Gumbel law through the replicates.
    spread = np.sqrt(6) / np.pi * highest.std()
    upper = float(highest.mean() + spread * (-np.log(rules.false_alarms) - EULER))
    threshold = max(rules.least_evidence, upper)
    strongest = float(np.quantile(scan.latent.null(null), 1 - rules.false_alarms))
    out = Limits(threshold, strongest + rules.latent_margin, {}, {})
    for s in scan.scorers:
        name, size = s.hypothesis.name, s.detectable(threshold)
        of = s.hypothesis.effect.quantities[0]
        if size < of.upper:  # a larger one cannot exist: such a recording cannot show it
            out.detectable[name] = min(size, out.detectable.get(name, np.inf))
            out.units[name] = of.unit
    return out
