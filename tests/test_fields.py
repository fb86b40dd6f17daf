"""The table of the rod's fields, and every record that has them."""

from __future__ import annotations

import numpy as np

from ropefit.rod.fields import MOTION, MOVING_ROD, ROD, names, shapes, zeros
from ropefit.rod.moving import Moving, moving, undamped
from ropefit.rod.rod import DIMS, Rod, build, uniform
from ropefit.solvers.batched.ropes import Ropes
from ropefit.solvers.dynamics import derivatives
from ropefit.solvers.dynamics.kernels.records import CLIP
from ropefit.solvers.equilibrium import implicit
from tests.rods import DOWN


def test_records_have_the_fields_of_the_table() -> None:
    assert list(Rod._fields) == names(ROD)
    assert list(Moving._fields[1:]) == names(MOTION)
    assert list(Ropes._fields[: len(ROD)]) == names(ROD)
    assert list(implicit.Directions._fields[: len(ROD)]) == names(ROD)
    assert set(derivatives.Directions._fields) == set(names((*MOVING_ROD, *CLIP)))


def test_shapes_are_those_of_a_rope() -> None:
    """A built rope has the shapes that the table says, and the zeros as well."""
    p = uniform(length=1.0, segments=7, bend=1e-3, density=0.1)
    rod = build(p, 9.81 * DOWN, (True, False))
    rope = moving(p, rod, undamped(p))
    arrays = rod._asdict() | rope._asdict()
    for fields in (ROD, MOTION, MOVING_ROD):
        for name, shape in shapes(fields, 7).items():
            assert tuple(arrays[name].shape) == shape, name
    assert tuple(t.ndim for t in rod) == DIMS
    for name, array in zeros(CLIP, (3,), 7, T=5).items():
        assert array.shape[0] == 3
        assert not array.any()
        assert array.shape[1:] == shapes(CLIP, 7, T=5)[name]
    assert zeros(ROD, (2, 4), 7)["stiffness"].shape == (2, 4, 8, 3)
    assert all(isinstance(array, np.ndarray) for array in zeros(ROD, (), 7).values())
