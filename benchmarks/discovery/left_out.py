"""The diagnosis with one of its rules disabled, or with a free rope as a further candidate.

A variant replaces functions of the engine while it runs; the engine knows nothing of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.discovery.free_rope import NAME, free_rope
from ropefit.inference.diagnosis import search as engine
from ropefit.inference.diagnosis.evidence import Scored
from ropefit.inference.diagnosis.weigh import Rival
from ropefit.inference.least_squares import Fit
from ropefit.inference.noise import Noise
from ropefit.stages import diagnose

Notes = dict[str, Any]  # what a variant notes while it runs


@dataclass(frozen=True)
class Variant:
    """title and meaning: for the table; apart: within it the diagnosis is another one."""

    title: str
    meaning: str
    apart: Callable[[Notes], AbstractContextManager[Any]]


@contextmanager
def watched(notes: Notes) -> Iterator[None]:
    """Change nothing; note how often the model was fitted again, and how long that took [s]."""
    plain, notes["restarts"], notes["restart_seconds"] = engine._restarted, 0, 0.0

    def restarted(*arguments: Any) -> Fit | None:
        begin = time.process_time()
        again = plain(*arguments)
        notes["restart_seconds"] += time.process_time() - begin
        notes["restarts"] += again is not None
        return again

    with patch.object(engine, "_restarted", restarted):
        yield


def exact_set_up(notes: Notes) -> AbstractContextManager[Any]:
    """Give the nominal fit the rope's own parameters only."""
    return patch.object(diagnose, "calibration", lambda *_: [])


def white_noise(notes: Notes) -> AbstractContextManager[Any]:
    """Take stations as independent, ends as exact in every frame."""
    return patch.object(engine, "measure", _only_white)


def _only_white(nominal: Fit, columns: Any, noise: Noise, moves: Any) -> Noise:
    return replace(noise, correlated=0.0, ends=None)


def never_restarted(notes: Notes) -> AbstractContextManager[Any]:
    """Count evidence over the smaller model as it stood."""
    return patch.object(engine, "_restarted", lambda *_: None)


@contextmanager
def naive_bic(notes: Notes) -> Iterator[None]:
    """Accept the effect with the lowest BIC if it lowers it at all."""
    plain = engine.fit_rivals

    def rivals(
        current: Fit, scan: list[Scored], driven: Any, touching: Any, data: Any, noise: Noise,
        bins: int, threshold: float,
    ) -> list[Rival]:  # fmt: skip
        worth = [replace(s, log_factor=0.5 * (s.score - penalty(current, s))) for s in scan]
        worth.sort(key=lambda s: -s.log_factor)
        found = plain(current, worth, driven, touching, data, noise, bins, 0.0)
        cost = current.cost
        out = [replace(r, evidence=0.5 * (cost - r.fit.cost - penalty(current, r))) for r in found]
        return sorted(out, key=lambda r: -r.evidence)

    def winner(rivals: list[Rival], *_: Any) -> Rival | None:
        return rivals[0] if rivals and rivals[0].evidence > 0 else None

    with _in_rounds(rivals), patch.object(engine, "winner_of", winner):
        yield


def penalty(current: Fit, one: Scored | Rival) -> float:
    """Return k ln n of BIC for a hypothesis' k values and n whitened residuals."""
    return len(one.family.effect.names) * float(np.log(len(current.z)))


@contextmanager
def free_rival(notes: Notes) -> Iterator[None]:
    """Add a candidate to each round: a rope whose EI and rest curve are free along it."""
    plain, notes["rounds"] = engine.fit_rivals, []

    def rivals(
        current: Fit, scan: Any, driven: Any, touching: Any, data: Any, noise: Noise, bins: int,
        threshold: float,
    ) -> list[Rival]:  # fmt: skip
        found = plain(current, scan, driven, touching, data, noise, bins, threshold)
        free = None
        if all(term.name != NAME for term in current.forward.terms):
            free = free_rope(current, data, noise, bins)
        if free is None:
            return found
        notes["rounds"].append({
            "free": _weighed(current, free), "best": _weighed(current, found[0] if found else None),
        })  # fmt: skip
        return sorted([*found, free], key=lambda r: -r.evidence)

    with _in_rounds(rivals):
        yield


def _weighed(current: Fit, rival: Rival | None) -> dict[str, Any] | None:
    """Name, evidence [nats] and share of the misfit that a rival takes away."""
    if rival is None:
        return None
    left, was = engine.unexplained(rival.fit), engine.unexplained(current)
    absorbed = 1 - left / was if was > 0 else None
    return {"name": rival.family.name, "evidence": rival.evidence, "absorbed": absorbed}


@contextmanager
def _in_rounds(rivals: Callable[..., list[Rival]]) -> Iterator[None]:
    """Replace the candidates in the rounds of the search, but not where its noise is measured."""
    plain, noise = engine.fit_rivals, engine._noise

    def as_before(*arguments: Any) -> Noise:
        with patch.object(engine, "fit_rivals", plain):
            return noise(*arguments)

    with patch.object(engine, "fit_rivals", rivals), patch.object(engine, "_noise", as_before):
        yield


WHOLE, WITHOUT_RESTART, FREE = "whole", "restart", "free"
VARIANTS = {
    WHOLE: Variant("nothing", "", watched),
    "calibration": Variant(
        "no calibration errors", "the nominal fit has the rope's own parameters only", exact_set_up
    ),
    "white": Variant(
        "white noise", "stations are independent of each other and ends exact", white_noise
    ),
    WITHOUT_RESTART: Variant(
        "no restart",
        "the smaller model is not fitted again from the winner's values",
        never_restarted,
    ),
    "bic": Variant(
        "naive BIC",
        "the effect that lowers χ² + k ln n most is accepted, without held-out blocks or threshold",
        naive_bic,
    ),
    FREE: Variant(
        "a free rope as candidate",
        "EI and rest curvature at 8 knots, under broad priors, compete with the effects",
        free_rival,
    ),
}  # fmt: skip
