"""Algorithm 1 of the paper: compliant position-based dynamics of a rope, differentiable.

For each step the free particles fall by g dt² η_x^G / 2; then, for a fixed number of iterations,
the
stretch-shear, bend-twist and distance constraints are projected and their moves are mixed by the η.
The answer is whatever state the iterations reach: see `drift` in the result of a fit. This is the
reference, differentiated by autograd; `compiled.py` does the same, many times faster.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from ropefit import plugins
from ropefit.rod.quaternion import normalise
from ropefit.rod.strains import Rest, bend_twist, distance, stretch_shear
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.jacobi import Jacobi
from ropefit.solvers.xpbd.settings import Settings
from ropefit.solvers.xpbd.thomas import Thomas


class DistanceSolver(Protocol):
    """How the distance constraint of one iteration is solved. One class a file."""

    name: str

    def multipliers(
        self, chain: Chain, value: Tensor, direction: Tensor, alpha: float
    ) -> Tensor: ...

    def displacement(self, chain: Chain, impulse: Tensor) -> Tensor: ...


SOLVERS: dict[str, DistanceSolver] = {solver.name: solver for solver in (Jacobi(), Thomas())}


def distance_solver(name: str) -> DistanceSolver:
    """Return a distance solver by its name, an add-on's by that of its entry point, which is a
    class or an object. Raises StageFailed."""
    if name in SOLVERS:
        return SOLVERS[name]
    found = plugins.named(plugins.SOLVERS, name)
    return found() if isinstance(found, type) else found


class Eta(NamedTuple):
    """The six weights of Algorithm 1, each broadcastable to (..., K or K-1, 3 or 4).

    gravity η_x^G, distance η_x^D, shear_x η_x^S, shear_q η_q^S, bend η_q^B, sor η^SOR.
    """

    gravity: Tensor
    distance: Tensor
    shear_x: Tensor
    shear_q: Tensor
    bend: Tensor
    sor: Tensor


class State(NamedTuple):
    """x (..., K, 3) [m] and q (..., K-1, 4)."""

    x: Tensor
    q: Tensor


class _Loop(NamedTuple):
    """State with the accumulated multipliers of the running step."""

    x: Tensor
    q: Tensor
    shear: Tensor
    bend: Tensor
    distance: Tensor


def _iterate(s: _Loop, chain: Chain, rest: Rest, eta: Eta, solver: DistanceSolver, c: Settings):
    """Run one pass of the constraint loop (Algorithm 1, lines 4-9)."""
    edges = chain.difference @ s.x
    per_length = 1.0 / rest.length[:, None]

    shear = stretch_shear(edges, s.q, rest)
    denominator = (
        chain.weight_sum[:, None] * per_length**2 + 4 * chain.weight_q[:, None] + c.alpha_shear
    ).clamp_min(1e-30)
    change_s = -(shear.value + c.alpha_shear * s.shear) / denominator
    move_x = chain.mean_scatter @ (change_s * per_length)
    turn_s = chain.weight_q[:, None] * (change_s[..., None, :] @ shear.grad_q)[..., 0, :]

    bend = bend_twist(s.q, rest)
    weight_pair = (chain.weight_q[1:] + chain.weight_q[:-1])[:, None]
    change_b = -(bend.value + c.alpha_bend * s.bend) / (weight_pair + c.alpha_bend).clamp_min(1e-30)
    turn_b = (
        chain.first_q @ (change_b[..., None, :] @ bend.grad_first)[..., 0, :]
        + chain.second_q @ (change_b[..., None, :] @ bend.grad_second)[..., 0, :]
    )

    stretch = distance(edges, rest)
    value = stretch.value + c.alpha_distance * s.distance
    change_d = solver.multipliers(chain, value, stretch.direction, c.alpha_distance)
    move_d = solver.displacement(chain, change_d[..., None] * stretch.direction)

    x = s.x + (move_x * eta.shear_x + move_d * eta.distance) * (0.5 * eta.sor)
    q = normalise(s.q + (turn_s * eta.shear_q + turn_b * eta.bend) * (0.5 * eta.sor))
    return _Loop(x, q, s.shear + change_s, s.bend + change_b, s.distance + change_d)


def _fresh(state: State) -> _Loop:
    """Return the state of a new step: multipliers start from zero."""
    x, q = state
    return _Loop(
        x,
        q,
        x.new_zeros(*q.shape[:-1], 3),
        x.new_zeros(*q.shape[:-2], q.shape[-2] - 1, 3),
        x.new_zeros(q.shape[:-1]),
    )


def simulate(
    start: State,
    rest: Rest,
    chain: Chain,
    eta: Eta,
    solver: DistanceSolver,
    gravity: Tensor,
    settings: Settings,
) -> State:
    """Run Algorithm 1 from `start`; held particles stay where the start has them.

    start.x (..., K, 3) [m], gravity (3,) [m/s²]. Differentiable in the start, the η and so the
    control
    point. Under autograd the iterations are checkpointed in blocks of √n, so memory grows with √n.
    """
    fall = (0.5 * settings.dt**2) * gravity * eta.gravity
    free = (chain.weight > 0).to(start.x)[:, None]
    inputs = [*start, *eta]
    recording = torch.is_grad_enabled() and any(item.requires_grad for item in inputs)
    block = math.isqrt(settings.total - 1) + 1 if recording else settings.total

    def run(first: int, last: int, *loop: Tensor) -> tuple[Tensor, ...]:
        s = _Loop(*loop)
        for index in range(first, last):
            if index % settings.iterations == 0:
                s = _fresh(State(s.x + fall * free, s.q))
            s = _iterate(s, chain, rest, eta, solver, settings)
        return tuple(s)

    loop = tuple(_fresh(start))
    for first in range(0, settings.total, block):
        last = min(first + block, settings.total)
        if recording:
            loop = checkpoint(run, first, last, *loop, use_reentrant=False)  # type: ignore[misc]
        else:
            loop = run(first, last, *loop)
    return State(loop[0], loop[1])
