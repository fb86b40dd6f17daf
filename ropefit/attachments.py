"""What is attached to a rope besides its own matter, as simulators take it: records in SI units."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Vector = tuple[float, float, float]


def vector(v: Iterable[float]) -> Vector:
    """Return three numbers as a `Vector`."""
    x, y, z = map(float, v)
    return x, y, z


@dataclass(frozen=True)
class PointMass:
    """`mass` [kg] hung on node `node`, besides the rope's own."""

    node: int
    mass: float


@dataclass(frozen=True)
class Plane:
    """A support through `point` [m]; the rope stays on the side that `normal` points to.

    friction: Coulomb coefficient.
    """

    point: Vector
    normal: Vector
    friction: float = 0.0


@dataclass(frozen=True)
class Sphere:
    """A fixed ball that the rope cannot enter: centre and radius [m]."""

    centre: Vector
    radius: float
    friction: float = 0.0


@dataclass(frozen=True)
class Cylinder:
    """A fixed round bar from `start` to `stop` [m] with `radius` [m] that the rope cannot enter."""

    start: Vector
    stop: Vector
    radius: float
    friction: float = 0.0


@dataclass(frozen=True)
class Tether:
    """A spring of `stiffness` [N/m] from node `node` to `anchor` [m]; slack below `rest_length`."""

    node: int
    anchor: Vector
    stiffness: float
    rest_length: float


@dataclass(frozen=True)
class EndTwist:
    """End `end` (0 or 1) turned about the rope's tangent by `angle` [rad]."""

    end: int
    angle: float


@dataclass(frozen=True)
class BendingFriction:
    """Friction that resists every change of bending: at most `moment` [N m], built up over a change
    of curvature by `range` [1/m] from none in a pose that is given: in proportion to it (Prandtl),
    or as 1 - exp(-change / range), after a reversal over the same range (Dahl)."""

    moment: float
    range: float
    law: Literal["Prandtl", "Dahl"] = "Prandtl"


Effect = PointMass | Plane | Sphere | Cylinder | Tether | EndTwist | BendingFriction
