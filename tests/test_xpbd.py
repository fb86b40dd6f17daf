"""Algorithm 1: constraints, boundary conditions, degenerate ropes, gradients, memory."""

import subprocess
import sys

import numpy as np
import pytest
import torch

from ropefit.models.algorithm import Algorithm
from ropefit.models.xpbd_rope import build_rope
from ropefit.rod.quaternion import normalise
from ropefit.rod.rod import uniform
from ropefit.rod.setup import bare
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.compiled import simulate_compiled
from ropefit.solvers.xpbd.jacobi import Jacobi
from ropefit.solvers.xpbd.reference import SOLVERS, Eta, State, simulate
from ropefit.solvers.xpbd.settings import Settings
from tests.conftest import ROOT
from tests.ropes import DOWN, ETA, GRAVITY, central_difference, eta, hanging

SOLVER_NAMES = sorted(SOLVERS)


def lengths(x):
    return (x[..., 1:, :] - x[..., :-1, :]).norm(dim=-1)


@pytest.mark.parametrize("name", SOLVER_NAMES)
def test_held_particles_and_frames_stay(name):
    start, rest, _ = hanging(held=(0, -1))
    held, held_q = torch.zeros(12, dtype=torch.bool), torch.zeros(11, dtype=torch.bool)
    held[[0, 5, -1]], held_q[[0, -1]] = True, True
    chain = Chain.build(held, held_q)
    state = simulate(start, rest, chain, eta(), SOLVERS[name], DOWN, Settings(3, 20))
    assert torch.equal(state.x[:, held], start.x[:, held])
    assert torch.allclose(state.q[:, held_q], normalise(start.q[:, held_q]), atol=1e-14)
    assert (state.x[:, 7] - start.x[:, 7]).norm() > 1e-3


def test_thomas_keeps_the_length_and_jacobi_does_not():
    """The paper's comparison: 2 % against 26.6 % of length."""
    start, rest, chain = hanging(nodes=20, apart=0.3)
    settings = Settings(10, 100)
    errors = {}
    for name in SOLVER_NAMES:
        x = simulate(start, rest, chain, eta(), SOLVERS[name], DOWN, settings).x
        errors[name] = float((lengths(x).sum(-1) - 1).abs().max())
    assert errors["thomas"] < 0.02
    assert errors["jacobi"] > 5 * errors["thomas"]


def test_thomas_alone_solves_the_distance_constraint():
    """With the distance constraint only, Newton on the chain reaches machine precision."""
    start, rest, chain = hanging()
    only = eta((1e-5, 1.95, 1e-9, 1e-9, 1e-9, 1.0))
    x = simulate(start, rest, chain, only, SOLVERS["thomas"], DOWN, Settings(1, 40)).x
    assert float((lengths(x) - rest.length).abs().max()) < 1e-10


def test_rope_with_a_free_end_ends_up_hanging_straight_down():
    start, rest, _ = hanging()
    held = torch.zeros(12, dtype=torch.bool)
    held[0] = True
    chain = Chain.build(held, torch.zeros(11, dtype=torch.bool))
    settings = Settings(4000, 5)
    x = simulate_compiled(start, rest, chain, eta(), SOLVERS["thomas"], DOWN, settings).x
    down = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)
    assert torch.allclose(x[:, -1] - x[:, 0], down.expand(3, 3), atol=0.002)


@pytest.mark.parametrize("name", SOLVER_NAMES)
def test_batch_rows_do_not_influence_each_other(name):
    start, rest, chain = hanging()
    settings = Settings(2, 15)
    together = simulate(start, rest, chain, eta(), SOLVERS[name], DOWN, settings)
    for t in range(3):
        one = State(start.x[t : t + 1], start.q[t : t + 1])
        alone = simulate(one, rest, chain, eta(), SOLVERS[name], DOWN, settings)
        assert torch.allclose(together.x[t], alone.x[0], atol=1e-13, rtol=0)


def degenerate(kind: str) -> State:
    """Ropes on which a careless formula divides by zero."""
    x = torch.zeros(1, 10, 3, dtype=torch.float64)
    line = torch.linspace(0, 1, 10, dtype=torch.float64)
    if kind == "straight":
        x[..., 0] = line
    elif kind == "vertical":
        x[..., 2] = -line
    elif kind == "folded":
        x[..., 2] = -(line - 0.5).abs()
    q = torch.zeros(1, 9, 4, dtype=torch.float64)
    q[..., 0] = 1.0
    return State(x, q)


