"""Friction of bending by Prandtl's law and by Dahl's: closed forms, loops, the form told."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.adapters.rope_description import law_constants
from ropefit.artifacts.causes import Law, Size
from ropefit.attachments import BendingFriction
from ropefit.diagnosis.forms import described
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.search import search
from ropefit.effects import BendingHysteresis
from ropefit.effects.friction_law import dahl, prandtl, with_friction
from ropefit.rod import memory
from tests import concealed
from tests.test_exporters import dahl_moments
from tests.test_memory import there_and_back

MOMENT, RANGE = 4e-4, 1.5  # N m, 1/m
TOLD = {"M0": MOMENT, "k0": RANGE}
RULES = Rules(effects=("bending_hysteresis", "point_mass", "bending_law"))


def both(moment: float, reach: float) -> tuple[np.float64, np.float64]:
    return np.float64(moment), np.float64(reach)


def test_the_curves_are_the_formulas():
    x = np.linspace(0.0, 8.0, 60)
    setup = there_and_back(20, 12)
    law = BendingHysteresis().law(setup)
    rising = law.curve(with_friction(setup, dahl(*both(MOMENT, RANGE))), x)
    np.testing.assert_allclose(rising, MOMENT * -np.expm1(-x / RANGE), atol=1e-12)
    assert (np.diff(rising) >= -1e-12).all()
    straight = law.curve(with_friction(setup, prandtl(*both(MOMENT, RANGE))), x)
    np.testing.assert_allclose(straight, MOMENT * np.minimum(x / RANGE, 1), atol=1e-12)
    for f in law.forms:
        v = np.array([MOMENT, RANGE])
        told = {c.name: c.value for c in f.constants(setup, v)}
        assert told == TOLD


@pytest.mark.parametrize("amplitude", [0.2, 1.0, 5.0])  # of curvature, in ranges
def test_loops_are_dahls(amplitude):
    """Of any size, from the first way on."""
    turns = amplitude * RANGE * 0.1 * np.sin(np.linspace(0, 4 * np.pi, 1201))
    setup = with_friction(concealed.rope(10, 1), dahl(*both(MOMENT, RANGE)))
    time = np.arange(float(len(turns)))
    law = memory.laws(setup.memory, setup.rod(), setup.properties.bend, time)
    vector = np.zeros((len(turns), 11, 2))
    vector[..., 0] = 0.5 * turns[:, None]
    state, moment = memory.unloaded(vector[0], len(setup.memory)), np.zeros(len(turns))
    for t in range(len(turns)):
        state = memory.after(law, t, t == 0, state, vector[t])
        moment[t] = 0.5 * (law.drag[..., None] * state.strain)[:, 5, 0].sum()
    wanted = dahl_moments(turns, MOMENT, RANGE * 0.1)
    np.testing.assert_allclose(moment, wanted, atol=1e-9 * MOMENT)


@pytest.mark.parametrize(("element", "name"), [(dahl, "Dahl"), (prandtl, "Prandtl")])
def test_the_form_is_told(monkeypatch, element, name):
    monkeypatch.setattr(
        concealed, "rope",
        lambda segments, frames=24, bend=concealed.EI: there_and_back(segments, frames, bend),
    )  # fmt: skip
    made = with_friction(there_and_back(144), element(*both(MOMENT, RANGE)))
    nominal = concealed.nominal_fit(concealed.recorded(made, seed=1), 48)
    result = search(nominal, 0, lambda *_: None, RULES)
    (one,) = result.accepted
    law = described(one.candidate, result.final)
    assert law is not None
    mine = law.forms[0]
    assert name in mine.form.name
    for c, (low, high), true in zip(mine.constants, mine.intervals, (MOMENT, RANGE), strict=True):
        assert low < true < high, c.name
        assert high - low < 0.5 * true
        # The interval is no narrower than what remains of the form's error without noise.
        assert high - low > 2 * 1.9 * c.inexact * c.value


def test_dahl_goes_to_newton_with_its_own_constants():
    beside = BendingHysteresis().exported_form("Dahl: M = M0 (1 - e^(-dk/k0))", TOLD, ())
    assert beside is not None
    (friction,) = beside.beside
    assert friction == BendingFriction(MOMENT, RANGE, "Dahl")
    assert BendingHysteresis().exported_form("Prandtl: M = M0 min(dk/k0, 1)", TOLD, ()) is None
    told = {
        "M0": Size(value=2e-3, unit="m^2", ci95=(1e-3, 3e-3)),
        "k0": Size(value=RANGE, unit="1/m", ci95=(1.0, 2.0)),
    }
    law = Law(form="Dahl", forms=["Dahl"], parameters=told)
    assert law_constants(law, 0.5) == {"M0": 1e-3, "k0": RANGE}  # over a weight of 0.5 N/m
