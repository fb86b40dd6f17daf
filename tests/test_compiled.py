"""The compiled Algorithm 1 against its reference in torch, and its derivative."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor

from ropefit.rod.quaternion import from_rotation_vector, multiply, transport
from ropefit.rod.strains import Rest, straight_rest
from ropefit.solvers.xpbd import loops
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.compiled import simulate_compiled
from ropefit.solvers.xpbd.reference import SOLVERS, Eta, State, simulate
from ropefit.solvers.xpbd.settings import Settings

GRAVITY = torch.tensor([0.3, -0.2, -9.81], dtype=torch.float64)
LENGTH = 1.2
COMPLIANT = Settings(3, 8, alpha_shear=20.0, alpha_bend=0.3, alpha_distance=0.2)

solvers = pytest.mark.parametrize("solver", ["jacobi", "thomas"])


@dataclass
class Case:
    """Arguments of simulate; `inputs` are the differentiable ones: x, q and the six η."""

    inputs: list[Tensor]
    rest: Rest
    chain: Chain
    solver: str
    settings: Settings

    def run(self, function, inputs: list[Tensor] | None = None) -> State:
        x, q, *eta = self.inputs if inputs is None else inputs
        solver = SOLVERS[self.solver]
        start = State(x, q)
        return function(start, self.rest, self.chain, Eta(*eta), solver, GRAVITY, self.settings)

    def gradients(self, function) -> tuple[State, list[Tensor]]:
        """The result, and the gradients of a fixed sum of its entries with odd weights."""
        leaves = [item.detach().clone().requires_grad_() for item in self.inputs]
        state = self.run(function, leaves)
        return state, list(torch.autograd.grad(measure(state), leaves))


def measure(state: State) -> Tensor:
    total = torch.zeros((), dtype=torch.float64)
    for item in state:
        odd = torch.arange(item.numel(), dtype=torch.float64).sin().reshape(item.shape)
        total = total + (odd * item).sum()
    return total


def hanging(
    solver: str = "jacobi",
    settings: Settings | None = None,
    *,
    ropes: tuple[int, ...] = (3,),
    nodes: int = 9,
    held: tuple[int, ...] = (0, -1),
    held_q: tuple[int, ...] = (),
    bent: bool = True,
    two_sided: bool = False,
    seed: int = 0,
) -> Case:
    """Slack, smooth, twisted ropes in space with random weights."""
    random = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=random, dtype=torch.float64)

    s = torch.linspace(0, 1, nodes, dtype=torch.float64)[:, None]
    wave = sum(normal(*ropes, 1, 3) * 0.1 / n * torch.sin(n * math.pi * s) for n in (1, 2, 3))
    sag = torch.cat([0.75 * s, 0.1 * s, -1.4 * s * (1 - s)], dim=-1)
    x = LENGTH * (sag + wave)
    edges = x[..., 1:, :] - x[..., :-1, :]
    frames = transport(edges / edges.norm(dim=-1, keepdim=True))
    twist = torch.zeros_like(edges)
    twist[..., 2] = 0.8 * s[1:, 0] + 0.1 * normal(*ropes, nodes - 1)
    q = multiply(frames, from_rotation_vector(twist))

    rest = straight_rest(LENGTH, nodes)
    if bent:
        darboux = from_rotation_vector(0.1 * normal(nodes - 2, 3))
        rest = Rest(rest.length * (1 + 0.1 * torch.sin(9 * s[1:, 0])), darboux)
    mask, mask_q = torch.zeros(nodes, dtype=torch.bool), torch.zeros(nodes - 1, dtype=torch.bool)
    mask[list(held)], mask_q[list(held_q)] = True, True
    middle = torch.tensor([0.04, 0.9, 0.8, 0.7, 0.6, 0.9], dtype=torch.float64)
    eta = list((middle * torch.exp(0.1 * normal(*ropes, 6)))[..., None, None].unbind(-3))
    if two_sided:
        side = torch.arange(nodes)[:, None] <= nodes // 2
        eta[0] = torch.where(side, eta[0], 1.7 * eta[0])
    chain = Chain.build(mask, mask_q)
    return Case([x, q, *eta], rest, chain, solver, settings or Settings(3, 8))


def relative(a: Tensor, b: Tensor) -> float:
    return ((a - b).norm() / b.norm().clamp_min(1e-300)).item()


def assert_same(case: Case) -> None:
    """Values to 1e-12, each gradient to 1e-9 of its size; NaN and infinity nowhere.

    Rounding of the largest gradient is allowed in all: where particles coincide, numbers of 1e12
    cancel in the gradient of the weights.
    """
    expected, expected_gradients = case.gradients(simulate)
    state, gradients = case.gradients(simulate_compiled)
    for found, wanted in zip(state, expected, strict=True):
        assert found.shape == wanted.shape
        assert (found - wanted).abs().max() < 1e-12
    rounding = 1e-14 * max(item.norm() for item in expected_gradients)
    for found, wanted, item in zip(gradients, expected_gradients, case.inputs, strict=True):
        assert found.shape == item.shape
        assert torch.isfinite(found).all()
        assert (found - wanted).norm() < 1e-9 * wanted.norm() + rounding


@solvers
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"settings": COMPLIANT},
        {"settings": COMPLIANT, "held": (0, 4, -1), "held_q": (0,), "two_sided": True},
        {"held": (2,), "held_q": (0, -1), "bent": False},
        {"held": (0,), "two_sided": True, "ropes": (2, 3)},
        {"settings": Settings(5, 30), "nodes": 20, "ropes": (2,)},
        {"nodes": 3, "held": (0,), "settings": COMPLIANT},
    ],
    ids=["plain", "compliant", "two-sided", "inner", "batch", "long", "three"],
)
def test_equals_reference(solver, options):
    assert_same(hanging(solver, **options))


def test_one_segment():
    """The solvers agree on it but for RIDGE; the reference of Thomas needs two segments."""
    case = hanging("jacobi", nodes=2, held=(0,), ropes=())
    assert_same(case)
    thomas = replace(case, solver="thomas").run(simulate_compiled)
    assert (thomas.x - case.run(simulate_compiled).x).abs().max() < 1e-8


@solvers
def test_signs_of_frames(solver):
    """q and -q are the same frame: some pairs take the other sign of the rest rotation."""
    case = hanging(solver, COMPLIANT)
    flip = torch.ones_like(case.inputs[1][..., :1])
    flip[..., ::3, :] = -1.0
    case.inputs[1] = case.inputs[1] * flip
    assert_same(case)


@solvers
def test_broadcast(solver):
    """One start and shared weights for many ropes: the gradients of what is shared are sums."""
    case = hanging(solver, COMPLIANT, ropes=(2, 3))
    case.inputs[0] = case.inputs[0][0]
    case.inputs[1] = case.inputs[1][:1, :1]
    case.inputs[3] = case.inputs[3][:, :1]
    case.inputs[7] = case.inputs[7][0, 0, 0, 0]
    expected, wanted = case.gradients(lambda *a: simulate(*_expanded(*a)))
    state, found = case.gradients(simulate_compiled)
    assert state.x.shape == (2, 3, 9, 3)
    assert state.q.shape == (2, 3, 8, 4)
    assert (state.x - expected.x).abs().max() < 1e-12
    assert all(relative(a, b) < 1e-9 for a, b in zip(found, wanted, strict=True))


def _expanded(start: State, *rest):
    return State(start.x.expand(2, 3, 9, 3), start.q.expand(2, 3, 8, 4)), *rest


def test_only_some_gradients():
    case = hanging()
    weight = case.inputs[3].clone().requires_grad_()
    inputs = [*case.inputs[:3], weight, *case.inputs[4:]]
    (found,) = torch.autograd.grad(case.run(simulate_compiled, inputs).x.sum(), [weight])
    (wanted,) = torch.autograd.grad(case.run(simulate, inputs).x.sum(), [weight])
    assert relative(found, wanted) < 1e-9
    assert not case.run(simulate_compiled).x.requires_grad


@solvers
@pytest.mark.parametrize("iterations", [10, 100, 500])
def test_derivative_is_that_of_the_result(solver, iterations):
    """Along a random direction in all inputs, against differences of fourth order."""
    settings = replace(COMPLIANT, steps=2, iterations=iterations // 2)
    case = hanging(solver, settings, two_sided=True, held_q=(0,))
    random = torch.Generator().manual_seed(1)
    directions = [
        item.abs().mean() * torch.randn(item.shape, generator=random, dtype=torch.float64)
        for item in case.inputs
    ]

    def value(h: float) -> float:
        moved = [item + h * d for item, d in zip(case.inputs, directions, strict=True)]
        return measure(case.run(simulate_compiled, moved)).item()

    h = 1e-4
    difference = (8 * (value(h) - value(-h)) - (value(2 * h) - value(-2 * h))) / (12 * h)
    _, gradients = case.gradients(simulate_compiled)
    slope = sum((g * d).sum().item() for g, d in zip(gradients, directions, strict=True))
    assert slope == pytest.approx(difference, rel=1e-6)


@solvers
def test_recording_in_blocks_changes_nothing(solver, monkeypatch):
    case = hanging(solver, Settings(3, 7, alpha_shear=20.0, alpha_distance=0.1))
    _, whole = case.gradients(simulate_compiled)
    monkeypatch.setattr(loops, "LONGEST_RECORD", 1)
    _, blocks = case.gradients(simulate_compiled)
    assert all(torch.equal(a, b) for a, b in zip(whole, blocks, strict=True))


@solvers
def test_threads_change_nothing(solver, monkeypatch):
    case = hanging(solver, ropes=(5,))
    monkeypatch.setattr("ropefit.runs.threads.processors", lambda: 3)
    found = []
    for threads in (1, 2, 3):
        monkeypatch.setenv("OMP_NUM_THREADS", str(threads))
        state, gradients = case.gradients(simulate_compiled)
        found.append([*state, *gradients])
    for other in found[1:]:
        assert all(torch.equal(a, b) for a, b in zip(found[0], other, strict=True))


def straight(solver: str, direction: tuple[float, float, float], stretch: float) -> Case:
    """Rope held at one end, exactly straight, particles `stretch` rest lengths apart."""
    case = hanging(solver, ropes=(2,), held=(0,), bent=False)
    along = torch.tensor(direction, dtype=torch.float64)
    s = torch.linspace(0, stretch * LENGTH, 9, dtype=torch.float64)[:, None]
    q = transport(along.expand(8, 3))
    case.inputs[0] = (s * along).expand(2, 9, 3)
    case.inputs[1] = q.expand(2, 8, 4)
    return case


@solvers
@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 0, 1), (0, 0, -1)], ids=["x", "up", "down"])
@pytest.mark.parametrize("stretch", [1.0, 0.9])
def test_straight_ropes(solver, direction, stretch):
    assert_same(straight(solver, direction, stretch))


@solvers
def test_no_gravity(solver):
    case = straight(solver, (1, 0, 0), 1.0)
    case.inputs[2] = torch.zeros_like(case.inputs[2])
    assert_same(case)
    state = case.run(simulate_compiled)
    assert (state.x - case.inputs[0]).abs().max() < 1e-12


@solvers
@pytest.mark.parametrize("every", [True, False])
def test_coincident_particles(solver, every):
    """Values as in the reference, gradients finite: they reach 1e12 where a direction is lost."""
    case = hanging(solver, Settings(1, 1), ropes=(2,))
    x = case.inputs[0].clone()
    x[:, 3] = x[:, 4]
    case.inputs[0] = torch.zeros_like(x) if every else x
    assert_same(case)
    case.settings = Settings(2, 5)
    state, gradients = case.gradients(simulate_compiled)
    assert all(torch.isfinite(item).all() for item in (*state, *gradients))


@solvers
def test_taut_rope_held_at_both_ends(solver):
    """Its tension is not determined, see RIDGE: finite, but no two roundings agree for Thomas."""
    case = straight(solver, (1, 0, 0), 1.0)
    mask = torch.zeros(9, dtype=torch.bool)
    mask[[0, -1]] = True
    case.chain = Chain.build(mask, torch.zeros(8, dtype=torch.bool))
    expected = case.run(simulate)
    state, gradients = case.gradients(simulate_compiled)
    assert (state.x - expected.x).abs().max() < (1e-12 if solver == "jacobi" else 1e-2)
    assert all(torch.isfinite(item).all() for item in gradients)


@solvers
def test_neighbours_held(solver):
    """Both ends of a segment held: nothing can move it, and nothing is divided by zero."""
    case = hanging(solver, held=(0, 1, -1), held_q=(0, 1))
    state, gradients = case.gradients(simulate_compiled)
    assert torch.equal(state.x[:, :2], case.inputs[0][:, :2])
    assert all(torch.isfinite(item).all() for item in (*state, *gradients))
    if solver == "thomas":
        assert_same(case)


@solvers
@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e200])
def test_a_rope_that_blows_up_is_alone(solver, bad):
    case = hanging(solver, ropes=(4,))
    state, gradients = case.gradients(simulate_compiled)
    case.inputs[0] = case.inputs[0].clone()
    case.inputs[0][2, 4, 1] = bad
    broken, broken_gradients = case.gradients(simulate_compiled)
    others = torch.tensor([0, 1, 3])
    for before, after in zip([*state, *gradients], [*broken, *broken_gradients], strict=True):
        assert torch.equal(before[others], after[others])
        assert torch.isnan(after[2]).all()


def test_weights_too_large_do_not_raise():
    case = hanging("thomas", Settings(10, 30), ropes=(4,))
    case.inputs[7] = torch.full_like(case.inputs[7], 50.0)
    state, gradients = case.gradients(simulate_compiled)
    assert state.x.shape == (4, 9, 3)
    assert gradients[0].shape == (4, 9, 3)


def test_indefinite_system_is_nan():
    """Negative compliance makes the pivots negative; the reference raises there."""
    case = hanging("thomas", Settings(1, 2, alpha_distance=-1.5))
    state, gradients = case.gradients(simulate_compiled)
    assert all(torch.isnan(item).all() for item in (*state, *gradients))


def test_start_is_left_alone():
    case = hanging()
    x, q = case.inputs[0].clone(), case.inputs[1].clone()
    case.gradients(simulate_compiled)
    assert torch.equal(x, case.inputs[0])
    assert torch.equal(q, case.inputs[1])


def test_unknown_solver():
    class Other:
        name = "other"

    case = hanging()
    x, q, *eta = case.inputs
    with pytest.raises(ValueError, match="other"):
        simulate_compiled(
            State(x, q), case.rest, case.chain, Eta(*eta), Other(), GRAVITY, case.settings
        )
