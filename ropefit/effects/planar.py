"""A force of place along one direction: its profiles, its energy, and the forms it may have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import expit

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.field_search import SHARES, best_shapes
from ropefit.effects.force_in_space import Field, with_field
from ropefit.effects.law import Constant, Form, Law
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import middle_of
from ropefit.rod.setup import Setup

STEEPEST = 40.0  # over the length: how fast the logarithm of the force may change
EDGE = 0.02  # of the length: over which a step rises
CLOSEST = 0.01  # of the length: no force grows further at a wall that is nearer
LARGEST = 100.0  # usual loads
DIRECTIONS = 200  # tried, over the sphere
HANGS = 0.25  # of the length: below the middle of the ends
WALLS, POWERS = np.geomspace(0.08, 2.5, 36), np.linspace(0.5, 6.0, 12)  # tried; over the length
APART = 0.5  # rad: directions that are nearer are one


LOADS = tuple(Quantity(f"load_{axis}", "N/m", 0.1, by_weight=1.0, by_length=-1.0) for axis in "xyz")
STARTS = 2  # directions that a fit starts from
TURNED = 0.2  # rad: by how much directions are varied to refine them


class Profile(Protocol):
    """A force over its size at d = 0 as a function of the distance d [m] along it."""

    def force(self, d: np.ndarray) -> np.ndarray:
        """Return the force."""
        ...

    def slope(self, d: np.ndarray) -> np.ndarray:
        """Return its derivative [1/m]."""
        ...

    def energy(self, d: np.ndarray) -> np.ndarray:
        """Return [m] minus its integral from some distance."""
        ...


@dataclass(frozen=True)
class Falling:
    """exp(-decay d - bend d²); its integral by quadrature, in closed form where bend is zero."""

    decay: np.ndarray
    bend: np.ndarray

    def force(self, d: np.ndarray) -> np.ndarray:
        return np.exp(-self.decay * d - self.bend * d**2)

    def slope(self, d: np.ndarray) -> np.ndarray:
        return -(self.decay + 2 * self.bend * d) * self.force(d)

    def energy(self, d: np.ndarray) -> np.ndarray:
        half = 0.5 * d[..., None]
        return -(half * self.force(half * (POINTS + 1)) * WEIGHTS).sum(-1)


@dataclass(frozen=True)
class Power:
    """(1 + d / wall)^-n: `wall` [m] behind the origin (negative: ahead of it); level within
    `closest` [m] of it."""

    wall: np.ndarray
    n: np.ndarray
    closest: float

    def force(self, d: np.ndarray) -> np.ndarray:
        return np.maximum(1 + d / self.wall, self._least()) ** -self.n

    def slope(self, d: np.ndarray) -> np.ndarray:
        share = 1 + d / self.wall
        least = self._least()
        return -self.n * self.force(d) / (self.wall * np.maximum(share, least)) * (share > least)

    def energy(self, d: np.ndarray) -> np.ndarray:
        half = 0.5 * np.log1p(np.maximum(d / self.wall, self._least() - 1))
        at = self.wall * np.expm1(half[..., None] * (POINTS + 1))
        return -(half[..., None] * self.force(at) * (self.wall + at) * WEIGHTS).sum(-1)

    def _least(self) -> float:
        return self.closest / abs(float(self.wall))


@dataclass(frozen=True)
class Step:
    """1 / (1 + exp(sharpness (d - edge))): full behind the edge [m], nothing beyond; where the
    sharpness [1/m] is negative, full beyond it."""

    edge: np.ndarray
    sharpness: np.ndarray

    def force(self, d: np.ndarray) -> np.ndarray:
        return expit((self.edge - d) * self.sharpness)

    def slope(self, d: np.ndarray) -> np.ndarray:
        share = self.force(d)
        return -share * (1 - share) * self.sharpness

    def energy(self, d: np.ndarray) -> np.ndarray:
        rise = np.logaddexp(0.0, (self.edge - d) * self.sharpness)
        return (rise - LN_2) / self.sharpness


LN_2 = float(np.log(2.0))
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True)
class Planar(Field):
    """The energy of a force per length along `way` (3,), of a size [N/m] at the point `middle` (3,)
    [m], that changes with the distance along that direction as a profile says."""

    way: np.ndarray
    size: float
    middle: np.ndarray
    profile: Profile

    def distance(self, x: np.ndarray) -> np.ndarray:
        """Return distances (...) [m] of places x (..., 3)."""
        return ((x - self.middle) * self.way).sum(-1)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.size * self.profile.energy(self.distance(x))

    def force_at(self, x: np.ndarray) -> np.ndarray:
        return (self.size * self.profile.force(self.distance(x)))[..., None] * self.way

    def derivatives(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        d = self.distance(x)
        slope = -self.force_at(x)
        rows = -self.size * self.profile.slope(d)[..., None, None]
        return slope, rows * self.way[:, None] * self.way


def _planar_of(setup: Setup) -> Planar | None:
    """Return the force along one direction that acts in a setup, if one does."""
    energies = (p.energy for p in setup.potentials)
    return next((e for e in energies if isinstance(e, Planar)), None)


def origin_of(setup: Setup) -> np.ndarray:
    """Return (3,) [m] a place in the middle of where a rope hangs, below the middle of its ends."""
    down = setup.gravity / max(np.linalg.norm(setup.gravity), 1e-12)
    return middle_of(setup) + HANGS * setup.properties.length.sum() * down


def with_profile(setup: Setup, load: np.ndarray, profile: Profile) -> Setup:
    """Return the setup with a force per length `load` (3,) [N/m], times a profile along it."""
    size = float(np.linalg.norm(load))
    way = load / max(size, 1e-300)
    field = Planar(way, size, origin_of(setup), profile)
    return with_field(setup, field)


def largest(setup: Setup, usual: float = LARGEST) -> list[float]:
    """Return (3,) [N/m] the largest load along each axis, as a multiple of usual ones."""
    return [usual * quantity.size(setup) for quantity in LOADS]


def planar_starts(
    misfit: Misfit,
    profiles: Callable[[np.ndarray], np.ndarray],
    profile: Callable[[np.ndarray, np.ndarray], Profile],
    widths: tuple[float, float],
    limits: np.ndarray,
    odd: np.ndarray,
) -> list[list[np.ndarray]]:
    """Return starts along the directions, with the profiles, that explain most of a misfit.

    profiles(d (M,) [m]): (Q, 2) values of profiles tried where the data are at distances d along a
    direction; profile: of two values; widths: of them, to refine; limits (3 + 2,): largest load
    and values; odd (2,): sign that they get with a force against the direction.
    """
    setup = misfit.setup
    origin = origin_of(setup)
    arm = misfit.places - origin
    ways = directions()
    tried = [
        np.insert(one, [0, 0, 0], way, axis=1) for way in ways for one in [profiles(arm @ way)]
    ]

    def field(shapes: np.ndarray) -> Planar:
        way = shapes[:, :3] / np.linalg.norm(shapes[:, :3], axis=1)[:, None]
        values = np.clip(shapes[:, 3:], -limits[3:], limits[3:])
        first, second = values.T[..., None, None]
        return Planar(way[:, None, None], 1.0, origin, profile(first, second))

    def alike(a: np.ndarray, b: np.ndarray) -> bool:
        return bool(a[:3] @ b[:3] > np.cos(APART) * np.linalg.norm(a[:3]) * np.linalg.norm(b[:3]))

    every = np.array([*(3 * [TURNED]), *widths])
    out = []
    for size, shape in best_shapes(
        misfit, np.concatenate(tried), field, every, alike, STARTS, limits[0]
    ):
        load = size * shape[:3] / np.linalg.norm(shape[:3])
        values = np.clip(shape[3:], -limits[3:], limits[3:]) * np.where(size < 0, odd, 1.0)
        out.append([np.array([*(part * load), *values]) for part in SHARES])
    return out


def directions() -> np.ndarray:
    """Return (DIRECTIONS, 3) unit vectors, evenly over the sphere."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * k / DIRECTIONS, np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def _curve(setup: Setup, x: np.ndarray) -> np.ndarray:
    """Return (n,) forces per length [N/m] at distances x (n,) [m]."""
    field = _planar_of(setup)
    if field is None:
        return np.zeros_like(x)
    return field.size * field.profile.force(x)


