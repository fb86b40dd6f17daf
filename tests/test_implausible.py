"""What explains more than a force that can stand for much else, but only with an absurd size."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from ropefit.diagnosis import acceptance
from ropefit.diagnosis.acceptance import first_acceptable
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.effects import FollowerForce, PointMass, Tether
from ropefit.effects.base import Effect


def candidate(effect: Effect, evidence: float, plausible: bool = True) -> Any:
    hypothesis = SimpleNamespace(effect=effect, name=effect.name)
    return SimpleNamespace(
        hypothesis=hypothesis, evidence=evidence, plausible=lambda: plausible, refused=""
    )


@pytest.fixture(autouse=True)
def refused(monkeypatch):
    """Every candidate that is plausible passes the other gates."""
    why = "larger than anything plausible"
    monkeypatch.setattr(acceptance, "refusal", lambda c, _: c.refused or why * (not c.plausible()))


@pytest.mark.parametrize("ahead", [0.5 * TIE_NATS, 3 * TIE_NATS])
def test_a_force_that_stands_for_others_gives_way_to_what_is_left(ahead):
    away, force = candidate(Tether(), 20.0 + ahead, False), candidate(FollowerForce(), 20.0)
    weight, reasons = candidate(PointMass(), 10.0), []
    found = first_acceptable([away, force, weight], 6.0, None, reasons)  # type: ignore[arg-type]
    assert found is (force if ahead < TIE_NATS else weight)
    assert ("follower_force: tether explains more" in " ".join(reasons)) == (ahead > TIE_NATS)
    none = first_acceptable([away, force], 6.0, None, [])  # type: ignore[arg-type]
    assert none is (force if ahead < TIE_NATS else None)


def test_other_effects_are_accepted_whatever_ran_away():
    away, weight = candidate(Tether(), 90.0, False), candidate(PointMass(), 10.0)
    assert first_acceptable([away, weight], 6.0, None, []) is weight  # type: ignore[arg-type]


def test_what_is_refused_for_another_reason_is_no_sign():
    better, force = candidate(Tether(), 90.0), candidate(FollowerForce(), 20.0)
    better.refused = "held-out frames do not support it"
    assert first_acceptable([better, force], 6.0, None, []) is force  # type: ignore[arg-type]
