"""Where fits of a force of place begin: gains to first order, and starts of either sign."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.forces_on_nodes import ForcesOnNodes
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.proposals import misfit_of
from ropefit.diagnosis.scan import Projection
from ropefit.effects import ForceField, HalfSpace
from ropefit.effects.force_in_space import lumped
from ropefit.effects.place import middle_of
from ropefit.inference.least_squares import sensitivity
from ropefit.models.equilibrium import Equilibrium
from tests.concealed import nominal_fit, recorded, rope

PLACE = [0.35, 0.1, -0.25]  # m, of the point


def pushed(strength: float):
    """A nominal fit to a rope that a point repels (or attracts), by a force that falls by e in
    8 cm."""
    values = np.array([strength, 0.0, 12.5, *PLACE])
    data = recorded(ForceField().apply(rope(72, 8), values), seed=11, points=120)
    return nominal_fit(data, 36)


@pytest.fixture(scope="module")
def repelled():
    return pushed(0.05)


def test_gains_are_those_of_the_forces_own_response(repelled):
    """Of a small field, as the rope settles in it: the projection of what that moves."""
    setup, point = repelled.point.setup, repelled.point
    share = lumped(setup.arc)
    nodes = np.flatnonzero(share)
    small = np.array([1e-4, 0.0, 12.5, *PLACE])
    field = ForceField().apply(setup, small).potentials[-1].energy
    seen = Equilibrium(ForceField().apply(setup, small), [], point.solution).at(np.empty(0)).seen
    s = repelled.stations
    moved = sensitivity((seen - point.seen)[None], s, s, repelled.whitener)[:, 0]
    project = Projection(repelled)
    along, square = moved @ project.z, moved @ project(moved)
    forces = ForcesOnNodes(repelled, tuple(nodes.tolist()))
    push = field.force_at(point.solution.x[:, nodes])
    (gain,), (multiple,) = forces.gains(push[None] * share[nodes, None], 1e9)
    assert gain == pytest.approx(0.5 * along**2 / square, rel=0.02)
    assert multiple == pytest.approx(along / square, rel=0.02)
    (less,), (most,) = forces.gains(push[None] * share[nodes, None], 0.5 * abs(multiple))
    assert most == pytest.approx(0.5 * multiple)
    assert less == pytest.approx(0.75 * gain)
    assert np.abs(forces.places - point.solution.x[:, nodes]).max() < 0.05


@pytest.mark.parametrize("strength", [0.05, -0.05])
def test_a_point_is_found_with_the_sign_of_its_force(strength: float):
    fitted = pushed(strength)
    (one, *_), *_ = ForceField().starts(misfit_of(fitted))
    assert np.sign(one[0]) == np.sign(strength)
    at = one[3:] + middle_of(fitted.point.setup) - middle_of(rope(72, 8))
    assert np.linalg.norm(at - PLACE) < 0.06
    found = fit_candidate(fitted, Hypothesis(ForceField(), NO_PLACE), one)
    assert found is not None
    value, low_high = found.values(), found.interval(3.0)
    truth = np.array([strength, 0.0, 12.5, *PLACE])
    assert ((low_high[0] <= truth) & (truth <= low_high[1]))[3:].all()
    assert value[0] == pytest.approx(strength, rel=0.2)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_part_of_the_room_is_found_on_its_side(sense: float):
    values = [0.0, 0.03, sense * 0.01, sense * 0.02, sense * 50.0]
    made = HalfSpace().apply(rope(72, 8), np.array(values))
    misfit = misfit_of(nominal_fit(recorded(made, seed=4, points=120), 36))
    starts = [one for one, *_ in HalfSpace().starts(misfit)]
    way = np.array(values[:3]) / np.linalg.norm(values[:3])
    right = [
        one for one in starts
        if one[:3] @ way > 0.8 * np.linalg.norm(one[:3]) and np.sign(one[4]) == sense
    ]  # fmt: skip
    assert right
    assert abs(right[0][3] - values[3]) < 0.06