@pytest.mark.parametrize("name", SOLVER_NAMES)
@pytest.mark.parametrize("kind", ["straight", "vertical", "folded", "coincident"])
@pytest.mark.parametrize("gravity_weight", [0.0, 0.04])
def test_degenerate_ropes_give_no_nan(name, kind, gravity_weight):
    start = degenerate(kind)
    _, rest, chain = hanging(nodes=10)
    weights = [torch.tensor(v, dtype=torch.float64) for v in (gravity_weight, *ETA[1:])]
    leaves = [v.clone().requires_grad_() for v in [*start, *weights]]
    state = simulate(
        State(*leaves[:2]), rest, chain, Eta(*leaves[2:]), SOLVERS[name], DOWN, Settings(3, 20)
    )
    assert torch.isfinite(state.x).all()
    assert torch.isfinite(state.q).all()
    gradients = torch.autograd.grad((state.x**2).sum(), leaves)
    assert all(torch.isfinite(g).all() for g in gradients)


@pytest.mark.parametrize("total", [10, 100, 500])
@pytest.mark.parametrize("name", SOLVER_NAMES)
@pytest.mark.parametrize("which", ["x", "q", "control", *Eta._fields])
def test_gradient_equals_central_difference(name, which, total):
    start, rest, chain = hanging(frames=1, nodes=9)
    settings = Settings(5, total // 5)
    target = start.x + 0.01
    generator = torch.Generator().manual_seed(2)

    def loss(value):
        x, q, weights = start.x, start.q, eta()
        if which == "x":
            x = value
        elif which == "q":
            q = value
        elif which == "control":
            x = torch.cat([value, x[:, 1:]], dim=1)
        else:
            weights = weights._replace(**{which: value})
        state = simulate(State(x, q), rest, chain, weights, SOLVERS[name], DOWN, settings)
        return ((state.x - target) ** 2).sum() + (state.q[..., 1] ** 2).sum()

    origin = {"x": start.x, "q": start.q, "control": start.x[:, :1]}.get(which)
    origin = getattr(eta(), which) if origin is None else origin
    direction = torch.randn(origin.shape, generator=generator, dtype=torch.float64)
    value = origin.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(loss(value), value)
    exact = float((gradient * direction).sum())
    scale = float(gradient.norm() * direction.norm())
    with torch.no_grad():
        numeric = central_difference(loss, origin, direction, 3e-5)
    # Relative to the size of the gradient: a random direction may be nearly across it.
    assert exact == pytest.approx(numeric, abs=1e-6 * scale)


MEMORY = """
import resource, torch
from ropefit.solvers.xpbd.compiled import simulate_compiled
from ropefit.solvers.xpbd.jacobi import Jacobi
from ropefit.solvers.xpbd.reference import SOLVERS, Eta, State, simulate
from ropefit.solvers.xpbd.settings import Settings
from tests.ropes import DOWN, ETA, hanging
start, rest, chain = hanging(frames=36, nodes=40)
weights = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in ETA]
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
state = simulate(start, rest, chain, Eta(*weights), SOLVERS["thomas"], DOWN, Settings(10, 100))
(state.x**2).sum().backward()
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def test_memory_of_a_long_gradient_is_bounded():
    """36 frames, 40 particles, 1000 iterations: far under 2 GB."""
    run = subprocess.run(
        [sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert float(run.stdout) < 500


def test_a_solver_that_is_not_compiled_runs_on_the_reference_loops(monkeypatch):
    class Again(Jacobi):
        name = "again"

    monkeypatch.setitem(SOLVERS, "again", Again())
    ends = np.array([[[0.0, 0, 0], [0.4, 0, 0]]])
    free = np.full((1, 2, 4), np.nan)
    rope = uniform(length=0.6, segments=8, bend=1.0)
    setup = bare(rope, GRAVITY, ends, free, np.zeros(3))
    ropes = [build_rope(setup, Algorithm(name, Settings(3, 10))) for name in ("jacobi", "again")]
    compiled, again = (rope.settle(torch.tensor(ETA)).x for rope in ropes)
    assert float((compiled - ropes[0].start.x).abs().max()) > 1e-4
    assert torch.allclose(compiled, again, rtol=0, atol=1e-12)
