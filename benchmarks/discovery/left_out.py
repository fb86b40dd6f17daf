"""The diagnosis with one of its rules left out, or with a candidate that can fit anything.

A variant is other `Rules` for the diagnosis, with what they note while it runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.discovery.free_rope import NAME, free_rope
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.rules import RULES, Rules, Selection
from ropefit.diagnosis.scan import Score
from ropefit.diagnosis.unexplained import unexplained
from ropefit.inference.least_squares import Fit

Notes = dict[str, Any]  # what a variant notes while it runs
Starts = list[list[Start]]


@dataclass(frozen=True)
class Variant:
    """title and meaning: for the table; rules: of the diagnosis, which note what they did."""

    title: str
    meaning: str
    rules: Callable[[Notes], Rules]


class Watched(Selection):
    """As it is; notes how often a stuck model began anew, and how long that took [s]."""

    def __init__(self, told: Notes) -> None:
        self.told = told
        told["restarts"], told["restart_seconds"] = 0, 0.0

    def restarted(self, current: Fit, best: Candidate, share: float) -> Fit | None:
        begin = time.process_time()
        again = super().restarted(current, best, share)
        self.told["restart_seconds"] += time.process_time() - begin
        self.told["restarts"] += again is not None
        return again


class NeverRestarted(Selection):
    """Evidence counts over the smaller model as it stood."""

    def restarted(self, *_: Any) -> None:
        return None


class NaiveBic(Selection):
    """The effect with the lowest BIC is accepted if it lowers it at all."""

    def candidates(
        self, current: Fit, scan: list[Score], quick: Starts, slow: Starts, threshold: float,
        names: tuple[str, ...] | None, **more: Any,
    ) -> list[Candidate]:  # fmt: skip
        worth = [replace(s, log_factor=0.5 * (s.score - penalty(current, s))) for s in scan]
        worth.sort(key=lambda s: -s.log_factor)
        fitted = super().candidates(current, worth, quick, slow, 0.0, names, **more)
        return by_bic(current, fitted)

    def acceptable(self, candidates: list[Candidate], *_: Any) -> Candidate | None:
        return candidates[0] if candidates and candidates[0].evidence > 0 else None


def by_bic(current: Fit, fitted: list[Candidate]) -> list[Candidate]:
    """Return candidates with half of what they lower BIC by as their evidence, highest first."""
    cost = current.cost
    out = [replace(c, evidence=0.5 * (cost - c.fit.cost - penalty(current, c))) for c in fitted]
    return sorted(out, key=lambda c: -c.evidence)


def penalty(current: Fit, one: Score | Candidate) -> float:
    """Return k ln n of BIC for a hypothesis's k values and n whitened residuals."""
    return len(one.hypothesis.effect.names) * float(np.log(len(current.z)))


class WithFreeRope(Selection):
    """Each round has one candidate more: a rope whose EI and rest curve are free along it."""

    def __init__(self, told: Notes) -> None:
        self.rounds: list[dict[str, Any]] = []
        told["rounds"] = self.rounds

    def candidates(
        self, current: Fit, scan: list[Score], quick: Starts, slow: Starts, threshold: float,
        names: tuple[str, ...] | None, **more: Any,
    ) -> list[Candidate]:  # fmt: skip
        fitted = super().candidates(current, scan, quick, slow, threshold, names, **more)
        free = None
        if all(term.name != NAME for term in current.forward.terms):
            free = free_rope(current)
        if free is None:
            return fitted
        best = _noted(current, fitted[0]) if fitted else None
        self.rounds.append({"free": _noted(current, free), "best": best})
        return sorted([*fitted, free], key=lambda c: -c.evidence)


def _noted(current: Fit, candidate: Candidate) -> dict[str, Any]:
    """Name, evidence [nats] and share of the misfit that a candidate takes away."""
    left, was = unexplained(candidate.fit), unexplained(current)
    absorbed = 1 - left / was if was > 0 else None
    return {
        "name": candidate.hypothesis.name, "evidence": candidate.evidence, "absorbed": absorbed,
    }  # fmt: skip


WHOLE, WITHOUT_RESTART, FREE = "whole", "restart", "free"
VARIANTS = {
    WHOLE: Variant("nothing", "", lambda told: Rules(selection=Watched(told))),
    "calibration": Variant(
        "no calibration errors", "the nominal fit has the rope's own parameters only.",
        lambda _: replace(RULES, calibration=False),
    ),
    "white": Variant(
        "white noise", "stations are independent of each other and ends exact.",
        lambda _: replace(RULES, noise="white"),
    ),
    WITHOUT_RESTART: Variant(
        "no restart",
        "the smaller model is not fitted again from the winner's values.",
        lambda _: Rules(selection=NeverRestarted()),
    ),
    "bic": Variant(
        "naive BIC",
        "the effect that lowers χ² + k ln n most is accepted; no held-out blocks, no threshold of "
        "the recording's own.",
        lambda _: Rules(selection=NaiveBic()),
    ),
    FREE: Variant(
        "a free rope as rival",
        "EI and both components of the rest curvature at 8 knots along the rope, under broad "
        "priors, are fitted and weighed in every round beside the effects.",
        lambda told: Rules(selection=WithFreeRope(told)),
    ),
}  # fmt: skip
