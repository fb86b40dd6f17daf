"""What is computed some frames or rows at a time is what all at once give."""

import numpy as np
import pytest

from ropefit.diagnosis import noise_measurement
from ropefit.diagnosis.full_scan import sensitivities
from ropefit.diagnosis.noise_measurement import measured_noise
from ropefit.effects import Tether
from ropefit.inference import noise
from ropefit.inference.bins import Data, match
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise, Whitener
from ropefit.inference.problem import FitProblem
from ropefit.models import response
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.models.priors import Priors, calibration
from ropefit.rod.setup import Setup
from tests.concealed import BINS, recorded, rope
from tests.test_memory import with_effect


def held_by_a_thread(setup: Setup) -> Setup:
    return with_effect(setup, Tether(), [0.05, 0.0, 0.0, -0.003, 0.6])


def blown_at(setup: Setup) -> Setup:
    """A load that differs from frame to frame."""
    wind = np.linspace(0, 1e-3, len(setup.ends))[:, None, None]
    return setup._replace(load=setup.load + wind * np.ones((setup.segments + 1, 3)))


def model(setup: Setup) -> Equilibrium:
    return Equilibrium(setup, [PARAMETERS["EI"].term(setup), *calibration(setup, Priors(), False)])


def fitted(setup: Setup) -> Fit:
    problem = FitProblem(recorded(rope(96)), Noise(), BINS)
    return fit(model(setup), problem, evaluations=2)


@pytest.mark.parametrize("acts", [lambda s: s, held_by_a_thread, blown_at])
def test_changes_of_some_frames_at_a_time(acts, monkeypatch):
    forward = model(acts(rope(48)))
    point = forward.at(forward.start())
    changes = forward.changes(point.u)
    whole = point.respond(changes)
    monkeypatch.setattr(response, "AT_ONCE", 0)
    monkeypatch.setattr(response, "FEWEST", 5)
    found = np.zeros_like(whole)
    parts = [(frames, dx) for frames, dx in point.parts(changes)]
    for frames, dx in parts:
        found[:, frames] = dx
    assert [len(frames) for frames, _ in parts] == [5, 5, 2]
    np.testing.assert_allclose(found, whole, rtol=1e-9, atol=1e-12)


def off_the_axis(setup: Setup) -> Setup:
    offset = np.linspace(0, 0.004, setup.segments + 1)
    clamped = setup._replace(clamp_compliance=np.zeros((2, 2)))
    return clamped._replace(off_axis=np.stack([offset, -0.5 * offset], axis=-1))


@pytest.mark.parametrize("acts", [lambda s: s, held_by_a_thread, off_the_axis])
def test_changes_of_some_nodes_only(acts):
    """As the stations of few markers need."""
    forward = model(acts(rope(48)))
    point = forward.at(forward.start())
    changes, nodes = forward.changes(point.u), np.array([0, 1, 2, 20, 21, 47, 48])
    whole = point.respond(changes)
    for frames, dx in point.parts(changes, nodes=nodes):
        np.testing.assert_allclose(dx, whole[:, frames][:, :, nodes], rtol=1e-9, atol=1e-12)


def test_stations_take_their_places_from_few_nodes():
    share = np.array([0.0, 0.02, 0.5, 1.0])
    x = np.random.default_rng(0).normal(size=(3, 31, 3)).cumsum(axis=1)
    each = np.broadcast_to(share, (3, 4))
    data = Data(np.zeros((3, 4, 3)), each, np.ones((3, 4), dtype=bool), True, np.zeros(3))
    stations = match(data, x, BINS)
    at = stations.nodes(31)
    assert {0, 30} <= set(at)
    assert len(at) < 15
    np.testing.assert_array_equal(stations.places(x[:, at], at), stations.places(x))
    moved = np.random.default_rng(1).normal(size=(2, 3, 31, 3))
    np.testing.assert_array_equal(stations.project(moved[:, :, at], at), stations.project(moved))


def test_a_field_that_is_the_same_in_all_frames_has_one_row():
    """Memory: with loads that differ all fields of every change were spread over all frames."""
    forward = model(blown_at(rope(48)))
    point = forward.at(forward.start())
    slopes = response.slopes_of(point.setup, forward.changes(point.u), point.solution)
    found = response.directions_of(point.solution.rod, slopes, len(point.seen))
    assert len(found.load) == len(point.seen)
    assert len(found.stiffness) == len(found.rest) == len(found.length) == 1


def test_noise_measured_some_rows_at_a_time(monkeypatch):
    nominal = fitted(rope(48))
    known = sensitivities(nominal, [], ("point_mass", "end_offset", "tether"))
    whole, cost = measured_noise(nominal, known, [])
    monkeypatch.setattr(response, "AT_ONCE", 0)
    monkeypatch.setattr(response, "FEWEST", 5)
    monkeypatch.setattr(noise_measurement, "AT_ONCE", 100)
    monkeypatch.setattr(noise, "AT_ONCE", 100)
    again = sensitivities(nominal, [], ("point_mass", "end_offset", "tether"))
    for one, other in zip(known, again, strict=True):
        np.testing.assert_allclose(other.values, one.values, rtol=1e-7, atol=1e-7)
    found, parts = measured_noise(nominal, again, [])
    assert parts == pytest.approx(cost, abs=1e-4)
    assert (found.correlated, found.length) == pytest.approx((whole.correlated, whole.length))
    assert whole.ends is not None
    assert found.ends is not None
    assert found.ends.sd == whole.ends.sd


def test_fits_that_compare_the_same_places_share_a_whitener():
    stations = fitted(rope(48)).stations
    known = Noise(marker=1e-3)
    one = Whitener.of(stations, known)
    assert Whitener.of(stations, known) is one
    assert Whitener.of(stations, Noise(marker=2e-3)) is not one
    few = stations.among(np.arange(5))[1]
    other = Whitener.of(few, known)
    assert len(other.rows[0]) == len(few.frame) < len(stations.frame)
    values = np.random.default_rng(0).normal(size=(*stations.residual.shape, 3))
    white = one(values)
    assert np.shares_memory(one(values, own=True), values)
    np.testing.assert_array_equal(values.reshape(white.shape), white)
    metres = one.undo(white)
    np.testing.assert_allclose(one(metres.reshape(values.shape)), white)
    assert one.undo(white, white) is white
    np.testing.assert_array_equal(white, metres)
