"""Deferred correction of a motion's mesh and steps, and what repeated samples do to intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ropefit.fitting.motion import finer_mesh_needed, resolved_clips
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.mesh import refined
from ropefit.rod.potential import Potential
from tests.test_diagnosis_of_motion import DOWN, LENGTH, driven, model, recorded

NOTHING, STATIONS = np.empty(0), 12


def hung(segments: int) -> np.ndarray:
    """Centrelines at 7 places from which first states are found."""
    setup = driven(segments, clips=1)
    lines = np.linspace(setup.ends[:, 0], setup.ends[:, 1], 7, axis=1)
    lines[:, :, 2] -= 0.3 * np.sin(np.linspace(0, np.pi, 7))
    return lines


def test_the_corrected_motion_is_that_of_a_much_finer_mesh():
    coarse = model(driven(24, clips=1), hung(24))
    reference = replace(model(driven(96, clips=1), hung(96)), finer=4).at(NOTHING).seen[:, ::4]
    plain, corrected = (m.at(NOTHING).seen for m in (coarse, coarse.corrected(NOTHING)))
    before, after = (np.sqrt(((x - reference) ** 2).mean()) for x in (plain, corrected))
    assert before > 5e-4 * LENGTH
    assert after < before / 4


@pytest.mark.parametrize(
    ("segments", "share", "finer"),
    [(24, 5e-4, False), (24, 2e-3, True), (48, 1e-3, False), (48, 4e-3, True), (96, 1e-2, False)],
)
def test_a_large_error_asks_for_a_finer_mesh(segments, share, finer):
    plain = model(driven(segments, clips=1), hung(segments))
    error = np.full((len(plain.time), segments + 1, 3), share * LENGTH)
    assert finer_mesh_needed(replace(plain, mesh_error=error), LENGTH) == finer
    assert not finer_mesh_needed(plain, LENGTH)


def test_refining_keeps_weight_and_length():
    setup = driven(12, clips=1)
    setup = setup._replace(mass=setup.mass + 0.001, rigid=np.linspace(0, 1, 12))
    fine = refined(setup)
    assert fine is not None
    assert fine.segments == 24
    assert fine.mass.sum() == pytest.approx(float(setup.mass.sum()))
    assert fine.weight == pytest.approx(float(setup.weight))
    np.testing.assert_allclose(fine.arc[::2], setup.arc, atol=1e-15)
    assert fine.rod().load.sum(0)[2] == pytest.approx(float(setup.rod().load.sum(0)[2]))


def test_a_rope_in_a_potential_is_left_as_it_is():
    setup = driven(12, clips=1)
    setup = setup._replace(potentials=(Potential(lambda x: x @ DOWN, np.zeros(13)),))
    one = model(setup, hung(12))
    assert one.corrected(NOTHING) is one


def test_a_horizon_begins_anew_and_is_not_corrected():
    corrected = model(driven(12, clips=1), hung(12)).corrected(NOTHING)
    assert corrected.mesh_error is not None
    assert corrected.horizon(0.2).mesh_error is None


def test_samples_that_repeat_widen_the_intervals_of_a_motion():
    lines, data = recorded(None, [], seed=3)
    forward = model(driven(24), lines, ("EI",))
    start, sd = forward.start(), []
    for repeats in (1.0, 25.0):
        noise = Noise(marker=1e-3, repeats=repeats)
        found = fit(forward, FitProblem(data, noise, STATIONS), start, 12, tolerance=1e-4)
        start = found.point.u
        sd.append(found.sd()[0] / np.sqrt(found.spread if repeats == 1.0 else 1.0))
    assert 4 < sd[1] / sd[0] < 6  # the square root of 25, but for priors


def test_rigidity_does_not_depend_on_the_mesh():
    """What is left is by the noise of the first states."""
    lines, data = recorded(None, [], seed=5, segments=96)
    problem, found = FitProblem(data, Noise(marker=3e-4), STATIONS), []
    for segments in (24, 48):
        forward = model(driven(segments), lines, ("EI", "air_damping"))
        one = fit(forward, problem, forward.start(), 20, tolerance=1e-5)
        two = fit(forward.corrected(one.point.u), problem, one.point.u, 20, tolerance=1e-5)
        found.append([f.forward.terms[0].value(f.point.u[:1])[0] for f in (one, two)])
    (plain, corrected), (plain_finer, corrected_finer) = found
    assert plain / plain_finer > 1.06
    assert corrected == pytest.approx(corrected_finer, rel=0.01)


def test_clips_that_a_finer_mesh_moves_otherwise_are_excluded():
    plain = model(driven(24, clips=1), hung(24))
    parts = np.array_split(plain.clips[0], 3)
    error = np.zeros((len(plain.time), plain.base.segments + 1, 3))
    error[parts[1]] = 0.01 * LENGTH
    several = replace(plain, clips=parts, mesh_error=error)
    left = [clip[0] for clip in resolved_clips(several, LENGTH)]
    assert left == [parts[0][0], parts[2][0]]
    nowhere = replace(several, mesh_error=np.full_like(error, 0.01 * LENGTH))
    assert len(resolved_clips(nowhere, LENGTH)) == 3
    assert len(resolved_clips(replace(several, mesh_error=None), LENGTH)) == 3
