"""A bar that is touched in some frames: looked for in a model of the other frames."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.diagnosis.calm import calm, excess, pushes
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.proposals import proposals
from ropefit.diagnosis.unexplained import unexplained
from ropefit.effects import Obstacle
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from tests.concealed import BINS, nominal_fit, recorded, rope

BAR = [0.069, -0.005, -0.3, 0.015, 0.073]


def fitted(data):
    """The nominal model, with the white noise of the data."""
    nominal = nominal_fit(data)
    problem = FitProblem(data.settled(nominal.point.seen), Noise(), BINS)
    white = problem.match(nominal.point.seen).scatter[0]
    problem = problem.under(Noise(white=(float(white[0]), float(white[1]))))
    return fit(nominal.forward, problem, nominal.point.u)


def worst(found) -> float:
    """The largest calibration error, in prior standard deviations."""
    held = found.prior.held
    return float(np.abs(found.point.u[held] / found.prior.sd[held]).max())


def test_a_bar_is_found_where_it_pushes():
    free = rope(288)
    there = Obstacle().apply(free, np.array(BAR))
    moved = Equilibrium(there, []).at(np.empty(0)).seen - Equilibrium(free, []).at(np.empty(0)).seen
    touched = np.abs(moved).max(axis=(1, 2)) > 1e-3
    assert 2 <= touched.sum() <= 5
    nominal = fitted(recorded(there, seed=101))
    assert worst(nominal) > 4  # the calibration gives way to it
    quiet = calm(nominal)
    assert worst(quiet) < 1
    assert calm(nominal) is quiet  # made once
    np.testing.assert_array_equal(excess(quiet) > 10, touched)
    first = pushes(quiet)[0]
    assert abs(first.force[2]) == np.abs(first.force).max()
    ((hypothesis, start), *_) = next(
        p for p in proposals(nominal, slow=True) if p[0][0].name == "obstacle"
    )
    assert np.hypot(start[0] - BAR[0], start[2] - BAR[2]) < 0.04
    candidate = fit_candidate(nominal, hypothesis, start)
    assert candidate is not None
    assert candidate.evidence > 100
    assert unexplained(candidate.fit) < 0.05 * unexplained(nominal)
    values = candidate.values()
    assert values[[0, 2]] == pytest.approx([BAR[0], BAR[2]], abs=0.01)
    assert 0.005 < values[3] < 0.03


def test_a_model_of_frames_that_are_alike_is_calm_as_it_is():
    nominal = fitted(recorded(rope(288), seed=102))
    assert calm(nominal) is nominal
    assert pushes(nominal) == []
