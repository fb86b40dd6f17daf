"""The noise of markers, from how residuals repeat in neighbouring poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.repeated_poses import nearest_poses, repeated_noise
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from tests.concealed import BINS, EYE, rope

NOISE = 5e-4


def missed(jumps: int = 0, noise: float = NOISE) -> Fit:
    """A nominal fit that misses, alike in all frames, far more than noise, and in the last ones
    (jumps) something else."""
    setup = rope(96)
    seen = Equilibrium(setup, []).at(np.empty(0)).seen[:, ::8].copy()
    seen[:, 4:9, 2] += 0.01
    if jumps:
        seen[-jumps:, 4:9, 2] -= 0.03
    seen += np.random.default_rng(2).normal(0, noise, seen.shape)
    share = np.broadcast_to(np.linspace(0, 1, 13), seen.shape[:2])
    data = Data(seen, share, np.ones(share.shape, bool), True, np.array(EYE))
    forward = Equilibrium(setup, [PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0))])
    return fit(forward, FitProblem(data, Noise(marker=noise), BINS), None, 3)


@pytest.mark.parametrize("jumps", [0, 2])
def test_what_is_missed_alike_in_neighbouring_poses_is_not_in_it(jumps: int):
    """Nor where a shape snaps over between two of them."""
    found = repeated_noise(missed(jumps))
    assert found is not None
    assert found == pytest.approx(3**0.5 * NOISE, rel=0.5 if jumps else 0.25)


def test_noise_is_found_whatever_its_size():
    found = repeated_noise(missed(noise=4e-3))
    assert found == pytest.approx(3**0.5 * 4e-3, rel=0.25)


def test_the_nearest_pose_is_that_of_places_and_turns():
    setup = rope(96)
    ends = np.tile(setup.ends[:1], (5, 1, 1))
    ends[:, 1, 0] += [0.0, 0.3, 0.01, 0.32, 0.5]
    moved = setup._replace(ends=ends, clamp=np.full((5, 2, 4), np.nan), clamped=(False, False))
    np.testing.assert_array_equal(nearest_poses(moved), [2, 3, 0, 1, 3])
    half = 0.5 * np.array([0.0, 1.0, 0.1, 0.9, 0.5])
    clamp = np.full((5, 2, 4), np.nan)
    clamp[:, 0] = np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], axis=1)
    clamp[2] *= -1  # the same turn
    ends = np.tile(setup.ends[:1], (5, 1, 1))
    turned = setup._replace(ends=ends, clamp=clamp, clamped=(True, False))
    np.testing.assert_array_equal(nearest_poses(turned), [2, 3, 0, 1, 2])


def test_only_markers_at_rest_have_it():
    found = missed()
    cloud = replace(found.problem, data=replace(found.problem.data, material=False))
    assert repeated_noise(replace(found, problem=cloud)) is None
