"""Forces of place along one direction: energies, exact derivatives, found, their form told."""

import numpy as np
import pytest

from ropefit.diagnosis.forms import described
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.search import search
from ropefit.effects import DistributedLoad, HalfSpace, WallField
from ropefit.effects.planar import Falling, Planar, Power, Profile, Step
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import terms
from ropefit.models.terms import Term
from tests.concealed import nominal_fit, recorded, rope
from tests.test_laws import by_differences

WALL = [0.02, 0.05, 0.1, 4.0, 3.0]
PART = [0.02, 0.05, 0.1, 0.02, -20.0]


@pytest.mark.parametrize(
    "profile",
    [
        Falling(np.array(6.0), np.array(-3.0)),
        Falling(np.array(-6.0), np.array(0.0)),
        Power(np.array(1.3), np.array(2.5), 0.01),
        Power(np.array(-2.5), np.array(2.5), 0.01),
        Step(np.array(0.1), np.array(20.0)),
        Step(np.array(-0.1), np.array(-20.0)),
    ],
)
def test_a_force_is_the_gradient_of_its_energy(profile: Profile):
    way = np.array([0.6, 0.0, -0.8])
    field = Planar(way, np.array(0.7), np.array([0.1, 0.2, 0.3]), profile)
    x = 0.5 * np.random.default_rng(3).normal(size=(50, 3))
    slope, rows = field.derivatives(x)
    for a in range(3):
        step = 1e-5 * np.eye(3)[a]
        rise = (field(x + step) - field(x - step)) / 2e-5
        bend = (field.derivatives(x + step)[0] - field.derivatives(x - step)[0]) / 2e-5
        np.testing.assert_allclose(slope[:, a], rise, rtol=1e-4, atol=1e-7)
        np.testing.assert_allclose(rows[:, a], bend, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(("effect", "values"), [(WallField(), WALL), (HalfSpace(), PART)])
def test_derivatives_beside_a_wall_are_exact(effect: WallField | HalfSpace, values: list[float]):
    free = np.full(len(values), np.inf)
    term = Term(
        effect.name, effect.names, ("1",) * len(values), effect.apply, np.array(values),
        np.ones(len(values)), -free, free, free,
    )  # fmt: skip
    by_differences(Equilibrium(rope(30, 4), [term, *terms(rope(30, 4), ("EI", "length"))]))


def test_a_force_that_does_not_change_is_a_load():
    """But for the nodes that it acts on: a few along the rope."""
    load = np.array([0.05, -0.03, 0.02])
    setup = rope(64, 4)
    flat = np.concatenate([load, np.zeros(2)])
    one = Equilibrium(WallField().apply(setup, flat), []).at(np.empty(0)).seen
    other = Equilibrium(DistributedLoad().apply(setup, load), []).at(np.empty(0)).seen
    plain = Equilibrium(setup, []).at(np.empty(0)).seen
    assert np.abs(other - plain).max() > 0.01
    assert np.abs(one - other).max() < 0.01 * np.abs(other - plain).max()


RULES = Rules(effects=("force_field", "distributed_load", "point_mass", "soft_section"))


def test_a_wall_is_found_with_how_fast_its_force_falls():
    fine = WallField().apply(rope(144), np.array([0.0, 0.15, 0.0, 9.0, 0.0]))
    result = search(nominal_fit(recorded(fine, seed=3), 48), 0, lambda *_: None, RULES)
    (one,) = result.accepted
    assert isinstance(one.candidate.hypothesis.effect, WallField | HalfSpace)  # either falls so
    found = described(one.candidate, result.final)
    assert found is not None
    best = next(f for f in found.forms if "lambda" in f.form.name)
    told = {
        c.name: (c.value, *ends) for c, ends in zip(best.constants, best.intervals, strict=True)
    }
    value, low, high = told["lambda"]
    assert low < 1 / 9 < high
    assert 0.8 < 9 * value < 1.25


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_part_of_the_room_is_found_with_its_edge(sense: float):
    edge, sharpness = sense * 0.02, sense * 50.0
    fine = HalfSpace().apply(rope(144), np.array([0.0, 0.03, sense * 0.01, edge, sharpness]))
    result = search(nominal_fit(recorded(fine, seed=4), 48), 0, lambda *_: None, RULES)
    (one,) = result.accepted
    found = described(one.candidate, result.final)
    assert found is not None
    assert [f.form.name for f in found.forms] == [f"F = F0 where x {'<' if sense > 0 else '>'} x1"]
    best = found.forms[0]
    told = {c.name: (c.value, *e) for c, e in zip(best.constants, best.intervals, strict=True)}
    value, low, high = told["x1"]
    assert low < edge < high
    assert abs(value - edge) < 0.01
