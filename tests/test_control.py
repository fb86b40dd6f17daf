"""The nominal recording as a control: what explains it as well is no change."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ropefit.diagnosis import control as controls
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.control import (
    CONTRADICTED,
    HARDLY_MORE,
    IN_BOTH,
    Controlled,
    Refuted,
    refuted,
)
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.effects import BendingLaw, PointMass
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from tests.concealed import nominal_fit, recorded, rope, with_effect

NEEDED = 6.0
WEIGHT = (0.004, 0.37)  # kg, m


def law_of(exponent: float) -> list[float]:
    """The values of a law of bending along one of its forms."""
    usual = Hypothesis(BendingLaw(), NO_PLACE)
    return [exponent, *np.zeros(len(usual.effect.quantities) - 1)]


@pytest.fixture(scope="module")
def fits():
    """Nominal fits to three recordings of one rope: as it is, with a weight, and with a law."""
    setups = {
        "bare": rope(144), "weight": with_effect(PointMass(), list(WEIGHT), 144),
        "law": with_effect(BendingLaw(), law_of(-0.4), 144),
    }  # fmt: skip
    return {
        name: nominal_fit(recorded(setup, seed=k), 72)
        for k, (name, setup) in enumerate(setups.items())
    }


@pytest.fixture(scope="module")
def weight(fits):
    return fit_candidate(fits["weight"], Hypothesis(PointMass(), NO_PLACE), np.array(WEIGHT))


@pytest.fixture(scope="module")
def law(fits):
    values = np.array(law_of(-0.4))
    return fit_candidate(fits["law"], Hypothesis(BendingLaw(), NO_PLACE), values)


def test_a_weight_is_a_change_unless_the_control_has_it_as_well(fits, weight):
    assert weight.evidence > NEEDED
    assert refuted(weight, fits["bare"], NEEDED).why == ""
    assert refuted(weight, fits["weight"], NEEDED).why == IN_BOTH


def test_no_fit_to_a_control_that_has_less_to_explain(fits, weight, monkeypatch):
    def fail(*_):
        raise AssertionError("fitted")

    monkeypatch.setattr(controls, "fit_candidate", fail)
    rich = replace(weight, evidence=0.5 * fits["bare"].cost + NEEDED)
    assert refuted(rich, fits["bare"], NEEDED).why == ""
    with pytest.raises(AssertionError, match="fitted"):
        refuted(replace(rich, evidence=rich.evidence - 1), fits["bare"], NEEDED)


def test_a_law_of_the_rope_holds_in_the_control_too(fits, law):
    assert law.evidence > NEEDED
    assert refuted(law, fits["bare"], NEEDED).why == CONTRADICTED
    assert refuted(law, fits["law"], NEEDED).why == IN_BOTH


def test_a_law_that_the_control_does_not_show_may_be_one(fits, law):
    """As of a rope that was hardly bent there."""
    control = fits["bare"]
    problem = control.problem.under(Noise(white=(1.0, 1.0)))  # m²
    hardly = fit(control.forward, problem, control.point.u)
    assert refuted(law, hardly, NEEDED).why == ""


def single(name: str, evidence: float):
    effect = SimpleNamespace(stands_for_others=name == "force_field")
    return SimpleNamespace(hypothesis=SimpleNamespace(name=name, effect=effect), evidence=evidence)


def test_what_explains_significantly_less_than_what_is_refuted_goes_with_it(fits, monkeypatch):
    kept = [single("point_mass", 30.0 - 0.5 * TIE_NATS), single("tether", 30.0 - 2 * TIE_NATS)]
    every = [single("bending_law", 30.0), *kept]
    monkeypatch.setattr(controls, "refuted", lambda c, *_: Refuted(CONTRADICTED * (c is every[0])))
    refused: list[str] = []
    rule = Controlled(fits["bare"])
    assert rule.supported(every, NEEDED, fits["weight"], refused) == [kept[0]]  # type: ignore
    assert refused == [f"bending_law: {CONTRADICTED}"]
    assert rule.supported(kept, NEEDED, fits["weight"], refused) == kept  # type: ignore
    weak = [single("bending_law", 0.5 * NEEDED)]
    assert rule.supported(weak, NEEDED, fits["weight"], refused) == weak  # type: ignore
    assert len(refused) == 1


@pytest.mark.parametrize(
    ("beaten", "there", "kept"),
    [("gravity_misalignment", 3.5, False), ("gravity_misalignment", 1.0, True),
     ("force_field", 3.5, True)],
)  # fmt: skip
def test_as_much_as_is_missed_in_both_is_no_change(beaten, there, kept, fits, monkeypatch):
    """But for what may stand for something else in each."""
    first, second = single(beaten, 9.0), single("tether", 7.5)
    monkeypatch.setattr(
        controls, "refuted", lambda c, *_: Refuted(IN_BOTH * (c is first), there * (c is first))
    )
    refused: list[str] = []
    rule = Controlled(fits["bare"])
    found = rule.supported([first, second], NEEDED, fits["weight"], refused)  # type: ignore
    assert found == ([second] if kept else [])
    assert (f"tether: {HARDLY_MORE}" in refused) == (not kept)
