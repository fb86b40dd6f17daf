"""Changes of a setup by one search variable, of which only what depends on it is made again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ropefit.effects import (
    Effect,
    GravityMisalignment,
    IntrinsicCurvature,
    PlasticSet,
    SupportPlane,
)
from ropefit.effects.mass_section import MassSection
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration
from ropefit.models.watched import OF_ROPE, differing, done, followed, made_again
from ropefit.rod.differences import DIFFERENCE_STEP
from ropefit.rod.setup import Setup
from tests.concealed import rope
from tests.test_memory import there_and_back

STEP = 1e-3


def arrays(value: Any) -> list[np.ndarray]:
    """Return all arrays in (nested) tuples."""
    if isinstance(value, tuple):
        return [array for item in value for array in arrays(item)]
    return [value] if isinstance(value, np.ndarray) else []


def assert_alike(one: Any, other: Any) -> None:
    x = np.linspace(0, 1, 30).reshape(1, 10, 3)
    for name, a, b in zip(Setup._fields, one, other, strict=True):
        if name == "potentials":
            a, b = (tuple(p.energy(x) for p in all_) for all_ in (a, b))
        for p, q in zip(arrays(a), arrays(b), strict=True):
            np.testing.assert_array_equal(p, q, err_msg=name)


def added(setup: Setup, effect: Effect, values: list[float]) -> Setup:
    return effect.apply(setup, np.array(values))


@pytest.mark.parametrize("remembers", [False, True])
def test_a_change_is_that_of_the_whole_setup(remembers: bool):
    setup = there_and_back(20) if remembers else rope(20)
    setup = setup._replace(past=None)
    terms = [PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0)), *calibration(setup, Priors(), False)]
    forward = Equilibrium(setup, terms)
    rng = np.random.default_rng(1)
    u = 0.1 * rng.normal(size=forward.size)
    known = [np.isfinite(term.prior).all() for term in terms]
    one_sided = np.repeat(known, [term.size for term in terms])
    for k, change in enumerate(forward.changes(u)):
        moved = u.copy()
        if one_sided[k]:  # what has a prior
            assert_alike(change(-DIFFERENCE_STEP), forward.setup_at(u))
            moved[k] += DIFFERENCE_STEP + STEP
        else:
            moved[k] += STEP
        assert_alike(change(STEP), forward.setup_at(moved))


def test_errors_of_the_set_up_differenced_to_one_side_have_seven_digits():
    setup = rope(20)
    forward = Equilibrium(setup, calibration(setup, Priors(), False))
    u = np.zeros(forward.size)  # errors of the camera that are not small add to the second order
    point = forward.at(u)
    found, step = forward.jacobian(point), 3e-3
    for k in range(forward.size):
        one = step * np.eye(forward.size)[k]
        sides = {n: forward.at(u + n * one, point.solution.states).seen for n in (-2, -1, 1, 2)}
        wanted = (8 * (sides[1] - sides[-1]) - sides[2] + sides[-2]) / (12 * step)
        assert np.abs(found[k] - wanted).max() < 1e-7 * np.abs(wanted).max()


def test_changes_are_made_again_only_as_far_as_they_depend_on_what_moved():
    calls: list[str] = []

    def counted(name: str, effect: Effect, values: list[float]):
        def change(setup: Setup) -> Setup:
            calls.append(name)
            return added(setup, effect, values)

        return change

    steps = [
        counted("section", MassSection(), [0.01, 0.5, 0.2]),
        counted("gravity", GravityMisalignment(), [0.01, 0.02]),
        counted("curved", IntrinsicCurvature(), [1.0, 0.5, 0.5, 0.3]),
        counted("plane", SupportPlane(), [-0.3, 0.0, 0.0]),
        counted("set", PlasticSet(), [0.4, 4.0]),
    ]
    base = there_and_back(20)._replace(past=None)
    made, setup = [], base
    for step in steps:
        made.append(done(setup, step))
        setup = made[-1].after
    made = followed(made)
    stiffer = base.properties._replace(bend=1.1 * base.properties.bend)
    for changed in (
        base._replace(gravity=base.gravity * 1.01),
        base._replace(ends=base.ends + 0.1),
        base._replace(properties=stiffer),
        base._replace(time=np.arange(24.0)),
    ):
        moved = differing(changed, base)
        whole = changed
        for step in steps:
            whole = step(whole)
        calls.clear()
        assert_alike(made_again(changed, moved, made), whole)
        assert len(calls) < len(steps)
        if moved == {"time"}:
            assert calls == []
        if moved == {"properties.bend"}:  # not by what changes other properties
            assert calls == ["set"]


def test_properties_are_watched_one_by_one_and_as_a_whole():
    setup = rope(20)
    stiffer = done(setup, lambda s: s._replace(properties=s.properties._replace(
        bend=2 * s.properties.bend)))  # fmt: skip
    assert stiffer.reads == stiffer.writes == {"properties.bend"}
    whole = done(setup, lambda s: s._replace(mass=s.mass + sum(v.sum() for v in s.properties)))
    assert whole.reads == {"mass", *OF_ROPE}
    longer = setup._replace(properties=setup.properties._replace(length=setup.properties.length))
    assert differing(longer, setup) == frozenset()
    assert done(setup, lambda s: s._replace(properties=s.properties)).writes == frozenset()


def test_a_rope_that_remembers_keeps_the_loads_of_each_frame():
    setup = added(there_and_back(20), PlasticSet(), [0.4, 4.0])
    load = np.random.default_rng(2).normal(0, 1e-3, (len(setup.ends), 21, 3))
    forward = Equilibrium(setup._replace(load=load), [PARAMETERS["EI"].term(setup)])
    point = forward.at(np.zeros(1))
    step = 1e-4
    low, high = (forward.at(np.array([v])).seen for v in (-step, step))
    wanted = (high - low) / (2 * step)
    found = forward.jacobian(point)[0]
    assert np.abs(found - wanted).max() < 1e-3 * np.abs(wanted).max()
