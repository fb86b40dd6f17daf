"""Rods built at once are the rods of each setup."""

import numpy as np

from ropefit.effects import BendingLaw
from ropefit.models.rest_curve import VARYING, apply
from ropefit.rod.at_once import laws, rods
from ropefit.rod.bending import springs
from tests.test_off_axis import held


def test_rods_built_at_once_are_those_of_each():
    setup, rng = held(), np.random.default_rng(0)
    every = [
        setup,
        setup._replace(kinks=rng.normal(0, 0.1, setup.kinks.shape)),
        setup._replace(properties=setup.properties._replace(bend=2 * setup.properties.bend)),
        setup._replace(load=rng.normal(size=setup.load.shape), clamp_compliance=np.ones((2, 2))),
        setup._replace(mass=rng.random(setup.mass.shape), stretch=rng.random(setup.stretch.shape)),
        setup._replace(moment=rng.normal(size=(2, 3)), gravity=np.array([1.0, 2.0, -9.0])),
    ]
    built = rods(every)
    for row, one in enumerate(every):
        for name, expected in one.rod()._asdict().items():
            if name != "load":
                np.testing.assert_array_equal(getattr(built, name)[row], expected)
    assert not built.load.any()


def test_laws_at_once_are_those_of_each():
    setup, effect = held(), BendingLaw()
    every = [
        effect.apply(setup, np.array([exponent, 0.1, 0.0, -0.2, 0.0])) for exponent in (0.3, -0.4)
    ]
    every[1] = every[1]._replace(kinks=np.full_like(setup.kinks, 0.1))
    built = springs(laws(every), rods(every))
    for row, one in enumerate(every):
        assert one.bending is not None
        for field, expected in zip(built, springs(one.bending, one.rod()), strict=True):
            np.testing.assert_array_equal(field[row : row + 1], expected)


def test_a_rest_curve_at_once_is_its_points_one_by_one():
    setup, values = held(), np.random.default_rng(1).normal(size=len(VARYING))
    one_by_one = setup
    for name, value in zip(VARYING, values, strict=True):
        one_by_one = apply(name)(one_by_one, np.array([value]))
    at_once = apply(*VARYING)(setup, values)
    np.testing.assert_allclose(
        at_once.properties.curvature, one_by_one.properties.curvature, rtol=1e-13
    )
