"""RopeDescription: what an exporter is given, whatever model it came from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ropefit.attachments import (
    BendingFriction,
    Cylinder,
    Effect,
    EndTwist,
    Plane,
    PointMass,
    Sphere,
    Tether,
)
from ropefit.errors import BadInput

EndKind = Literal["free", "pinned", "clamped"]
KINDS = ("free", "pinned", "clamped")


@dataclass(frozen=True)
class RopeDescription:
    """A rope of N segments and K = N + 1 nodes in P poses; SI units, float64 arrays.

    length: rest length [m]. rest_lengths: (N,) [m]. EA, GA: (N,) [N], inf = does not stretch.
    EI, GJ: (N-1,) [N m^2] at the inner nodes. rest_curvature: (N-1, 2) [1/m] about the material
    axes e1, e2; rest_twist: (N-1,) [1/m]. masses: (K,) lumped at the nodes [kg]. diameter [m], None
    if not known. gravity: (3,) [m/s^2]. end_kinds: of end 0 and end 1. end_positions: (P, 2, 3)
    [m]; end_orientations: (P, 2, 4) quaternions w x y z, R(q) e3 = the tangent from end 0 to end 1;
    NaN where not held. x: (P, K, 3) [m] centrelines of ropefit's own model. effects: what else
    acts. Raises BadInput when these do not fit together.
    """

    length: float
    rest_lengths: np.ndarray
    EA: np.ndarray
    GA: np.ndarray
    EI: np.ndarray
    GJ: np.ndarray
    rest_curvature: np.ndarray
    rest_twist: np.ndarray
    masses: np.ndarray
    diameter: float | None
    gravity: np.ndarray
    end_kinds: tuple[EndKind, EndKind]
    end_positions: np.ndarray
    end_orientations: np.ndarray
    x: np.ndarray
    effects: tuple[Effect, ...] = ()
    name: str = "rope"

    def __post_init__(self) -> None:
        self._check_shapes()
        self._check_values()
        self._check_ends()
        for effect in self.effects:
            self._check_effect(effect)

    @property
    def segments(self) -> int:
        """Return N."""
        return len(self.rest_lengths)

    @property
    def poses(self) -> int:
        """Return P."""
        return len(self.x)

    def _check_shapes(self) -> None:
        n, poses = len(self.rest_lengths), len(self.x)
        if n < 3:
            raise BadInput(f"a rope of {n} segments; at least 3 are needed to export one")
        if poses < 1:
            raise BadInput("a rope without a pose; give at least one")
        shapes = {
            "rest_lengths": (n,), "EA": (n,), "GA": (n,), "EI": (n - 1,), "GJ": (n - 1,),
            "rest_curvature": (n - 1, 2), "rest_twist": (n - 1,), "masses": (n + 1,),
            "gravity": (3,), "end_positions": (poses, 2, 3), "end_orientations": (poses, 2, 4),
            "x": (poses, n + 1, 3),
        }  # fmt: skip
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise BadInput(f"{name} has shape {getattr(self, name).shape}, not {shape}")

    def _check_values(self) -> None:
        for name in ("rest_lengths", "EI", "GJ", "masses"):
            array = getattr(self, name)
            if not (np.isfinite(array).all() and (array > 0).all()):
                raise BadInput(f"{name} must be positive and finite")
        for name in ("EA", "GA"):
            if not (getattr(self, name) > 0).all():  # infinite: does not stretch
                raise BadInput(f"{name} must be positive")
        for name in ("rest_curvature", "rest_twist", "gravity", "x"):
            if not np.isfinite(getattr(self, name)).all():
                raise BadInput(f"{name} must be finite")
        if not np.isclose(self.rest_lengths.sum(), self.length, rtol=1e-6):
            raise BadInput(f"rest_lengths add up to {self.rest_lengths.sum():g} m, not to length")
        if self.diameter is not None and not 0 < self.diameter < self.length:
            raise BadInput(f"a rope {self.length:g} m long and {self.diameter:g} m thick")

    def _check_ends(self) -> None:
        for end, kind in enumerate(self.end_kinds):
            if kind not in KINDS:
                raise BadInput(f"end {end} is {kind!r}; one of {', '.join(KINDS)}")
            if kind != "free" and not np.isfinite(self.end_positions[:, end]).all():
                raise BadInput(f"end {end} is {kind} but has a pose without a position")
            if kind == "clamped":
                norm = np.linalg.norm(self.end_orientations[:, end], axis=1)
                if not np.allclose(norm, 1, atol=1e-6):
                    raise BadInput(
                        f"end {end} is clamped but its orientation is no unit quaternion"
                    )

    def _check_effect(self, effect: Effect) -> None:
        what = type(effect).__name__
        numbers: list[float] = []
        for value in vars(effect).values():
            if not isinstance(value, str):
                numbers += list(value) if isinstance(value, tuple) else [value]
        if not np.isfinite(numbers).all():
            raise BadInput(f"{what}: every number of it must be finite")
        if isinstance(effect, PointMass | Tether) and not 0 <= effect.node <= self.segments:
            raise BadInput(f"{what}: node {effect.node} is not one of 0..{self.segments}")
        if isinstance(effect, PointMass) and effect.mass <= 0:
            raise BadInput(f"{what}: mass must be positive")
        if isinstance(effect, Plane) and not np.linalg.norm(effect.normal) > 1e-9:
            raise BadInput(f"{what}: normal is zero")
        if isinstance(effect, Sphere | Cylinder) and effect.radius <= 0:
            raise BadInput(f"{what}: radius must be positive")
        if isinstance(effect, Cylinder) and np.allclose(effect.start, effect.stop):
            raise BadInput(f"{what}: start and stop coincide")
        if isinstance(effect, Tether) and (effect.stiffness <= 0 or effect.rest_length < 0):
            raise BadInput(f"{what}: stiffness must be positive and rest_length not negative")
        if isinstance(effect, BendingFriction) and min(effect.moment, effect.range) <= 0:
            raise BadInput(f"{what}: moment and range must be positive")
        if isinstance(effect, EndTwist) and effect.end not in (0, 1):
            raise BadInput(f"{what}: end is 0 or 1")
