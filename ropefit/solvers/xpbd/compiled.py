"""Algorithm 1 in compiled code: the results and gradients of `xpbd.simulate`, many times faster."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.strains import Rest
from ropefit.solvers.xpbd import loops
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.reference import DistanceSolver, Eta, State
from ropefit.solvers.xpbd.settings import Settings


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
    known = loops.constants(
        _array(rest.length), _array(rest.darboux), _array(chain.weight), _array(chain.weight_q),
        solver.name, _array(gravity), settings,
    )  # fmt: skip
    x, q = _Ropes.apply(x, q, by_node, others, known)  # type: ignore[misc]
    return State(x.reshape(*shape, nodes, 3), q.reshape(*shape, nodes - 1, 4))


def _array(t: Tensor) -> np.ndarray:
    """Return a writable copy in one piece, which is what the kernels are compiled for."""
    return t.detach().to(torch.float64).clone(memory_format=torch.contiguous_format).numpy()


class _Ropes(torch.autograd.Function):
    """x (B, K, 3), q (B, K-1, 4), gravity (B, K), eta (B, 5) -> x, q at the end."""

    @staticmethod
    def forward(ctx, x, q, gravity, eta, known):
        ctx.save_for_backward(x, q, gravity, eta)
        ctx.known = known
        found = loops.run(_array(x), _array(q), _array(gravity), _array(eta), known)
        return tuple(map(torch.from_numpy, found))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads: Tensor):
        x, q, gravity, eta, gx, gq = map(_array, (*ctx.saved_tensors, *grads))
        out = loops.pull(x, q, gravity, eta, ctx.known, gx, gq)
        return *map(torch.from_numpy, out), None
