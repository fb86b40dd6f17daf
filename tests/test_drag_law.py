"""Drag that grows as a power of the speed: its curve, its derivatives, found and named."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from ropefit.diagnosis.forms import described
from ropefit.diagnosis.search import search
from ropefit.effects import DragLaw, Effect
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.mesh import refined
from ropefit.rod.moving import DRAG_SPEEDS
from ropefit.rod.setup import Setup
from tests.test_diagnosis_of_motion import FREE, driven, model, recorded

AIR, POWER = 0.8, 2.0  # N/m at 1 m/s


class Grown:
    """The air as it is: AIR v^POWER. Not an `Effect`, which every search would look for."""

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        assert setup.damping is not None
        air = np.full_like(setup.damping.air, AIR)
        law = (POWER - 1) * np.log(DRAG_SPEEDS)
        return setup._replace(damping=setup.damping._replace(air=air), drag=law)


def test_the_curve_told_is_the_drag_that_acts():
    setup = Grown().apply(driven(12), np.zeros(0))
    law = DragLaw().law(setup)
    speed = np.array([0.05, 0.3, 2.0])
    assert law.curve(setup, speed) == pytest.approx(AIR * speed**POWER, rel=0.02)
    linear = driven(12)
    assert linear.damping is not None
    assert law.curve(linear, speed) == pytest.approx(float(linear.damping.air[0]) * speed)


@pytest.mark.parametrize("values", [[0.7, -0.4, 0.5], [0.0, 0.0, 0.0]])
def test_the_effect_keeps_the_drag_at_its_middle_speed(values):
    setup, effect = driven(12), DragLaw()
    with_law = effect.apply(setup, np.array(values))
    law, middle = effect.law(setup), np.array([3.0 * 0.9**0.5 * 0.1448])  # √(g L) / √48
    near = law.curve(with_law, middle) / law.curve(setup, middle)
    assert near == pytest.approx(1.0, abs=0.12)  # the knots are an octave apart
    two = np.array([0.25, 0.5])  # m/s, knots where `exponent` alone counts
    factor = law.curve(with_law, two) / law.curve(setup, two)
    assert factor[1] / factor[0] == pytest.approx(2 ** values[0])


def test_derivatives_are_those_of_differences():
    lines, _ = recorded(cast(Effect, Grown()), [], seed=0)
    effect = DragLaw()
    forward = model(driven(12), lines)
    values = np.array([0.6, 0.3, -0.3])
    law = effect.apply(forward.base, values)
    forward.base = law
    point = forward.at(np.empty(0))
    assert point.converged.all()
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1.0

        def changed(amount: float, step: np.ndarray = step) -> Setup:
            return effect.apply(law._replace(drag=None), values + amount * step)

        sides = []
        for side in (-1e-4, 1e-4):
            forward.base = changed(side)
            sides.append(forward.at(np.empty(0)).seen)
        forward.base = law
        expected = (sides[1] - sides[0]) / 2e-4
        found = point.respond([changed])[0]
        scale = np.abs(expected).max()
        assert scale > 1e-5
        assert np.abs(found - expected).max() < 1e-3 * scale


def test_the_finer_mesh_has_the_same_law_and_springs():
    springs = np.linspace(0.1, 0.4, 13)
    setup = Grown().apply(driven(12), np.zeros(0))._replace(springs=springs)
    fine = refined(setup)
    assert fine is not None
    assert fine.springs is not None
    assert fine.drag is setup.drag
    assert np.array_equal(fine.springs[::2], springs)
    assert not fine.springs[1::2].any()


def test_it_is_found_with_its_power():
    lines, data = recorded(cast(Effect, Grown()), [], seed=3)
    forward = model(driven(24), lines, FREE)
    nominal = fit(forward, FitProblem(data, Noise(marker=0.002), 40), None, 15, tolerance=1e-4)
    d = search(nominal, 0, lambda share, text: None)
    assert d.verdict == "found"
    (one,) = d.accepted
    assert one.candidate.hypothesis.name == "drag_law"
    found = described(one.candidate, d.final)
    assert found is not None
    power = next(f for f in found.forms if "^n" in f.form.name)
    n, (low, high) = power.constants[1].value, power.intervals[1]
    assert low < POWER < high
    assert n == pytest.approx(POWER, abs=0.25)
