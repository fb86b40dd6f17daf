"""A solver that stops early is told from a rope that stretches, by the shapes that it leaves."""

import numpy as np
import pytest
import torch

from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.search import search
from ropefit.effects import AxialExtensibility, UnderConverged
from ropefit.models.equilibrium import Equilibrium
from ropefit.rod.setup import Setup
from ropefit.rod.strains import straight_rest
from ropefit.solvers.equilibrium.start import frames_along, hanging_shape
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.reference import SOLVERS, Eta, Settings, State, simulate
from tests.concealed import nominal_fit, recorded, rope, scanned, with_effect

DOWN = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)


def hanging(nodes: int, frames: int = 12) -> np.ndarray:
    """(F, K, 3) [m] catenaries through the ends of the test rope."""
    free, gravity = np.full((2, 3), np.nan), np.array([0.0, 0.0, -9.81])
    ends = rope(20, frames).ends
    return np.stack([hanging_shape(1.0, nodes, gravity, e, free) for e in ends])


def papers(nodes: int, iterations: int, drop: float, eta: tuple[float, ...]) -> np.ndarray:
    """(F, K, 3) [m] Algorithm 1 in its readable version, one step."""
    x = hanging(nodes)
    held = torch.zeros(nodes, dtype=torch.bool)
    held[[0, -1]] = True
    chain = Chain.build(held, torch.zeros(nodes - 1, dtype=torch.bool))
    weights = Eta(*(torch.tensor(v, dtype=torch.float64) for v in (2 * drop, *eta)))
    start = State(torch.from_numpy(x), torch.from_numpy(frames_along(x)))
    return simulate(
        start, straight_rest(1.0, nodes), chain, weights, SOLVERS["jacobi"], DOWN,
        Settings(1, iterations, dt=1.0),
    ).x.numpy()  # fmt: skip


def test_all_of_it_is_the_shape_that_algorithm_1_stops_at():
    setup, drop, count = rope(76), 0.01, 25
    values = np.array([1.0, drop, count**0.5 / 19])
    found = Equilibrium(UnderConverged().apply(setup, values), []).at(np.empty(0)).seen[:, ::4]
    wanted = papers(20, count, drop, (1.0,) * 5)
    assert np.abs(wanted - hanging(20)).max() > 0.01
    assert np.abs(found - wanted).max() < 3e-4


def test_what_is_kept_is_of_the_same_rope_and_the_same_iterations():
    setup, values = rope(76), np.array([0.1, 0.01, 0.7])
    drift = lambda s, v: UnderConverged().apply(s, v).sensor.drift  # noqa: E731
    first = drift(setup, values)
    # What the iterations begin with, bring down, and how often.
    others = [
        drift(setup._replace(ends=0.9 * setup.ends), values),
        drift(setup._replace(gravity=setup.gravity[::-1]), values),
        *(drift(setup, values * np.array(f)) for f in ([1, 2, 1], [1, 1, 2])),
    ]
    assert all(np.abs(other - first).max() > 1e-4 for other in others)
    assert np.array_equal(drift(setup, values * np.array([3.0, 1.0, 1.0])), first)


@pytest.mark.parametrize("moved", ["end", "length", "gravity"])
@pytest.mark.parametrize(("amount", "error"), [(1.0, 1e-3), (0.1, 0.05), (0.01, 0.005)])
def test_a_step_of_a_difference_changes_what_is_seen_as_the_iterations_would(moved, amount, error):
    """What a small amount of them hardly changes moves with the catenary."""

    def at(step: float) -> Setup:
        setup = rope(76)
        if moved == "end":
            ends = setup.ends.copy()
            ends[:, 1] += step * np.array([1.0, 0.0, 0.5])
            return setup._replace(ends=ends)
        if moved == "length":
            longer = setup.properties.length * (1 + step)
            return setup._replace(properties=setup.properties._replace(length=longer))
        return setup._replace(gravity=setup.gravity + step * np.array([0.0, 9.81, 0.0]))

    def seen(step: float) -> np.ndarray:
        setup = UnderConverged().apply(at(step), np.array([amount, 0.005, 0.8]))
        return Equilibrium(setup, []).at(np.empty(0)).seen

    here = seen(0.0)
    found = (seen(1e-5) - here) / 1e-5
    wanted = (seen(5e-4) - here) / 5e-4  # too far to be a step
    assert np.abs(found - wanted).max() < (error + 2e-3) * np.abs(wanted).max()


def test_a_solver_that_stopped_early_is_named():
    shapes = papers(20, 100, 0.0127, (1.19, 0.8, 1.19, 0.8, 0.79))  # the paper's weights
    data = scanned(shapes, seed=4)
    one = Rules(most_effects=1)  # beside it pairs of all kinds would be compared, for minutes
    d = search(nominal_fit(data), 0, lambda share, text: None, one)
    assert d.verdict == "found"
    assert d.accepted[0].candidate.hypothesis.name == "under_converged"


def test_a_rope_that_stretches_is_no_solver_that_stopped():
    data = recorded(with_effect(AxialExtensibility(), [0.06]), seed=1)
    d = search(nominal_fit(data), 0, lambda share, text: None)
    candidate = d.accepted[0].candidate
    assert candidate.hypothesis.name == "axial_extensibility"
    assert abs(candidate.values()[0] - 0.06) < 4 * candidate.sd()[0]
