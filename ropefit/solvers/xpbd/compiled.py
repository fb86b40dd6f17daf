"""Algorithm 1 in compiled code: the results and gradients of `xpbd.simulate`, many times faster.

A rope of a batch does not see the others, so each runs through all its iterations alone, in memory
that fits the first cache; the derivative is the exact adjoint of the iterations, see `kernels/`.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.strains import TINY, Rest
from ropefit.solvers.arrays import in_threads
from ropefit.solvers.shapes import check_shapes
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.kernels import tables
from ropefit.solvers.xpbd.kernels.entries import pull_ropes, run_ropes
from ropefit.solvers.xpbd.reference import DistanceSolver, Eta, Settings, State
from ropefit.solvers.xpbd.thomas import RIDGE

# Iterations that the derivative records at once; longer runs are recorded in blocks of √n, which
# costs one more run. 5000 iterations of 40 particles are 35 MB, per thread.
COMPILED = ("jacobi", "thomas")
LONGEST_RECORD = 5000


def simulate_compiled(
    start: State,
    rest: Rest,
    chain: Chain,
    eta: Eta,
    solver: DistanceSolver,
    gravity: Tensor,
    settings: Settings,
) -> State:
    """Run Algorithm 1 from `start`, see `xpbd.simulate`.

    start.x (..., K, 3) [m]; eta.gravity broadcastable to (..., K, 1), the other η to (..., 1, 1).
    Differentiable, once, in the start and the η. A rope that blows up, or whose distance system is
    not positive definite, is NaN in result and gradient; the other ropes do not notice.
    """
    nodes = start.x.shape[-2]
    shape = np.broadcast_shapes(
        start.x.shape[:-2], start.q.shape[:-2], *(weight.shape[:-2] for weight in eta)
    )
    x = start.x.expand(*shape, nodes, 3).reshape(-1, nodes, 3)
    q = start.q.expand(*shape, nodes - 1, 4).reshape(-1, nodes - 1, 4)
    by_node = eta.gravity.expand(*shape, nodes, 1).reshape(-1, nodes)
    others = torch.stack([w.expand(*shape, 1, 1).reshape(-1) for w in eta[1:]], dim=-1)
    rod, options = build_rod(rest, chain, solver, gravity, settings)
    x, q = _Ropes.apply(x, q, by_node, others, rod, options)  # type: ignore[misc]
    return State(x.reshape(*shape, nodes, 3), q.reshape(*shape, nodes - 1, 4))


def build_rod(
    rest: Rest, chain: Chain, solver: DistanceSolver, gravity: Tensor, settings: Settings
) -> tuple[np.ndarray, tables.Options]:
    """Return the constants of the compiled loops: (K, ROD_COLUMNS), and the scalars.

    Raises ValueError for a solver that is not compiled.
    """
    if solver.name not in COMPILED:
        raise ValueError(f"no compiled version of the solver {solver.name!r}")
    thomas = solver.name == "thomas"
    length, weight, weight_q = (_array(t) for t in (rest.length, chain.weight, chain.weight_q))
    weight_sum = weight[1:] + weight[:-1]
    shear = weight_sum / length**2 + 4 * weight_q + settings.alpha_shear
    bend = weight_q[1:] + weight_q[:-1] + settings.alpha_bend
    distance = weight_sum + settings.alpha_distance
    fall = 0.5 * settings.dt**2 * _array(gravity)

    nodes = len(weight)
    rod = np.zeros((nodes, tables.ROD_COLUMNS))
    rod[:-1, tables.LENGTH] = length
    rod[:, tables.WEIGHT] = weight
    rod[:, tables.SHARE] = weight / _touching(nodes)
    rod[:, tables.SHARE_D] = weight if thomas else weight / _touching(nodes)
    rod[:-1, tables.WEIGHT_Q] = weight_q
    rod[:-1, tables.SHARE_Q] = weight_q / _touching(nodes - 1)
    rod[:-1, tables.DIAGONAL] = (
        distance * (1 + RIDGE) + RIDGE if thomas else np.maximum(distance, 1e-30)
    )
    rod[:-1, tables.INVERSE_SHEAR] = 1 / np.maximum(shear, 1e-30)
    rod[:-2, tables.INVERSE_BEND] = 1 / np.maximum(bend, 1e-30)
    rod[:, tables.FALL : tables.FALL + 3] = np.where(weight[:, None] > 0, fall, 0.0)
    rod[:-2, tables.DARBOUX : tables.DARBOUX + 4] = _array(rest.darboux)
    options = tables.Options(
        alpha_shear=float(settings.alpha_shear),
        alpha_bend=float(settings.alpha_bend),
        alpha_distance=float(settings.alpha_distance),
        tiny=TINY,
        thomas=thomas,
        iterations=settings.iterations,
        total=settings.total,
    )
    return rod, options


def _touching(n: int) -> np.ndarray:
    """Return (n,) how many of the n-1 links of a chain touch each of its n items."""
    links = np.full(n, 2.0)
    links[0] = links[-1] = 1.0
    return links


def _array(t: Tensor) -> np.ndarray:
    """Return a writable copy in one piece, which is what the kernels are compiled for."""
    return t.detach().to(torch.float64).clone(memory_format=torch.contiguous_format).numpy()


def _pack(x: Tensor, q: Tensor) -> np.ndarray:
    """Return (B, K, STATE_COLUMNS) of x (B, K, 3) and q (B, K-1, 4), the multipliers zero."""
    state = np.zeros((*x.shape[:-1], tables.STATE_COLUMNS))
    state[:, :, tables.X : tables.X + 3] = x.detach().numpy()
    state[:, :-1, tables.Q : tables.Q + 4] = q.detach().numpy()
    return state


def _unpack(state: np.ndarray) -> tuple[Tensor, Tensor]:
    x = state[:, :, tables.X : tables.X + 3]
    q = state[:, :-1, tables.Q : tables.Q + 4]
    return torch.from_numpy(x.copy()), torch.from_numpy(q.copy())


class _Ropes(torch.autograd.Function):
    """x (B, K, 3), q (B, K-1, 4), gravity (B, K), eta (B, 5) -> x, q at the end."""

    @staticmethod
    def forward(ctx, x, q, gravity, eta, rod, options):
        ctx.save_for_backward(x, q, gravity, eta)
        ctx.constants = rod, options
        state = _pack(x, q)
        _check(state, gravity, eta, rod)
        gravity, eta = _array(gravity), _array(eta)

        def work(mine: slice) -> None:
            run_ropes(state[mine], gravity[mine], eta[mine], rod, options)

        in_threads(work, len(state), fewest=1)
        return _unpack(state)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads: Tensor):
        x, q, gravity, eta = ctx.saved_tensors
        rod, options = ctx.constants
        total = options.total
        block = total if total <= LONGEST_RECORD else math.isqrt(total - 1) + 1
        gravity, eta = _array(gravity), _array(eta)
        g_state, g_gravity, g_eta = _pack(*grads), np.zeros_like(gravity), np.zeros_like(eta)
        state = _pack(x, q)

        def work(mine: slice) -> None:
            pull_ropes(
                state[mine], gravity[mine], eta[mine], rod, options, block,
                g_state[mine], g_gravity[mine], g_eta[mine],
            )  # fmt: skip

        in_threads(work, len(state), fewest=1)
        g_x, g_q = _unpack(g_state)
        return g_x, g_q, torch.from_numpy(g_gravity), torch.from_numpy(g_eta), None, None


def _check(state: np.ndarray, gravity: Tensor, eta: Tensor, rod: np.ndarray) -> None:
    """Check what the compiled loops are given, once a call. Raises ShapeError."""
    ropes, nodes = len(state), len(rod)
    check_shapes(
        state=(state, (ropes, nodes, tables.STATE_COLUMNS)),
        gravity=(gravity, (ropes, nodes)),
        eta=(eta, (ropes, 5)),
        rod=(rod, (nodes, tables.ROD_COLUMNS)),
    )
