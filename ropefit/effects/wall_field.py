"""A force of place along one direction: a wall that repels or attracts, wind in part of a room."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect, Exported, Quantity, SpecialCase
from ropefit.effects.distributed_load import DistributedLoad
from ropefit.effects.force_field import field_of, lumped
from ropefit.effects.law import Constant, Form, Law
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import middle_of
from ropefit.rod.setup import Potential, Setup

STEEPEST = 40.0  # over the length: how fast the logarithm of the force may change
EDGE = 0.02  # of the length: over which a step rises
CLOSEST = 0.01  # of the length: no force grows further at a wall that is nearer
LARGEST = 100.0  # usual loads
FIRST_LOAD = 0.1  # usual loads: small enough that every frame settles
DIRECTIONS, DECAYS = 200, (2.0, 6.0, 15.0)  # tried; over the length
HANGS = 0.25  # of the length: below the middle of the ends
STARTS, APART = 2, 0.5  # rad: directions that are nearer are one


class Profile(Protocol):
    """A force over its size at d = 0 as a function of the distance d [m] along it."""

    def force(self, d: Tensor) -> Tensor:
        """Return the force."""
        ...

    def slope(self, d: Tensor) -> Tensor:
        """Return its derivative [1/m]."""
        ...

    def energy(self, d: Tensor) -> Tensor:
        """Return [m] minus its integral from some distance."""
        ...


@dataclass(frozen=True)
class Falling:
    """exp(-decay d - bend d²); its integral by quadrature, in closed form where bend is zero."""

    decay: Tensor
    bend: Tensor

    def force(self, d: Tensor) -> Tensor:
        return torch.exp(-self.decay * d - self.bend * d**2)

    def slope(self, d: Tensor) -> Tensor:
        return -(self.decay + 2 * self.bend * d) * self.force(d)

    def energy(self, d: Tensor) -> Tensor:
        half = 0.5 * d[..., None]
        return -(half * self.force(half * (POINTS + 1)) * WEIGHTS).sum(-1)


@dataclass(frozen=True)
class Power:
    """(1 + d / wall)^-n: `wall` [m] behind the origin; level within `closest` [m]."""

    wall: Tensor
    n: Tensor
    closest: float

    def force(self, d: Tensor) -> Tensor:
        return (1 + d / self.wall).clamp_min(self.closest / float(self.wall)) ** -self.n

    def slope(self, d: Tensor) -> Tensor:
        outside = self.wall + d > self.closest
        return -self.n * self.force(d) / (self.wall + d).clamp_min(self.closest) * outside

    def energy(self, d: Tensor) -> Tensor:
        half = 0.5 * torch.log1p((d / self.wall).clamp_min(self.closest / float(self.wall) - 1))
        at = self.wall * torch.expm1(half[..., None] * (POINTS + 1))
        return -(half[..., None] * self.force(at) * (self.wall + at) * WEIGHTS).sum(-1)


@dataclass(frozen=True)
class Step:
    """1 / (1 + exp((d - edge) / width)): full behind the edge [m], nothing beyond."""

    edge: Tensor
    width: float

    def force(self, d: Tensor) -> Tensor:
        return torch.sigmoid((self.edge - d) / self.width)

    def slope(self, d: Tensor) -> Tensor:
        share = self.force(d)
        return -share * (1 - share) / self.width

    def energy(self, d: Tensor) -> Tensor:
        return self.width * torch.nn.functional.softplus((self.edge - d) / self.width)


POINTS, WEIGHTS = (torch.from_numpy(a) for a in np.polynomial.legendre.leggauss(24))


@dataclass(frozen=True)
class Planar:
    """The energy of a force per length along `way` (3,), of a size [N/m] at the point `middle` (3,)
    [m], that changes with the distance along that direction as a profile says."""

    way: Tensor
    size: Tensor
    middle: Tensor
    profile: Profile

    def distance(self, x: Tensor) -> Tensor:
        """Return distances (...) [m] of places x (..., 3)."""
        return ((x - self.middle) * self.way).sum(-1)

    def __call__(self, x: Tensor) -> Tensor:
        """Return the energy per length [J/m] at x (..., 3)."""
        return self.size * self.profile.energy(self.distance(x))

    def derivatives(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the energy's slope (..., 3) and curvature (..., 3, 3) in closed form."""
        d = self.distance(x)
        slope = -self.size * self.profile.force(d)[..., None] * self.way
        rows = -self.size * self.profile.slope(d)[..., None, None]
        return slope, rows * self.way[:, None] * self.way


