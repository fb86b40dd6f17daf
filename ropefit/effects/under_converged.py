"""Shapes that look like those of a position-based solver that stopped early."""

from __future__ import annotations

import math
from collections import deque
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.start import frames_along
from ropefit.solvers.xpbd.loops import constants, run
from ropefit.solvers.xpbd.settings import Settings

NODES = 20  # of the chain that represents the solver's own
MOST_KEPT = 4  # of the latest results
NEAR = 5e-5  # of the largest of an array: by so little differ set-ups whose difference is taken
# Amount up to which differences are those of the catenary: what the iterations make of a small move
# differs from it by up to 30 %, hence what is seen by up to 3 %.
LARGE = 0.1


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
    costly = True
    tries = (0.3, 0.7, 1.5)

    def applies(self, setup: Setup) -> bool:
        return not bool(np.isnan(setup.ends).any())

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        amount, drop, reach = values
        still, fallen = _stopped_shapes(setup, float(drop), float(reach), amount > LARGE)
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


class _Known(NamedTuple):
    """What the iterations were run from: of which drop [m] and reach, clamped ends, and arrays that
    the catenary is made of; the catenary, and the nodes without the drop and with it (F, N + 1, 3)
    [m]."""

    drop: float
    reach: float
    clamped: tuple[bool, bool]
    arrays: tuple[np.ndarray, ...]
    hanging: np.ndarray
    still: np.ndarray
    fallen: np.ndarray

    def near(self, other: _Known) -> bool:
        """Return whether another one differs by no more than a step of a difference."""
        return self[:3] == other[:3] and all(
            a.shape == b.shape and not (np.abs(a - b) > NEAR * _largest(a)).any()
            for a, b in zip(self.arrays, other.arrays, strict=True)
        )


_latest: deque[_Known] = deque(maxlen=MOST_KEPT)


def _stopped_shapes(
    setup: Setup, drop: float, reach: float, exact: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return (F, N + 1, 3) [m] where the iterations leave the nodes, without the drop and with it.

    Most of what a fit varies makes no difference here: the latest results are kept. Unless it is to
    be exact, they move with the catenary where the set-up differs by a step of a difference.
    """
    rod = setup._replace(potentials=()).rod()
    held = Conditions(setup.ends, setup.clamp)
    # Neither the catenary nor the iterations know a bending stiffness.
    arrays = (rod.length, rod.flexibility, rod.load, held.ends, held.clamp, setup.gravity)
    none = np.empty(0)
    now = _Known(drop, reach, setup.clamped, arrays, none, none, none)
    known = next((one for one in _latest if one.near(now)), None)
    same = partial(np.array_equal, equal_nan=True)
    if known is not None and all(map(same, known.arrays, arrays)):
        return known.still, known.fallen
    start = _sampled(solve(rod, held, limit=0, continuation=False).x)
    hanging = _along(start, setup.segments)
    if known is not None and not exact:
        moved = hanging - known.hanging
        return known.still + moved, known.fallen + moved
    both = (_along(x, setup.segments) for x in _stopped(setup, start, drop, iterations(reach)))
    _latest.appendleft(_Known(drop, reach, setup.clamped, arrays, hanging, *both))
    return _latest[0].still, _latest[0].fallen


def _largest(array: np.ndarray) -> float:
    return float(np.nanmax(np.abs(array), initial=0.0))


def _sampled(x: np.ndarray) -> np.ndarray:
    """Return (F, NODES, 3) places on a rope's nodes (F, N+1, 3)."""
    at = np.linspace(0, x.shape[1] - 1, NODES)
    low = np.minimum(at.astype(int), x.shape[1] - 2)
    return x[:, low] + (at - low)[:, None] * (x[:, low + 1] - x[:, low])


def _stopped(
    setup: Setup, places: np.ndarray, drop: float, count: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return (F, NODES, 3) [m] particles after `count` iterations from their places, without the
    drop and with it."""
    frames, down = len(places), -setup.up
    q = frames_along(places, setup.clamp[:, 0], setup.clamp[:, 1])
    x, q = (np.concatenate([item, item]) for item in (places, q))
    held, turned = np.ones(NODES), np.ones(NODES - 1)
    held[[0, -1]], turned[[0, -1]] = 0.0, 1.0 - np.array(setup.clamped)
    length = np.full(NODES - 1, setup.properties.length.sum() / (NODES - 1))
    straight = np.tile([1.0, 0.0, 0.0, 0.0], (NODES - 2, 1))
    falls = np.repeat([0.0, drop], frames)[:, None] * np.ones(NODES)
    eta = np.ones((2 * frames, 5))
    whole = max(math.floor(count), 1)

    def after(
        x: np.ndarray, q: np.ndarray, number: int, falls: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the state `number` iterations later; dt makes the particles fall by drop."""
        settings = Settings(steps=1, iterations=number, dt=math.sqrt(2.0))
        known = constants(length, straight, held, turned, "jacobi", down, settings)
        return run(x, q, falls, eta, known)

    low, q = after(x, q, whole, falls)
    both = low + (count - whole) * (after(low, q, 1, np.zeros_like(falls))[0] - low)
    return both[:frames], both[frames:]


def _along(few: np.ndarray, segments: int) -> np.ndarray:
    """Return (F, segments + 1, 3) on a cubic through values (F, NODES, 3)."""
    return _cubic(segments) @ few


@cache
def _cubic(segments: int) -> np.ndarray:
    """Return (segments + 1, NODES) the weights of the values."""
    few, at = np.eye(NODES), np.linspace(0, NODES - 1, segments + 1)
    low = np.minimum(at.astype(int), NODES - 2)
    t = (at - low)[:, None]
    wide = np.concatenate([2 * few[:1] - few[1:2], few, 2 * few[-1:] - few[-2:-1]])
    a, b, c, d = (wide[low + k] for k in range(4))
    return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
