"""The noise of markers in static poses, and what is not flattened on the strength of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ropefit
from ropefit.artifacts import Observations
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.full_scan import sensitivities
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.wander import no_larger_than_left
from ropefit.effects import PointMass
from ropefit.errors import BadInput
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.perception.markers import marker_noise
from tests.concealed import BINS, EYE, rope
from tests.factories import edit, write_manifest

ARC = np.linspace(0, 1, 13)
NOISE = 3e-4


def poses(count: int, depth: float = 0.02, repeats: int = 1) -> np.ndarray:
    """(F, 13, 3) [m] different static poses, bent out of the plane by `depth`, with noise."""
    rng = np.random.default_rng(5)
    shapes = []
    for _ in range(count):
        sag, side = rng.uniform(0.2, 0.35), depth * rng.uniform(0.8, 1.2)
        bump = rng.uniform(-0.03, 0.03)
        x = (0.7 + 0.1 * sag) * ARC + bump * np.sin(2 * np.pi * ARC)
        y = 1.4 * side * np.sin(2 * np.pi * ARC)
        z = -4 * sag * ARC * (1 - ARC) + bump * np.sin(3 * np.pi * ARC)
        shapes += [np.stack([x, y, z], axis=1)] * repeats
    return np.array(shapes) + rng.normal(0, NOISE, (count * repeats, 13, 3))


@pytest.mark.parametrize(("count", "repeats"), [(12, 1), (3, 1), (4, 5)])
def test_static_poses(count: int, repeats: int) -> None:
    seen = poses(count, repeats=repeats)
    found, how, known = marker_noise(seen, np.arange(len(seen), dtype=float), ARC)
    assert 0.7 * NOISE < found < 1.6 * NOISE
    assert "upper bound" in how
    assert not known


def test_repeated_frames_measure_it_where_no_curve_does() -> None:
    kinked = poses(6, repeats=4)
    kinked[:, 7:, 0] += 0.05 * np.array([1, -1, 1, -1, 1, -1])
    found, how, _ = marker_noise(kinked, np.arange(24.0), ARC)
    assert how.startswith("slowest consecutive frames")
    assert found == pytest.approx(NOISE, rel=0.3)


def test_a_prior_counts_and_real_depth_stays(tmp_path: Path) -> None:
    where = tmp_path / "r"
    where.mkdir()
    write_manifest(where, '[markers]\nfile = "m.npz"', "", "markers = [[0], [-1]]")
    seen = poses(5)
    np.savez(where / "m.npz", positions=seen, time=np.arange(5.0), arc_length=1.1 * ARC)
    observations = ropefit.preprocess(where, nodes=10)
    assert not observations.projected
    assert observations.noise.max() < 2 * NOISE
    with (where / "recording.toml").open("a") as file:
        file.write("[priors]\nmarker_noise = 0.0004\n")
    told = ropefit.preprocess(where, nodes=10)
    assert told.noise == pytest.approx(4e-4)
    assert told.noise_source == "[priors] marker_noise"
    edit(where / "recording.toml", "0.0004", "-1.0")
    with pytest.raises(BadInput, match="marker_noise"):
        ropefit.preprocess(where)


@pytest.mark.parametrize(("mass", "stated"), [(0.0, 1.7e-3), (0.004, 3e-3), (0.0, 2e-4)])
def test_noise_is_not_above_what_is_left(mass: float, stated: float) -> None:
    """Of what preprocess states as an upper bound; a true one stays."""
    setup = PointMass().apply(rope(288), np.array([mass, 0.4]))
    seen = Equilibrium(setup, []).at(np.empty(0)).seen[:, ::24]
    seen = seen + np.random.default_rng(8).normal(0, NOISE, seen.shape)
    share = np.broadcast_to(ARC, seen.shape[:2])
    data = Data(seen, share, np.ones(share.shape, bool), True, np.array(EYE))
    coarse = rope(144, bend=3e-4)
    forward = Equilibrium(coarse, [PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0))])
    nominal = fit(forward, FitProblem(data, Noise(marker=stated), BINS))
    scanned = sensitivities(nominal, [], ("point_mass", "stiff_section"))
    capped = no_larger_than_left(nominal.problem.noise, nominal, scanned).marker
    if mass:  # the scan is of first order; what is accepted is fitted in full
        assert capped < stated
        hypothesis = Hypothesis(PointMass(), NO_PLACE)
        found = fit_candidate(nominal, hypothesis, np.array([0.003, 0.42]))
        assert found is not None
        capped = no_larger_than_left(Noise(marker=capped), found.fit, []).marker
    assert capped == pytest.approx(min(stated, NOISE), rel=0.25)


def weighted(where: Path, markers: int) -> Path:
    """A recording of static poses of a rope with a weight, in any order."""
    where.mkdir()
    write_manifest(where, '[markers]\nfile = "m.npz"', "length = 1.0\nmass = 0.06")
    rng, fine = np.random.default_rng(3), rope(192)
    setup = PointMass().apply(fine, np.array([0.006, 0.4]))
    order = rng.permutation(len(setup.ends))
    at = np.round(192 * np.linspace(0.08, 0.92, markers)).astype(int)
    seen = Equilibrium(setup, []).at(np.empty(0)).seen[order][:, at]
    seen = seen + NOISE * rng.normal(size=seen.shape)
    np.savez(where / "m.npz", positions=seen, time=2.0 * np.arange(len(seen)), arc_length=at / 192)
    rows = ["frame,time,end,x,y,z"]
    for frame, ends in enumerate(setup.ends[order].tolist()):
        rows += [f"{frame},{2 * frame},{k}," + ",".join(map(str, ends[k])) for k in (0, 1)]
    (where / "ends.csv").write_text("\n".join(rows) + "\n")
    return where


@pytest.mark.parametrize("markers", [7, 12])
def test_the_noise_is_no_larger_than_what_is_left(markers: int, tmp_path: Path) -> None:
    """Through all stages. Few markers bound it badly: the bends between them count as well. The
    diagnosis says it as it is, whatever the bound and although the nominal rope misses the weight.
    """
    observations = ropefit.preprocess(weighted(tmp_path / "r", markers), nodes=12)
    bound = float(np.median(observations.noise))
    assert bound > 1.5 * NOISE
    found = ropefit.diagnose(observations, ropefit.fit(observations))
    assert [cause.name for cause in found.causes.values()] == ["point_mass"]
    assert found.rms_before > 5 * found.rms_after
    assert found.noise_white <= found.rms_after
    assert found.noise_white == pytest.approx(3**0.5 * NOISE, rel=0.15)


@pytest.mark.parametrize(
    ("frames", "markers", "seconds"), [(60, 13, 0.01), (60, 13, 1.0), (3, 3, 1.0)]
)
def test_what_is_told_of_the_noise_says_whether_it_was_measured(frames, markers, seconds):
    rng, time = np.random.default_rng(1), seconds * np.arange(frames)
    positions = poses(1)[0][:markers] + rng.normal(0, NOISE, (frames, markers, 3))
    _, source, measured = marker_noise(positions, time, ARC[:markers])
    assert Observations.model_construct(noise_source=source).noise_bounded is not measured