class WallField(Effect):
    """A force per length along one direction, its size an exponential of the distance along it, and
    of the square of that; at `_origin` it is the load told."""

    name = "force_field"
    in_motion = False
    scanned = False
    late = True
    linear = False
    held_out = "stretches"  # the frames that come near it tell most of it
    quantities = (
        *(Quantity(f"load_{axis}", "N/m", 0.1, by_weight=1.0, by_length=-1.0) for axis in "xyz"),
        Quantity("decay", "1/m", 5.0, by_length=-1.0),
        Quantity("bend", "1/m^2", 5.0, by_length=-2.0),
    )
    special_cases = (
        SpecialCase(DistributedLoad, ("decay", "bend"), lambda _, values: values[:3]),
    )  # fmt: skip

    def applies(self, setup: Setup) -> bool:
        return planar_of(setup) is None and field_of(setup) is None

    def bounds(self, setup: Setup) -> tuple[list[float], list[float]]:
        length = float(setup.properties.length.sum())
        most = LARGEST * self.quantities[0].size(setup)
        highest = [most] * 3 + [STEEPEST / length, STEEPEST / length**2]
        return [-v for v in highest], highest

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        size = values[:3].norm()
        way = values[:3] / size.clamp_min(1e-300)
        return _with_profile(setup, way, size, Falling(values[3], values[4]))

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Return directions along which most of the misfit points, with how fast it falls."""
        setup = misfit.setup
        length = float(setup.properties.length.sum())
        usual = self.quantities[0].size(setup)
        arm = misfit.places - _origin(setup).numpy()
        tried = []
        for way in _directions():
            d, along = arm @ way, misfit.moves @ way
            for decay in DECAYS:
                # Where the force is 1 where the rope is nearest to the wall.
                size = np.exp(-(decay / length) * (d - d.min()))
                score = float(along @ size / np.sqrt(size @ size))
                at = np.exp((decay / length) * d.min())
                tried.append((abs(score), way, np.sign(score) * at, decay / length))
        tried.sort(key=lambda t: -t[0])
        out: list[np.ndarray] = []
        for _, way, size, decay in tried:
            if all(abs(way @ v[:3] / np.linalg.norm(v[:3])) < np.cos(APART) for v in out):
                # A force against `way` grows along itself.
                load, decay = FIRST_LOAD * usual * size * way, np.sign(size) * decay
                out.append(np.array([*load, decay, 0.0]))
            if len(out) == STARTS:
                break
        smaller = np.array([0.2, 0.2, 0.2, 1.0, 1.0])
        return [[v, v * smaller] for v in out]

    def law(self, setup: Setup) -> Law:
        return Law(
            "distance along the force", "force per length", "m", -3.0, _curve, _distances,
            np.full(len(self.quantities), True), _forms(self, setup), _sentence, even=True,
        )  # fmt: skip

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        return Exported(beside, note="force_field: forces of place in space are not expressed")

    def sentence(self, values: dict[str, float]) -> str:
        x, y, z = (values[f"load_{axis}"] for axis in "xyz")
        way = "falls" if values["decay"] > 0 else "grows"
        return (
            f"a force of ({x:.2g}, {y:.2g}, {z:.2g}) N/m below the middle of the ends acts along "
            f"one direction in space, and {way} along it"
        )


def planar_of(setup: Setup) -> Planar | None:
    """Return the force along one direction that acts in a setup, if one does."""
    energies = (p.energy for p in setup.potentials)
    return next((e for e in energies if isinstance(e, Planar)), None)


def _origin(setup: Setup) -> Tensor:
    """Return (3,) [m] a place in the middle of where a rope hangs, below the middle of its ends."""
    down = setup.gravity.detach() / setup.gravity.detach().norm().clamp_min(1e-12)
    return middle_of(setup) + HANGS * setup.properties.length.sum().detach() * down


def _with_profile(setup: Setup, way: Tensor, size: Tensor, profile: Profile) -> Setup:
    field = Planar(way, size, _origin(setup), profile)
    energy = Potential(field, lumped(setup.arc), derivatives=field.derivatives)
    return setup._replace(potentials=(*setup.potentials, energy))


def _directions() -> np.ndarray:
    """Return (DIRECTIONS, 3) unit vectors, evenly over the sphere."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * k / DIRECTIONS, np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def _curve(setup: Setup, x: np.ndarray) -> np.ndarray:
    """Return (n,) forces per length [N/m] at distances x (n,) [m]."""
    field = planar_of(setup)
    if field is None:
        return np.zeros_like(x)
    return (field.size * field.profile.force(torch.from_numpy(x))).detach().numpy()


