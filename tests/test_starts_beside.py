"""Starts of an effect from the values of the leading one, where both are nearly equivalent."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ropefit.effects import DistributedLoad, GravityMisalignment, Kink, TiltedClamp
from ropefit.effects.misfit import Misfit
from ropefit.models.equilibrium import Equilibrium
from ropefit.rod.setup import Setup
from tests.concealed import rope
from tests.test_least_squares import clamps

BEND, WIDTH = (0.5, -0.2), np.log(0.002)


def clamped() -> Setup:
    setup = rope(200)
    return setup._replace(clamp=clamps(setup.ends), clamped=(True, True))


def misfit(setup: Setup, *terms: str) -> Misfit:
    """What of a misfit these effects look at."""
    return cast(Misfit, SimpleNamespace(setup=setup, terms=terms))


def shape(setup: Setup) -> np.ndarray:
    return Equilibrium(setup, []).at(np.empty(0)).seen


@pytest.mark.parametrize(("end", "place"), [(0, 0.003), (1, 0.997)])
def test_a_kink_next_to_a_clamp_is_a_turned_clamp(end, place):
    setup = clamped()
    values = np.array([*BEND, WIDTH, place])
    ((tilt,),) = TiltedClamp(end).starts_beside(Kink(), values, misfit(setup))
    plain, kinked = shape(setup), shape(Kink().apply(setup, values))
    turned = shape(TiltedClamp(end).apply(setup, tilt))
    assert np.abs(kinked - plain).max() > 0.02
    # But for the 3 mm between them.
    assert np.abs(kinked - turned).max() < 0.1 * np.abs(kinked - plain).max()
    elsewhere = np.array([*BEND, WIDTH, 0.5])
    assert TiltedClamp(end).starts_beside(Kink(), elsewhere, misfit(setup)) == []


def test_a_uniform_load_is_gravity_turned():
    setup = rope(200)
    size, angle = np.linalg.norm(setup.gravity), 0.4
    down = size * np.array([np.sin(angle) * 0.6, np.sin(angle) * 0.8, -np.cos(angle)])
    load = 0.06 * (down - setup.gravity)  # N/m, of a rope of 60 g/m
    ((angles,),) = GravityMisalignment().starts_beside(DistributedLoad(), load, misfit(setup))
    turned = GravityMisalignment().apply(setup, angles)
    np.testing.assert_allclose(turned.gravity, down, atol=1e-9)
    loaded = shape(DistributedLoad().apply(setup, load))
    np.testing.assert_allclose(shape(turned), loaded, atol=1e-6)
    named = misfit(setup, "gravity_misalignment")
    assert GravityMisalignment().starts_beside(DistributedLoad(), load, named) == []
