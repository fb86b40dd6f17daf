"""Diagnosis in motion: derivatives through a clip's start, noise that wanders, a weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.acceptance import _allowed_for
from ropefit.diagnosis.held_out import block_of_rows, predicted
from ropefit.diagnosis.search import search
from ropefit.effects import Effect, PointMass, Tether
from ropefit.effects.gravity_misalignment import GravityMisalignment
from ropefit.inference.bins import Data
from ropefit.inference.discrepancy import repeats_in
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.dynamics import Dynamics
from ropefit.models.grips import grips
from ropefit.models.parameters import terms
from ropefit.models.priors import nuisance
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.moving import Damping
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare

LENGTH, WEIGHT, EI, FRAMES, STEP = 0.9, 0.08, 1.5e-3, 90, 0.01
DOWN = np.array([0.0, 0.0, -9.81])
FREE = ("EI", "bend_damping", "air_damping")


def driven(segments: int, clips: int = 2) -> Setup:
    """A clamped rope whose one end is shaken, differently in each clip."""
    p = uniform(length=LENGTH, segments=segments, bend=EI, twist=EI, density=WEIGHT / LENGTH)
    time = np.arange(FRAMES) * STEP
    grow = np.minimum(time / 0.3, 1) ** 2
    ends = np.zeros((clips * FRAMES, 2, 3))
    ends[:, 1] = [0.55, 0.05, 0.1]
    for k in range(clips):
        sway = [
            0.08 * np.sin((5 + k) * time),
            0.1 * np.sin((7 - k) * time),
            0.05 * np.sin(9 * time),
        ]
        ends[k * FRAMES : (k + 1) * FRAMES, 0] = grow[:, None] * np.stack(sway, 1)
    level = np.stack([quaternion_along(np.array(v)) for v in ((1.0, 0, -1), (1.0, 0, 1))])
    clamp = np.tile(level, (len(ends), 1, 1))
    loss = Damping(*(np.full(segments, v) for v in (1e-4, 1e-4, 0.0, 0.03)))
    setup = bare(p, DOWN, ends, clamp, np.array([0.0, -2.0, 0.0]))
    return setup._replace(damping=loss)


def model(setup: Setup, lines: np.ndarray, free: tuple[str, ...] = ()) -> Dynamics:
    clips = np.split(np.arange(len(setup.ends)), len(setup.ends) // FRAMES)
    time = np.concatenate([np.arange(FRAMES) * STEP + 10 * k for k in range(len(clips))])
    every = setup.segments // (lines.shape[1] - 1)
    parts = [*terms(setup, free), *grips(setup, 1.0)] if free else []
    return Dynamics(setup, parts, time=time, clips=clips, observed=lines, every=every)


def recorded(
    effect: Effect | None, values: list[float], seed: int, segments: int = 48
) -> tuple[np.ndarray, Data]:
    """Centrelines at 13 places and markers with noise, of a rope twice as fine as is fitted."""
    setup = driven(segments)
    if effect:
        setup = effect.apply(setup, np.array(values))
    still = np.linspace(setup.ends[:, 0], setup.ends[:, 1], 13, axis=1)
    still[:, :, 2] -= 0.3 * np.sin(np.linspace(0, np.pi, 13))
    x = model(setup, still).at(np.empty(0)).seen[:, :: segments // 12]
    rng = np.random.default_rng(seed)
    lines = x + 2e-4 * rng.normal(size=x.shape)
    share = np.broadcast_to(np.linspace(0, 1, 13), lines.shape[:2]).copy()
    mask = np.zeros(lines.shape[:2], dtype=bool)
    mask[::4, 1:-1] = True
    return lines, Data(lines, share, mask, True, np.array([0.0, -2.0, 0.0]))


def test_derivatives_reach_through_the_first_state():
    lines, _ = recorded(None, [], seed=0)
    forward = model(driven(24), lines, (*FREE, "length"))
    u = forward.start()
    point = forward.at(u)
    assert point.converged.all()
    jacobian = forward.jacobian(point)
    step = 1e-4
    for k in (0, 1, 3, 5):
        sides = [forward.at(u + side * step * np.eye(len(u))[k]).seen for side in (-1, 1)]
        expected = (sides[1] - sides[0]) / (2 * step)
        scale = np.abs(expected).max()
        assert scale > 1e-6
        assert np.abs(jacobian[k] - expected).max() < 2e-3 * scale


def test_steps_are_no_longer_than_5_ms():
    lines, _ = recorded(None, [], seed=0)
    forward = model(driven(24), lines)
    assert {run.fine for run in forward.at(np.empty(0)).runs} == {2}
    forward.time = 0.4 * forward.time
    assert {run.fine for run in forward.at(np.empty(0)).runs} == {1}


def test_an_error_of_the_set_up_counts_as_allowed_for_only_where_a_fit_has_it():
    lines, data = recorded(None, [], seed=0)
    forward = model(driven(24), lines, ("EI",))
    at_start = fit(forward, FitProblem(data, Noise(marker=0.002), 40), None, 1, tolerance=1.0)
    assert not _allowed_for(GravityMisalignment(), at_start)
    gravity = nuisance("gravity", ["x", "y"], ["rad"] * 2, GravityMisalignment().apply, [0.01] * 2)
    with_it = replace(at_start, forward=forward.with_terms([*forward.terms, gravity]))
    assert _allowed_for(GravityMisalignment(), with_it)


@pytest.mark.parametrize(("keep", "expected"), [(0.0, 1.0), (0.9, 19.0)])
def test_samples_that_wander_count_once(keep, expected):
    """Of an autoregressive process, (1 + keep) / (1 - keep) samples are worth one."""
    rng = np.random.default_rng(1)
    frames, markers = 4000, 8
    noise = rng.normal(size=(frames, markers, 3))
    for t in range(1, frames):
        noise[t] = keep * noise[t - 1] + np.sqrt(1 - keep**2) * noise[t]
    lines = np.broadcast_to(np.linspace(0, 1, 9)[:, None] * [1.0, 0, 0], (frames, 9, 3)).copy()
    share = np.broadcast_to(np.linspace(0.1, 0.9, markers), (frames, markers)).copy()
    data = Data(
        np.zeros((frames, markers, 3)), share, np.ones((frames, markers), bool), True, np.zeros(3)
    )
    stations = FitProblem(data, Noise(marker=1.0), 1).match(lines)
    found = repeats_in(stations, noise.reshape(-1, 3), [np.arange(frames)])
    assert found == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize("effect", [None, PointMass()])
def test_a_weight_on_a_moving_rope_is_named(effect):
    lines, data = recorded(effect, [0.012, 0.36], seed=3)
    forward = model(driven(24), lines, FREE)
    nominal = fit(forward, FitProblem(data, Noise(marker=0.002), 40), None, 15, tolerance=1e-4)
    d = search(nominal, 0, lambda share, text: None)
    if effect is None:
        assert d.verdict == "none"
        return
    assert d.verdict == "found"
    found = d.accepted[0].candidate
    assert found.hypothesis.name == "point_mass"
    mass, place = found.values()
    assert mass == pytest.approx(0.012, rel=0.15)
    assert place == pytest.approx(0.36, abs=0.02)


def test_a_thread_that_pulls_a_moving_rope_is_named():
    lines, data = recorded(Tether(), [0.25, 0.05, 0.04, -0.08, 0.4], seed=3)
    forward = model(driven(24), lines, FREE)
    nominal = fit(forward, FitProblem(data, Noise(marker=0.002), 40), None, 15, tolerance=1e-4)
    found = search(nominal, 0, lambda share, text: None).accepted[0].candidate
    assert found.hypothesis.name == "tether"
    stiffness, *_, place = found.values()
    assert stiffness == pytest.approx(0.25, rel=0.3)
    assert place == pytest.approx(0.4, abs=0.02)


def test_held_out_clips_are_predicted_as_a_fit_to_the_others_predicts_them():
    """Against fits from which each part of a clip was really left out."""
    lines, data = recorded(None, [], 4)
    setup = driven(24)
    forward, problem = model(setup, lines, FREE), FitProblem(data, Noise(marker=5e-4), 12)
    found = fit(forward, problem, forward.start(), 8, tolerance=1e-5)
    mine, block = predicted(found), block_of_rows(found, False)
    frame, true = np.repeat(found.stations.frame, 3), np.empty_like(mine)
    for number in np.unique(block):
        gone = np.isin(np.arange(len(setup.ends)), frame[block == number])
        others = fit(forward, problem.without(gone), found.point.u, 8, tolerance=1e-5)
        whole = found.whitener(problem.match(others.point.seen).residual)
        true[block == number] = whole[block == number]
    gap, change = (np.linalg.norm(v - true) for v in (mine, found.z))
    assert gap < 0.5 * change