def _distances(setup: Setup, nodes: np.ndarray) -> np.ndarray:
    """Return the distances [m] of the nodes (F, N+1, 3) [m] along the force."""
    field = planar_of(setup)
    assert field is not None
    return field.distance(torch.from_numpy(nodes)).numpy().ravel()


def _sentence(x: np.ndarray, y: np.ndarray, units: tuple[str, str]) -> str:
    pairs = zip(x, y, strict=True)
    near, far = (f"{v:.2g} {units[1]} at {at:.2g} {units[0]}" for at, v in pairs)
    return (
        "a force acts along one direction in space, and changes with the distance along it: "
        f"{near}, {far}"
    )


def _forms(effect: WallField, setup: Setup) -> tuple[Form, ...]:
    """Return the forms: a size, the values of a profile, and two turns of the free direction."""
    field = planar_of(setup)
    if field is None:
        return ()
    length = float(setup.properties.length.sum())
    way = field.way.detach()
    across = torch.linalg.svd(way[None])[2][1:]
    usual = effect.quantities[0].size(setup)
    size = float(field.size)

    def form(name, names, units, lower, upper, tries, profile, constants) -> Form:
        def apply(s: Setup, v: Tensor) -> Setup:
            turned = way + v[-2:] @ across
            return _with_profile(s, turned / turned.norm(), v[0], profile(v[1:-2]))

        start = np.array([[size, *value, 0.0, 0.0] for value in tries])
        scale = [usual, *(0.2 * np.ptp(np.array(tries), axis=0) + 1e-9), 0.1, 0.1]
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

    zero = torch.zeros((), dtype=torch.float64)
    decays = np.geomspace(0.5, 30, 12) / length
    walls = [(w * length, n) for w in (0.15, 0.2, 0.3, 0.5, 0.8) for n in (1.0, 2.0, 4.0)]
    return (
        form("F = F0 e^(-x/lambda)", ["decay"], ["1/m"], [-STEEPEST / length],
             [STEEPEST / length], [(v,) for s in (-1, 1) for v in s * decays],
             lambda v: Falling(v[0], zero), exponential),
        form("F = F0 (x0/(x0 + x))^n", ["wall", "power"], ["m", "1"], [0.05 * length, 0.1],
             [3 * length, 8.0], walls, lambda v: Power(v[0], v[1], CLOSEST * length), power),
        form("F = F0 where x < x1", ["edge"], ["m"], [-length], [length],
             [(v * length,) for v in np.linspace(-0.8, 0.8, 17)],
             lambda v: Step(v[0], EDGE * length), step),
    )  # fmt: skip
