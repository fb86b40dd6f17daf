"""What a model misses beyond noise counts as few samples as are independent."""

import numpy as np
import pytest

from ropefit.inference.bins import Stations
from ropefit.inference.discrepancy import (
    ALIGNED,
    inflation,
    inflation_of_repeated,
    misled,
    unequal,
)
from ropefit.inference.noise import Noise
from ropefit.models.correlated import correlated
from ropefit.models.parameters import PARAMETERS
from tests.concealed import rope

FRAMES, BINS, DIMS = 40, 20, 2
ORDER = np.random.default_rng(5).permutation(FRAMES)  # in which poses are recorded


def stations() -> Stations:
    frame, bin_ = (v.ravel() for v in np.indices((FRAMES, BINS)))
    empty = {name: np.empty(0) for name in Stations.__dataclass_fields__}
    residual = np.zeros((len(frame), DIMS))
    return Stations(**{**empty, "frame": frame, "bin": bin_, "residual": residual})


def inflated(z: np.ndarray, known: bool = False, share: bool = False) -> float:
    seen = np.arange(FRAMES)[ORDER, None, None] * np.ones((1, 3, 3))
    scale = float(np.sqrt((z**2).mean()))
    return inflation(stations(), z.ravel(), scale, seen, known)[int(share)]


def test_white_noise_that_is_larger_than_told_is_just_larger():
    z = 2 * np.random.default_rng(0).normal(size=(FRAMES, BINS, DIMS))
    assert inflated(z) == pytest.approx(4, rel=0.25)


def test_a_misfit_that_lasts_is_few_samples():
    rng = np.random.default_rng(1)
    shape = rng.normal(size=(1, BINS, DIMS))
    steady = rng.normal(size=(FRAMES, BINS, DIMS)) + shape * np.sqrt(3)
    many = inflated(steady)
    assert many > 10 * float((steady**2).mean())
    slow = np.cos(np.linspace(0, 2 * np.pi, FRAMES))[ORDER, None, None] * shape * np.sqrt(6)
    assert 10 < inflated(rng.normal(size=slow.shape) + slow) < many


def test_noise_that_was_taken_as_too_large_narrows_unless_it_is_known():
    z = 0.5 * np.random.default_rng(2).normal(size=(FRAMES, BINS, DIMS))
    assert inflated(z) == pytest.approx(0.25, rel=0.1)
    assert inflated(z, known=True) == 1.0


def test_few_samples_tell_little_of_their_variance():
    """White noise counts in full, a shape that all frames share as about one frame."""
    rng = np.random.default_rng(4)
    white = rng.normal(size=(FRAMES, BINS, DIMS))
    shape = rng.normal(size=(1, BINS, DIMS)) * 5
    assert inflated(white, share=True) > 0.9
    assert inflated(2 * white, share=True) > 0.4
    assert 0.2 < inflated(white + shape, share=True) * FRAMES * BINS * DIMS < 20


def test_a_clip_that_is_missed_by_more_counts_for_less():
    """Its variance is found, shrunk where its samples are few; equal clips stay equal."""
    rng = np.random.default_rng(6)
    clips = np.split(np.arange(FRAMES), 4)
    sd = np.repeat([1.0, 1.0, 5.0, 1.0], FRAMES // 4)
    white = rng.normal(size=(FRAMES, BINS, DIMS)) * sd[:, None, None]
    found = unequal(stations(), white.reshape(-1, DIMS), clips, FRAMES)
    np.testing.assert_allclose(found, sd**2, rtol=0.25)
    lasting = rng.normal(size=(1, BINS, DIMS)) * np.ones((FRAMES, 1, 1)) * sd[:, None, None]
    few = unequal(stations(), lasting.reshape(-1, DIMS), clips, FRAMES)
    assert 3 < few[clips[2]].mean() < 0.9 * 25
    assert (few[clips[2]] > few[clips[0]]).all()


def test_what_frames_share_misleads_by_its_share_however_many_they_are():
    """Of a mean over all samples: by `ALIGNED` of the misfit's size, and no less with more."""
    s = stations()
    rng = np.random.default_rng(7)
    s.residual[:] = 0.01 * rng.choice([-1.0, 1.0], s.residual.shape)
    lever = np.full((1, *s.residual.shape), 1 / s.residual.size)
    assert misled(s, lever, 0.0)[0] == pytest.approx(ALIGNED * 0.01)
    assert misled(s, lever, 0.03)[0] == pytest.approx(ALIGNED * 0.03)  # as elsewhere
    s.residual[s.bin > 0] = 0.0  # what is missed at one place misleads what looks there
    lever[:, s.bin > 0] = 0.0
    assert misled(s, lever, 0.0)[0] == pytest.approx(ALIGNED * 0.01 / BINS)


def test_what_is_beyond_the_sensors_noise_misleads():
    """The noise itself averages out, and is in the covariance."""
    s = stations()
    s.residual[:] = 1e-3 * np.random.default_rng(8).choice([-1.0, 1.0], s.residual.shape)
    lever = np.full((1, *s.residual.shape), 1 / s.residual.size)
    assert misled(s, lever, 0.0, sensor=0.8e-3)[0] == pytest.approx(ALIGNED * 0.6e-3)
    assert misled(s, lever, 0.0, sensor=1.1e-3)[0] == 0.0
    assert misled(s, lever, 1.25e-3, sensor=1e-3)[0] == pytest.approx(ALIGNED * 0.75e-3)


def test_a_noise_far_above_the_sensors_is_a_misfit():
    assert Noise(marker=3e-3, sensor=1e-3).misfit
    assert not Noise(marker=1.2e-3, sensor=1e-3).misfit
    assert not Noise(marker=3e-3).misfit  # nothing else is known of the markers


def test_values_that_are_known_only_together_keep_their_covariance():
    """A covariance without full rank had no Cholesky factor."""
    axis = np.array([1.0, -2.0, 0.5])
    covariance = np.outer(axis, axis)
    names = ("curvature_1_at_0", "curvature_1_at_50", "curvature_1_at_100")
    terms = [PARAMETERS[name].term(rope(20), 0.0) for name in names]
    term = correlated("rest_curve", terms, covariance)
    np.testing.assert_allclose(term.root @ term.root.T, covariance, atol=1e-7)
    np.testing.assert_allclose(term.value(term.search(axis)), axis, atol=1e-3)


def test_of_a_noise_that_repeats_as_many_samples_count_as_are_independent():
    """What is as large as that noise inflates nothing, twice as large four times."""
    rng, many = np.random.default_rng(8), 25
    shared = np.repeat(rng.normal(size=4000), many) / np.sqrt(many)  # whitened by noise x repeats
    assert inflation_of_repeated(shared, many, 3) == pytest.approx(1.0, abs=0.1)
    assert inflation_of_repeated(2 * shared, many, 3) == pytest.approx(4.0, rel=0.1)
    assert inflation_of_repeated(0.5 * shared, many, 3) == 1.0