def _distances(setup: Setup, nodes: np.ndarray) -> np.ndarray:
    """Return the distances [m] of the nodes (F, N+1, 3) [m] along the force."""
    field = _planar_of(setup)
    assert field is not None
    return field.distance(nodes).ravel()


def _sentence(x: np.ndarray, y: np.ndarray, units: tuple[str, str]) -> str:
    pairs = zip(x, y, strict=True)
    near, far = (f"{v:.2g} {units[1]} at {at:.2g} {units[0]}" for at, v in pairs)
    return (
        "a force acts along one direction in space, and changes with the distance along it: "
        f"{near}, {far}"
    )


def law_of(effect: Effect, setup: Setup) -> Law:
    """Return the law of an effect that acts along one direction."""
    return Law(
        "distance along the force", "force per length", "m", -3.0, _curve, _distances,
        np.full(len(effect.quantities), True), _forms(effect, setup), _sentence, even=True,
    )  # fmt: skip


def _forms(effect: Effect, setup: Setup) -> tuple[Form, ...]:
    """Return the forms: a size, the values of a profile, and two turns of the free direction."""
    field = _planar_of(setup)
    if field is None:
        return ()
    length = float(setup.properties.length.sum())
    way = field.way
    across = np.linalg.svd(way[None])[2][1:]
    usual = effect.quantities[0].size(setup)

    def form(name, names, units, lower, upper, tries, profile, constants) -> Form:
        def apply(s: Setup, v: np.ndarray) -> Setup:
            turned = way + v[-2:] @ across
            return with_profile(s, v[0] * turned / np.linalg.norm(turned), profile(v[1:-2]))

        start = np.array([[usual, *value, 0.0, 0.0] for value in tries])
        scale = [usual, *(0.2 * np.ptp(np.abs(tries), axis=0) + 1e-9), 0.1, 0.1]
        return Form(
            name, ("strength", *names, "turn_1", "turn_2"), ("N/m", *units, "rad", "rad"),
            np.array([0.0, *lower, -1.0, -1.0]),
            np.array([1e3 * LARGEST * usual, *upper, 1.0, 1.0]),
            start, apply, constants, np.array(scale),
        )  # fmt: skip

    def exponential(s: Setup, v: np.ndarray) -> list[Constant]:
        return [Constant("F0", float(v[0]), -3.0), Constant("lambda", 1 / float(v[1]), 1.0, False)]

    def power(s: Setup, v: np.ndarray) -> list[Constant]:
        return [
            Constant("F0", float(v[0]), -3.0), Constant("x0", float(v[1]), 1.0, False),
            Constant("n", float(v[2]), 0.0, False),
        ]  # fmt: skip

    def step(s: Setup, v: np.ndarray) -> list[Constant]:
        return [Constant("F0", float(v[0]), -3.0), Constant("x1", float(v[1]), 1.0, False)]

    zero, sharp = np.zeros(()), np.array(1 / (EDGE * length))
    decays = np.geomspace(0.5, 30, 12) / length
    places = np.concatenate([-WALLS, WALLS]) * length
    walls = [(place, n) for place in places for n in POWERS]
    edges = [(v * length,) for v in np.linspace(-0.8, 0.8, 33)]
    return (
        form("F = F0 e^(-x/lambda)", ["decay"], ["1/m"], [-STEEPEST / length],
             [STEEPEST / length], [(v,) for s in (-1, 1) for v in s * decays],
             lambda v: Falling(v[0], zero), exponential),
        form("F = F0 (x0/(x0 + x))^n", ["wall", "power"], ["m", "1"], [-3 * length, 0.1],
             [3 * length, 8.0], walls, lambda v: Power(v[0], v[1], CLOSEST * length), power),
        form("F = F0 where x < x1", ["edge"], ["m"], [-length], [length], edges,
             lambda v: Step(v[0], sharp), step),
        form("F = F0 where x > x1", ["edge"], ["m"], [-length], [length], edges,
             lambda v: Step(v[0], -sharp), step),
    )  # fmt: skip
