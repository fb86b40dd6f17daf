"""Inertia is found although the model at rest came out rigid, where the scan sees no force."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ropefit.adapters.end_path import end_path
from ropefit.adapters.motion_of import motion_of
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.next_motion import next_motion
from ropefit.diagnosis.proposals import proposals
from ropefit.effects import Inertia
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Motion, bare

FRAMES, SEGMENTS, EI = 8, 40, 0.02
DOWN = np.array([0.0, 0.0, -9.81])


def shaken():
    """A rope of 1 kg between two clamps, in frames that accelerate, and where it is seen."""
    rng = np.random.default_rng(0)
    p = uniform(length=1.0, segments=SEGMENTS, bend=EI, density=1.0)
    ends = np.zeros((FRAMES, 2, 3))
    ends[:, 1, 0] = rng.uniform(0.4, 0.7, FRAMES)
    level = np.stack([quaternion_along(np.array(v)) for v in ((0.2, 0.0, -1), (0.2, 0.0, 1))])
    clamp = np.tile(level, (FRAMES, 1, 1))
    still = bare(p, DOWN, ends, clamp, np.array([0.0, -2, 0]))
    bump = np.sin(np.linspace(0, np.pi, SEGMENTS + 1))[:, None]
    acceleration = bump * rng.normal(scale=4.0, size=(FRAMES, 1, 3))
    moving = still._replace(motion=Motion(0 * acceleration, acceleration))
    true = Inertia().apply(moving, np.ones(1))
    seen = Equilibrium(true, []).at(np.empty(0))
    assert seen.solution.converged.all()
    nodes = np.arange(4, SEGMENTS, 4)
    points = seen.seen[:, nodes] + 1e-3 * rng.normal(size=(FRAMES, len(nodes), 3))
    share = np.broadcast_to(nodes / SEGMENTS, points.shape[:2])
    mask = np.ones(points.shape[:2], dtype=bool)
    return moving, Data(points, share.copy(), mask, True, np.array([0.0, -2, 0]))


def test_motion_is_seen_in_clouds_of_which_stretches_are_hidden():
    time, arc = 0.03 * np.arange(20), np.linspace(0, 1, 21)
    shape = np.stack([arc, 0 * arc, -0.2 * np.sin(np.pi * arc)], axis=-1)
    line = shape + np.array([0.0, 1.0, 0.0]) * time[:, None, None] ** 2
    ends = line[:, [0, -1]].copy()
    line[::2, 5:8] = np.nan
    line[3, :2] = np.nan
    o = SimpleNamespace(
        source="cloud", frames=np.arange(20), time=time, centreline=line, node_arc=arc, length=1.0,
        end_position=ends, end_orientation=np.full((20, 2, 4), np.nan),
        gravity=np.array([0.0, 0.0, -9.81]), depth_measured=True,
    )  # fmt: skip
    found = motion_of(o, arc)  # pyright: ignore[reportArgumentType]
    assert found is not None
    np.testing.assert_allclose(found.acceleration[..., 1], 2.0, atol=1e-6)
    np.testing.assert_allclose(found.acceleration[..., 2], 0.0, atol=0.1)
    line[4, 3:] = np.nan
    assert motion_of(o, arc) is None  # pyright: ignore[reportArgumentType]


def test_the_grippers_clock_is_an_error_of_the_set_up_wherever_the_ends_move():
    setup, _ = shaken()
    time = 0.5 * np.arange(FRAMES)
    ends = np.zeros((FRAMES, 2, 3)) + time[:, None, None]
    path = end_path(time, np.arange(FRAMES), ends, setup.clamp, 1.0)
    moving = setup._replace(end_path=path)
    known = Priors(time_lag=0.004)
    (clock,) = (t for t in calibration(moving, known, False) if t.name == "clock")
    np.testing.assert_allclose(clock.prior, 0.004)
    late = clock.apply(moving, np.array([0.01]))
    np.testing.assert_allclose(late.ends - moving.ends, 0.01)
    for still, shared in ((setup, False), (moving, True)):
        assert all(t.name != "clock" for t in calibration(still, known, shared))


def test_inertia_is_found_from_a_rigid_model():
    setup, data = shaken()
    bend = PARAMETERS["EI"].within(Range(100 * EI, 1e-4 * EI, 1e6 * EI))
    noise = Noise(marker=1e-3)
    nominal = fit(Equilibrium(setup, [bend]), FitProblem(data, noise, 1))
    ((hypothesis, start),) = proposals(nominal, slow=False)[0]
    candidate = fit_candidate(nominal, hypothesis, start)
    assert candidate is not None
    assert candidate.values()[0] == pytest.approx(1, abs=0.05)
    assert bend.value(candidate.fit.point.u[:1])[0] == pytest.approx(EI, rel=0.05)
    assert candidate.evidence > 100
    assert (candidate.gains > 0).all()
    assert proposals(candidate.fit, slow=False) == []
    at_rest = nominal.forward.base._replace(motion=None)
    still = fit(Equilibrium(at_rest, [bend]), FitProblem(data, noise, 1), evaluations=1)
    assert proposals(still, slow=False) == []
    # A candidate is like itself in every slow motion.
    name, apart, _ = next_motion(candidate, candidate)
    assert (name, apart) == ("", 0.0)
