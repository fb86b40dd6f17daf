"""A force of place in space: something beside the rope that repels or attracts all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.effects.base import Quantity
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.field_search import SHARES, best_shapes
from ropefit.effects.force_in_space import Field, ForceInSpace, with_field
from ropefit.effects.law import Constant, Form, Law
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import middle_of
from ropefit.rod.setup import Setup

REFERENCE = 0.1  # of the length: the distance at which `strength` is the force
CLOSEST = 0.01  # of the length: nearer, the force grows no further
GRID, AROUND = 10, 0.2  # centres tried along each axis, and how far beyond the rope, of its length
FIRST_SHAPES = ((0.0, 5.0), (0.0, 15.0), (2.0, 0.0))  # tried: powers and decays over the length
STARTS, APART = 2, 0.15  # of the length: centres that are nearer are one
LARGEST = 100.0  # usual strengths
SHORTEST = 0.03  # of the length: over which a force falls by e; a shorter one is a contact
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(10)


@dataclass(frozen=True)
class Radial(Field):
    """The energy of a force per length F(r) = strength (r0/r)^power exp((r0 - r) decay) away from
    `centre` (3,) [m], r0 = `reference` [m]; level within the distance `closest` [m]."""

    strength: np.ndarray
    power: np.ndarray
    decay: np.ndarray
    centre: np.ndarray
    reference: float
    closest: float

    def force(self, r: np.ndarray) -> np.ndarray:
        """Return the force per length [N/m] at distances r (...) [m]."""
        r = np.maximum(r, self.closest)
        falling = (self.reference / r) ** self.power * np.exp((self.reference - r) * self.decay)
        return self.strength * falling

    def __call__(self, x: np.ndarray) -> np.ndarray:
        # Zero at the reference distance.
        r = np.maximum(np.linalg.norm(x - self.centre, axis=-1), self.closest)
        half = 0.5 * np.log(r / self.reference)[..., None]
        at = self.reference * np.exp(half * (POINTS + 1))
        return -(half * self.force(at) * at * WEIGHTS).sum(-1)

    def force_at(self, x: np.ndarray) -> np.ndarray:
        arm = x - self.centre
        r = np.maximum(np.linalg.norm(arm, axis=-1), self.closest)
        return (self.force(r) / r)[..., None] * arm

    def derivatives(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        arm = x - self.centre
        far = np.linalg.norm(arm, axis=-1)
        r = np.maximum(far, self.closest)
        way, force = arm / r[..., None], self.force(r)
        along = force * (self.power / r + self.decay) * (far > self.closest)  # -dF/dr
        square = way[..., :, None] * way[..., None, :]
        across = np.eye(3) - square
        rows = along[..., None, None] * square - (force / r)[..., None, None] * across
        return -force[..., None] * way, rows


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

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        length = float(setup.properties.length.sum())
        centre = middle_of(setup) + values[3:]
        reference, closest = REFERENCE * length, CLOSEST * length
        field = Radial(values[0], values[1], values[2], centre, reference, closest)
        return with_field(setup, field)

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Return the two points and laws of a force that explains most of the misfit, to first
        order."""
        setup = misfit.setup
        length, middle = float(setup.properties.length.sum()), middle_of(setup)
        good = misfit.nodes[np.isfinite(misfit.nodes).all((1, 2))]
        low, high = (f(good, axis=(0, 1)) for f in (np.min, np.max))
        edges = np.linspace(low - AROUND * length, high + AROUND * length, GRID)
        centres = np.stack(np.meshgrid(*edges.T, indexing="ij"), -1).reshape(-1, 3) - middle
        tried = [np.insert(centres, [0, 0], [n, d / length], axis=1) for n, d in FIRST_SHAPES]
        lower, upper = (np.array(v) for v in self.bounds(setup))
        reference, closest = REFERENCE * length, CLOSEST * length

        def field(shapes: np.ndarray) -> Radial:
            limited = np.clip(shapes, lower[1:], upper[1:])
            power, decay, *place = limited.T[..., None, None]
            centre = np.stack(place, axis=-1) + middle
            return Radial(np.ones(()), power, decay, centre, reference, closest)

        def alike(a: np.ndarray, b: np.ndarray) -> bool:
            return bool(np.linalg.norm(a[2:] - b[2:]) < APART * length)

        widths = np.array(
            [0.5, 3 / length, *(3 * [0.5 * float(np.ptp(edges, axis=0).max()) / GRID])]
        )
        found = best_shapes(misfit, np.concatenate(tried), field, widths, alike, STARTS, upper[0])
        return [
            [np.array([part * size, *np.clip(shape, lower[1:], upper[1:])]) for part in SHARES]
            for size, shape in found
        ]

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


def _field_of(setup: Setup) -> Radial | None:
    """Return the force from a point that acts in a setup, if one does."""
    energies = (p.energy for p in setup.potentials)
    return next((e for e in energies if isinstance(e, Radial)), None)


def _curve(setup: Setup, x: np.ndarray) -> np.ndarray:
    """Return (n,) forces per length [N/m] at distances x (n,) [m]."""
    field = _field_of(setup)
    return np.zeros_like(x) if field is None else field.force(x)


def _distances(setup: Setup, nodes: np.ndarray) -> np.ndarray:
    """Return the distances [m] of the nodes (F, N+1, 3) [m] from the centre."""
    field = _field_of(setup)
    assert field is not None
    return np.linalg.norm(nodes - field.centre, axis=-1).ravel()


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
    centre = field.centre - middle_of(setup)
    lower, upper = effect.bounds(setup)
    usual = [q.size(setup) for q in effect.quantities]

    def form(name: str, shape: int, tries: np.ndarray, constants) -> Form:
        kept = np.array([0, shape, 3, 4, 5])

        def apply(s: Setup, v: np.ndarray) -> Setup:
            values = np.zeros(6)
            values[kept] = v
            return effect.apply(s, values)

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
