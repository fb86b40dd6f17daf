"""Shapes that look like those of a position-based solver that stopped early."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup
from ropefit.rod.strains import straight_rest
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.start import frames_along
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.compiled import simulate_compiled
from ropefit.solvers.xpbd.jacobi import Jacobi
from ropefit.solvers.xpbd.reference import Eta, Settings, State

NODES = 20  # of the chain that represents the solver's own
MOST_KEPT = 4  # results in the cache
_latest: dict[tuple, tuple[Tensor, Tensor]] = {}


class UnderConverged(Effect):
    """Iterations that pass a correction on by one particle each, and stop.

    The rope starts as a catenary, falls by `drop` [m] and is put right by Jacobi's iterations of
    the paper's constraints until corrections have travelled over `reach`, a share of its length:
    √n of the NODES - 1 segments after n iterations. `amount` is the share of the way from the
    equilibrium back to there: 1 for a solver that knows gravity by the drop alone.
    """

    name = "under_converged"
    of_simulators = True
    kind = "solver"
    in_motion = False
    quantities = (
        Quantity("amount", "1", 0.1, 0.0, 1.0),
        Quantity("drop", "m", 0.003, 0.0, by_length=1.0),
        Quantity("reach", "1", 0.4, 0.06, 1.2),
    )
    shaping = 1
    looks_like_noise = True
    tries = (0.3, 0.7, 1.5)

    def applies(self, setup: Setup) -> bool:
        return not bool(torch.isnan(setup.ends).any())

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        amount, drop, reach = values
        still, fallen = _cached(setup, float(drop), float(reach))
        sensor = setup.sensor._replace(
            lag=setup.sensor.lag + amount, toward=still, drift=setup.sensor.drift + fallen - still
        )
        return setup._replace(sensor=sensor)

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the shapes are those of a solver that stopped early: corrections have travelled over "
            f"{values['reach']:.2g} of the rope, as after {iterations(values['reach']):.0f} Jacobi "
            f"iterations of {NODES} particles"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("mesh")


def iterations(reach: float) -> float:
    """Return the number of iterations after which a correction has travelled over a share of the
    length: it diffuses."""
    return (reach * (NODES - 1)) ** 2


def _cached(setup: Setup, drop: float, reach: float) -> tuple[Tensor, Tensor]:
    """Return (F, N + 1, 3) [m] where the iterations leave the nodes, without the drop and with it.

    Most of what a fit varies makes no difference here: the latest results are cached.
    """
    rod = setup._replace(potentials=()).rod()
    held = Conditions(setup.ends.detach(), setup.clamp.detach())
    # Neither the catenary nor the iterations know a bending stiffness.
    arrays = (rod.length, rod.flexibility, rod.load, held.ends, held.clamp, setup.gravity)
    key = (drop, reach, setup.clamped, *(a.detach().numpy().tobytes() for a in arrays))
    result = _latest.get(key)
    if result is None:
        start = _sampled(solve(rod, held, limit=0, continuation=False).x)
        both = _stopped(setup, start, drop, iterations(reach))
        result = (_along(both[0], setup.segments), _along(both[1], setup.segments))
        while len(_latest) >= MOST_KEPT:
            _latest.pop(next(iter(_latest)), None)
        _latest[key] = result
    return result


def _sampled(x: np.ndarray) -> Tensor:
    """Return (F, NODES, 3) places on a rope's nodes (F, N+1, 3)."""
    at = np.linspace(0, x.shape[1] - 1, NODES)
    low = np.minimum(at.astype(int), x.shape[1] - 2)
    return torch.from_numpy(x[:, low] + (at - low)[:, None] * (x[:, low + 1] - x[:, low]))


def _stopped(setup: Setup, x: Tensor, drop: float, count: float) -> tuple[Tensor, Tensor]:
    """Return (F, NODES, 3) [m] particles after `count` iterations from x, without the drop and
    with it."""
    clamp = setup.clamp.detach()
    q = frames_along(x, clamp[:, 0], clamp[:, 1])
    start = State(x.expand(2, *x.shape), q.expand(2, *q.shape))
    held, turned = torch.zeros(NODES, dtype=torch.bool), torch.zeros(NODES - 1, dtype=torch.bool)
    held[[0, -1]], turned[[0, -1]] = True, torch.tensor(setup.clamped)
    chain = Chain.build(held, turned)
    rest = straight_rest(float(setup.properties.length.detach().sum()), NODES)
    down = -setup.up
    one = torch.ones(1, 1, 1, dtype=torch.float64)
    falls = torch.tensor([0.0, drop], dtype=torch.float64)[:, None, None, None]
    eta = Eta(falls, one, one, one, one, one)
    whole = max(math.floor(count), 1)

    def after(start: State, number: int, fall: bool) -> State:
        """Return the state `number` iterations later; dt makes the particles fall by drop."""
        settings = Settings(steps=1, iterations=number, dt=math.sqrt(2.0))
        own = eta if fall else eta._replace(gravity=torch.zeros_like(falls))
        return simulate_compiled(start, rest, chain, own, Jacobi(), down, settings)

    with torch.no_grad():
        low = after(start, whole, True)
        both = low.x + (count - whole) * (after(low, 1, False).x - low.x)
    return both[0], both[1]


def _along(few: Tensor, segments: int) -> Tensor:
    """Return (F, segments + 1, 3) on a cubic through values (F, NODES, 3)."""
    return torch.matmul(_cubic(segments), few)


@cache
def _cubic(segments: int) -> Tensor:
    """Return (segments + 1, NODES) the weights of the values."""
    few = torch.eye(NODES, dtype=torch.float64)
    at = torch.linspace(0, NODES - 1, segments + 1, dtype=torch.float64)
    low = at.floor().clamp(max=NODES - 2).long()
    t = (at - low)[:, None]
    wide = torch.cat([2 * few[:1] - few[1:2], few, 2 * few[-1:] - few[-2:-1]])
    a, b, c, d = (wide[low + k] for k in range(4))
    return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
