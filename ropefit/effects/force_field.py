"""A force of place in space: something beside the rope that repels or attracts all of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.law import Constant, Form, Law
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import middle_of
from ropefit.rod.setup import Potential, Setup

REFERENCE = 0.1  # of the length: the distance at which `strength` is the force
CLOSEST = 0.01  # of the length: nearer, the force grows no further
GRID, AROUND = 12, 0.2  # centres tried along each axis, and how far beyond the rope, of its length
STARTS, APART = 2, 0.15  # of the length: centres that are nearer are one
FIRST_STRENGTH = 0.1  # usual sizes: small enough that every frame settles
LARGEST = 100.0  # usual strengths
LUMPS = 16  # parts of the rope: forces change little over one
SHORTEST = 0.03  # of the length: over which a force falls by e; a shorter one is a contact
POINTS, WEIGHTS = (torch.from_numpy(a) for a in np.polynomial.legendre.leggauss(10))


class Field:
    """An energy per length that is a function of place in space."""


@dataclass(frozen=True)
class Radial(Field):
    """The energy of a force per length F(r) = strength (r0/r)^power exp((r0 - r) decay) away from
    `centre` (3,) [m], r0 = `reference` [m]; level within the distance `closest` [m]."""

    strength: Tensor
    power: Tensor
    decay: Tensor
    centre: Tensor
    reference: Tensor
    closest: Tensor

    def force(self, r: Tensor) -> Tensor:
        """Return the force per length [N/m] at distances r (...) [m]."""
        r = r.clamp_min(self.closest)
        falling = (self.reference / r) ** self.power * torch.exp((self.reference - r) * self.decay)
        return self.strength * falling

    def __call__(self, x: Tensor) -> Tensor:
        """Return the energy per length [J/m] at x (..., 3), zero at the reference distance."""
        r = (x - self.centre).norm(dim=-1).clamp_min(self.closest)
        half = 0.5 * torch.log(r / self.reference)[..., None]
        at = self.reference * torch.exp(half * (POINTS + 1))
        return -(half * self.force(at) * at * WEIGHTS).sum(-1)

    def derivatives(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the energy's slope (..., 3) and curvature (..., 3, 3) in closed form."""
        arm = x - self.centre
        far = arm.norm(dim=-1)
        r = far.clamp_min(self.closest)
        way, force = arm / r[..., None], self.force(r)
        along = force * (self.power / r + self.decay) * (far > self.closest)  # -dF/dr
        square = way[..., :, None] * way[..., None, :]
        across = torch.eye(3, dtype=x.dtype) - square
        rows = along[..., None, None] * square - (force / r)[..., None, None] * across
        return -force[..., None] * way, rows


class ForceInSpace(Effect):
    """A force per length that is a function of place in space, whatever function that is."""

    name = "force_field"
    in_motion = False
    scanned = False
    late = True
    linear = False
    held_out = "stretches"  # the frames that come near it tell most of it

    def applies(self, setup: Setup) -> bool:
        return not has_field(setup)

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        return Exported(beside, note="force_field: forces of place in space are not expressed")


