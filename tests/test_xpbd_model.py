"""The paper's simulation is a model like the others: predictions, derivatives, fits."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ropefit.effects import CATALOGUE
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.inference.profile import profile_intervals
from ropefit.models.algorithm import Algorithm
from ropefit.models.parameters import Parameter
from ropefit.models.response import Point
from ropefit.models.weights import ETA, WEIGHTS
from ropefit.models.xpbd import Xpbd
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare
from ropefit.solvers.xpbd.settings import Settings
from tests.ropes import ETA as USUAL
from tests.ropes import GRAVITY

NONE = np.empty(0)


def hanging(frames: int = 5, nodes: int = 13) -> Setup:
    """Return a 1 m rope between pinned ends, 0.5 to 0.85 m apart, with usual weights."""
    ends = np.zeros((frames, 2, 3))
    ends[:, 1, 0] = np.linspace(0.5, 0.85, frames)
    ends[:, 1, 2] = 0.05
    free = np.full((frames, 2, 4), np.nan)
    rope = uniform(length=1.0, segments=nodes - 1, bend=1.0)
    eye = np.array([0.4, -1.5, 0.0])
    return bare(rope, GRAVITY, ends, free, eye)._replace(weights=np.array(USUAL))


def model(setup: Setup, *free: str, start: dict[str, float] | None = None) -> Xpbd:
    terms = [WEIGHTS[name].term(setup, (start or {}).get(name)) for name in free]
    return Xpbd(setup, terms, algorithm=Algorithm("thomas", Settings(5, 20)))


def test_weights_are_rows_of_the_table_of_parameters():
    setup = hanging()
    for place, name in enumerate(ETA):
        assert isinstance(WEIGHTS[name], Parameter)
        changed = WEIGHTS[name].apply(setup, np.array([0.123]))
        assert changed.weights[place] == 0.123
        assert setup.weights[place] == USUAL[place]


def test_a_prediction_is_that_of_the_algorithm():
    setup = hanging()
    point = model(setup).at(NONE)
    rope = model(setup).rope_at(setup)
    weights = torch.from_numpy(setup.weights).expand(5, -1)
    assert np.array_equal(point.seen, rope.settle(weights).x.numpy())
    assert point.converged.all()


def test_derivatives_by_weights_are_those_of_autograd():
    setup = hanging()
    found = model(setup, *ETA, start=dict(zip(ETA, USUAL, strict=True)))
    jacobian = found.jacobian(found.at(found.start()))
    weights = torch.tensor(setup.weights, requires_grad=True)
    x = found.rope_at(setup).settle(weights.expand(5, -1)).x
    way = torch.from_numpy(np.random.default_rng(1).normal(size=x.shape))
    (gradient,) = torch.autograd.grad((x * way).sum(), weights)
    by_logarithm = (gradient * weights).detach().numpy()
    mine = (jacobian * way.numpy()).sum(axis=(1, 2, 3))
    np.testing.assert_allclose(mine, by_logarithm, rtol=2e-5, atol=1e-7)


@pytest.mark.parametrize("name", ["gravity_misalignment", "scale_error", "end_offset"])
def test_errors_of_the_set_up_act_on_it_and_rigidity_does_not(name):
    setup = hanging()
    point = model(setup).at(NONE)

    def moved(effect: str) -> float:
        kind = next(kind for kind in CATALOGUE if kind.name == effect)(0)
        k = len(kind.quantities)
        place = np.full(len(kind.names) - k, 0.5)
        sizes = [q.size(setup) for q in kind.quantities]

        def changed(step: float) -> Setup:
            values = np.concatenate([step * np.array(sizes), place])
            return kind.apply(setup, values)

        return float(np.abs(point.respond([changed])).max())

    assert moved(name) > 1e-4
    assert moved("axial_extensibility") == 0.0


def test_a_rest_curve_bends_it():
    setup = hanging()
    bent = setup.properties.curvature + np.array([0.0, 1.5, 0.0])
    curved = setup._replace(properties=setup.properties._replace(curvature=bent))
    straight, other = (model(s).at(NONE).seen for s in (setup, curved))
    assert np.abs(other - straight).max() > 1e-3


def test_a_frame_that_diverges_is_marked_and_the_others_stay():
    setup = hanging()
    weights = np.tile(setup.weights, (5, 1))
    weights[2] = [0.04, 60.0, 60.0, 60.0, 60.0, 1.5]
    point: Point = model(setup._replace(weights=weights)).at(NONE)
    assert point.converged.tolist() == [True, True, False, True, True]
    assert np.isnan(point.seen[2]).any()
    kept = np.array([0, 1, 3, 4])
    assert np.array_equal(point.seen[kept], model(setup).at(NONE).seen[kept])
    some = setup._replace(weights=weights).frames(kept)
    assert model(some).at(NONE).converged.all()


def test_least_squares_recover_weights():
    """The fits of the other models take it as it is: two weights within their intervals."""
    setup, sigma = hanging(frames=8), 1e-4
    free, truth = ("eta_x_G", "eta_q_B"), {"eta_x_G": 0.04, "eta_q_B": 0.6}
    x = model(setup).at(NONE).seen
    x = x + np.random.default_rng(7).normal(0, sigma, x.shape)
    share = np.broadcast_to(np.linspace(0, 1, x.shape[1]), x.shape[:2])
    data = Data(x, share, np.ones(x.shape[:2], dtype=bool), True, np.array([0.4, -1.5, 0.0]))
    problem = FitProblem(data, Noise(marker=sigma), 40)
    begun = model(setup, *free, start={"eta_x_G": 0.06, "eta_q_B": 0.4})
    found = fit(begun, problem)
    assert found.converged
    assert 0.7 < found.scale < 1.3
    estimates = profile_intervals(found).of
    for name, true in truth.items():
        assert estimates[name].verdict == "determined"
        low, high = estimates[name].interval
        assert low < true < high
        assert high / low < 1.5