class ForceField(ForceInSpace):
    """A force per length away from a point, see `Radial`; negative: towards it.

    strength: at a tenth of the rope's length; the point against the middle of the ends.
    """

    quantities = (
        Quantity("strength", "N/m", 0.3, by_weight=1.0, by_length=-1.0),
        Quantity("power", "1", 1.0, 0.0, 6.0),
        Quantity("decay", "1/m", 5.0, 0.0, by_length=-1.0),
        *(Quantity(f"centre_{axis}", "m", 0.1, by_length=1.0) for axis in "xyz"),
    )

    def bounds(self, setup: Setup) -> tuple[list[float], list[float]]:
        lower, upper = super().bounds(setup)
        most = LARGEST * self.quantities[0].size(setup)
        steepest = 1 / (SHORTEST * float(setup.properties.length.sum()))
        return [-most, *lower[1:]], [most, upper[1], steepest, *upper[3:]]

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        own = setup.properties.length
        length = own.sum().detach()
        centre = middle_of(setup) + values[3:]
        reference, closest = REFERENCE * length, CLOSEST * length
        field = Radial(values[0], values[1], values[2], centre, reference, closest)
        energy = Potential(field, lumped(setup.arc), derivatives=field.derivatives)
        return setup._replace(potentials=(*setup.potentials, energy))

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Return centres from which, or to which, most of the misfit points."""
        setup = misfit.setup
        length, middle = float(setup.properties.length.sum()), middle_of(setup).numpy()
        good = misfit.nodes[np.isfinite(misfit.nodes).all((1, 2))]
        low, high = (f(good, axis=(0, 1)) for f in (np.min, np.max))
        edges = np.linspace(low - AROUND * length, high + AROUND * length, GRID)
        centres = np.stack(np.meshgrid(*edges.T, indexing="ij"), -1).reshape(-1, 3)
        along, score = np.empty(len(centres)), np.empty(len(centres))
        for some in np.array_split(np.arange(len(centres)), GRID**2):  # not all at once: memory
            arm = misfit.places - centres[some, None]
            far = np.maximum(np.linalg.norm(arm, axis=-1), 0.5 * REFERENCE * length)
            force = arm / far[..., None] ** 3
            along[some] = (force * misfit.moves).sum((1, 2))
            score[some] = along[some] / np.sqrt((force**2).sum((1, 2)))
        usual = [q.size(setup) for q in self.quantities]
        out: list[np.ndarray] = []
        for k in np.argsort(-np.abs(score)):
            place = centres[k] - middle
            if all(np.linalg.norm(place - v[3:]) > APART * length for v in out):
                size = FIRST_STRENGTH * np.sign(along[k]) * usual[0]
                out.append(np.array([size, 1.0, 0.5 * usual[2], *place]))
            if len(out) == STARTS:
                break
        return [[v, v * np.array([0.2, 1, 1, 1, 1, 1])] for v in out]

    def law(self, setup: Setup) -> Law:
        return Law(
            "distance", "force per length", "m", -3.0, _curve, _distances,
            np.full(len(self.quantities), True), _forms(self, setup), _sentence, from_zero=False,
        )  # fmt: skip

    def sentence(self, values: dict[str, float]) -> str:
        way = "repels" if values["strength"] > 0 else "attracts"
        return (
            f"something {way} the rope from a point in space, {abs(values['strength']):.2g} N/m at "
            "a tenth of the rope's length"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn(
            "centre", point=components(values, "centre_"), size=np.sign(values["strength"]),
            label="repels" if values["strength"] > 0 else "attracts",
        )  # fmt: skip


def lumped(arc: Tensor) -> Tensor:
    """Return (N+1,) [m] how much of the rope, with nodes at arc (N+1,) [m], the field acts on at
    each node: at LUMPS + 1 of them, by the trapezoidal rule. Every further one would be three
    supports more in every factorisation."""
    nodes = torch.linspace(0, len(arc) - 1, min(LUMPS, len(arc) - 1) + 1).round().long()
    half = 0.5 * arc[nodes].diff()
    share = torch.nn.functional.pad(half, (1, 0)) + torch.nn.functional.pad(half, (0, 1))
    return torch.zeros_like(arc).index_add(0, nodes, share)


def has_field(setup: Setup) -> bool:
    """Say whether a force of place acts in a setup, of whichever kind: two would compensate."""
    return any(isinstance(p.energy, Field) for p in setup.potentials)


def _field_of(setup: Setup) -> Radial | None:
    """Return the force from a point that acts in a setup, if one does."""
    energies = (p.energy for p in setup.potentials)
    return next((e for e in energies if isinstance(e, Radial)), None)


def _curve(setup: Setup, x: np.ndarray) -> np.ndarray:
    """Return (n,) forces per length [N/m] at distances x (n,) [m]."""
    field = _field_of(setup)
    return np.zeros_like(x) if field is None else field.force(torch.from_numpy(x)).numpy()


def _distances(setup: Setup, nodes: np.ndarray) -> np.ndarray:
    """Return the distances [m] of the nodes (F, N+1, 3) [m] from the centre."""
    field = _field_of(setup)
    assert field is not None
    return np.linalg.norm(nodes - field.centre.numpy(), axis=-1).ravel()


def _sentence(x: np.ndarray, y: np.ndarray, units: tuple[str, str]) -> str:
    pairs = zip(x, y, strict=True)
    near, far = (f"{abs(v):.2g} {units[1]} at {at:.2g} {units[0]}" for at, v in pairs)
    way = "repels" if y[0] > 0 else "attracts"
    return f"a point in space {way} the rope: by {near}, {far}"


def _forms(effect: ForceField, setup: Setup) -> tuple[Form, ...]:
    """Return the forms with one value for the shape, tried from where the free field is."""
    field = _field_of(setup)
    if field is None:
        return ()
    length = float(setup.properties.length.sum())
    centre = (field.centre - middle_of(setup)).numpy()
    lower, upper = effect.bounds(setup)
    usual = [q.size(setup) for q in effect.quantities]

    def form(name: str, shape: int, tries: np.ndarray, constants) -> Form:
        kept = np.array([0, shape, 3, 4, 5])

        def apply(s: Setup, v: Tensor) -> Setup:
            return effect.apply(s, torch.zeros(6, dtype=v.dtype).index_add(0, index, v))

        index = torch.from_numpy(kept)
        start = np.array([[float(field.strength), value, *centre] for value in tries])
        return Form(
            name, tuple(effect.names[k] for k in kept),
            tuple(effect.quantities[k].unit for k in kept), np.array(lower)[kept],
            np.array(upper)[kept], start, apply, constants, np.array(usual)[kept],
        )  # fmt: skip

    def power(s: Setup, v: np.ndarray) -> list[Constant]:
        r0 = REFERENCE * float(s.properties.length.sum())
        return [
            Constant("F0", float(v[0]), -3.0),
            Constant("r0", r0, 1.0, False),
            Constant("n", float(v[1]), 0.0, False),
        ]

    def exponential(s: Setup, v: np.ndarray) -> list[Constant]:
        r0, decay = REFERENCE * float(s.properties.length.sum()), max(float(v[1]), 1e-9)
        size = float(v[0]) * np.exp(r0 * decay)
        return [Constant("F0", size, -3.0), Constant("lambda", 1 / decay, 1.0, False)]

    return (
        form("F = F0 (r0/r)^n", 1, np.linspace(0.25, 5.5, 22), power),
        form("F = F0 e^(-r/lambda)", 2, np.geomspace(0.5, 100, 24) / length, exponential),
    )
