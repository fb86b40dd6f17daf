"""Kirchhoff's rod in space as an ordinary differential equation in arc length.

State, 13 numbers: position x [m], quaternion q (w, x, y, z) of the material frame (its third axis
is the tangent, towards end 1), force n [N] and moment m [N m] that the part towards end 1 exerts
on the part towards end 0, all in the recording's axes.

    x' = (1 + strain(n.d3)) d3     q' = q (0, u) / 2     n' = -f(x)     m' = -x' x n
    u = rest curvature + compliance (R^T m)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_simulators import inner_friction

Array = NDArray[np.float64]
SIZE = 13


@dataclass(frozen=True)
class Field:
    """A force per length [N/m] that pushes away from something, by the distance d [m] to it.

    `axis` (3,) is the normal of a plane, the direction of a bar, or zero for a point; `point` (3,)
    [m] lies on it. Force: hardness * max(0, reach - d), or strength * exp(-d / reach) if `soft`,
    or strength * (reach / d)^power; or strength / (1 + exp(d / reach)), if `filled`.
    """

    point: Array
    axis: Array
    reach: float  # m
    hardness: float  # N/m², or N/m when soft
    kind: str  # plane, bar
    soft: bool = False
    power: float = 0.0
    filled: bool = False

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Return the distance (…) [m] of x (…, 3) [m], and the unit vector (…, 3) away from it."""
        across = x - self.point
        if self.kind == "plane":
            return across @ self.axis, np.broadcast_to(self.axis, x.shape)
        across = across - (across @ self.axis)[..., None] * self.axis
        d = np.sqrt((across * across).sum(-1))
        return d, across / d[..., None]

    def force(self, x: Array) -> tuple[Array, Array]:
        """Return the force (…, 3) per length [N/m] at x (…, 3) [m], and the derivative by x."""
        d, n = self.distance(x)
        turning = np.zeros((*x.shape, 3))
        if self.kind != "plane":
            outer = np.outer(self.axis, self.axis)
            turning = (np.eye(3) - outer - n[..., :, None] * n[..., None, :]) / d[..., None, None]
        if self.soft:
            size = self.hardness * np.exp(-d / self.reach)
            slope = -size / self.reach
        elif self.filled:
            share = 1 / (1 + np.exp(np.clip(d / self.reach, -500, 500)))
            size = self.hardness * share
            slope = -size * (1 - share) / self.reach
        elif self.power:
            size = self.hardness * (self.reach / d) ** self.power
            slope = -self.power * size / d
        else:
            size = self.hardness * np.maximum(0.0, self.reach - d)
            slope = np.where(d < self.reach, -self.hardness, 0.0)
        rate = slope[..., None, None] * n[..., :, None] * n[..., None, :]
        return size[..., None] * n, rate + size[..., None, None] * turning


@dataclass(frozen=True)
class Section:
    """Between `start` and `end` [m]: factors of weight and bending rigidity, rest curvature."""

    start: float
    end: float
    density: float = 1.0
    bending: float = 1.0
    curvature: tuple[float, float] = (0.0, 0.0)  # 1/m, about the material axes 1 and 2


@dataclass(frozen=True)
class Point:
    """Something at one arc length [m]."""

    at: float
    mass: float = 0.0  # kg
    turn: tuple[float, float] = (0.0, 0.0)  # rad, rest angle about the material axes 1 and 2
    spring: float = 0.0  # N/m, to `anchor`
    anchor: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m
    follower: tuple[float, float, float] = (0.0, 0.0, 0.0)  # N, in the material frame


@dataclass(frozen=True)
class Inside:
    """A bending rigidity [N m²] in every element beside the rope's own, without moment at curvature
    centre (N, 2) [1/m], whose moment no longer grows beyond `slip` [1/m].

    With `strain` (N, 2) [1/m] it is Dahl's friction: from that elastic curvature at the centre, the
    elastic curvature e changes along a straight way k by de = dk - e |dk| / slip.
    """

    rigidity: float
    centre: Array
    slip: float
    strain: Array | None = None


@dataclass(frozen=True)
class Rod:
    """A rope and what acts on it, in all frames alike."""

    length: float  # m
    density: float  # kg/m
    bending: float  # EI [N m²]
    torsion: float  # GJ [N m²]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)  # m/s²
    compliance: float = 0.0  # 1/EA [1/N]
    load: tuple[float, float, float] = (0.0, 0.0, 0.0)  # N/m
    sections: tuple[Section, ...] = ()
    points: tuple[Point, ...] = ()
    fields: tuple[Field, ...] = ()
    softening: float = 0.0  # 1/(N m)²: curvature grows by (1 + softening |m|²)
    bent: Any = None  # instead of EI: the curvature and its derivative as functions of the moment
    stretched: Any = None  # instead of 1/EA: likewise the strain, of the tension
    inside: Inside | None = None
    end_springs: tuple[Any, Any] = field(default=(None, None))
    # each None or (stiffness [N m/rad], direction (3,) towards end 1)

    @property
    def breaks(self) -> list[float]:
        """Return the arc lengths [m] where something changes."""
        inside = [s for part in self.sections for s in (part.start, part.end)]
        inside += [point.at for point in self.points]
        return sorted({s for s in inside if 1e-6 < s < self.length - 1e-6})

    def strain(self, tension: Array) -> tuple[Array, Array]:
        """Return the axial strain at tensions [N], and its derivative [1/N]."""
        if self.stretched is not None:
            return self.stretched(tension)
        return self.compliance * tension, np.full_like(tension, self.compliance)

    @property
    def isotropic(self) -> bool:
        """Return whether spinning about its own axis changes nothing."""
        curved = any(any(part.curvature) for part in self.sections)
        return not curved and not any(any(p.turn) or any(p.follower) for p in self.points)


def rotation(q: Array) -> Array:
    """Return the matrices (…, 3, 3) of quaternions (…, 4) that need not be unit; complex-safe."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


# The rotation matrix is quadratic in q, so its derivative by q_k is linear in q: TENSOR[k] . q.
_UNIT = np.eye(4)
TENSOR = np.stack(
    [
        np.stack(
            [
                0.5 * (rotation(_UNIT[k] + _UNIT[i]) - rotation(_UNIT[k] - _UNIT[i]))
                for i in range(4)
            ],
            axis=-1,
        )
        for k in range(4)
    ],
    axis=-2,
)  # (3, 3, k, i)


def left_matrix(q: Array) -> Array:
    """Return (…, 4, 3): q times the pure quaternion (0, u) is left_matrix(q) @ u."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def right_matrix(u: Array) -> Array:
    """Return (…, 4, 4): q times (0, u) is right_matrix(u) @ q."""
    a, b, c = np.moveaxis(u, -1, 0)
    o = np.zeros_like(a)
    rows = [[o, -a, -b, -c], [a, o, c, -b], [b, -c, o, a], [c, b, -a, o]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def skew(v: Array) -> Array:
    """Return (…, 3, 3): skew(v) @ w is v x w."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    rows = [[o, -z, y], [z, o, -x], [-y, x, o]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def slope(rod: Rod, middle: Array, y: Array) -> tuple[Array, Array]:
    """Return y' (T, N, 13) and its derivative (T, N, 13, 13).

    `middle` (N,) [m] tells the section.
    """
    x, q, n, m = y[..., :3], y[..., 3:7], y[..., 7:10], y[..., 10:]
    density = _coefficients(rod, middle)[1]
    turn = rotation(q)
    by_q = TENSOR @ q[..., None, None, :, None]
    by_q = by_q[..., 0]  # (…, 3, 3, 4)
    body = (turn.swapaxes(-1, -2) @ m[..., None])[..., 0]
    body_by_q = np.einsum("...ijk,...i->...jk", by_q, m)
    u, u_by_body = curvatures(rod, middle, body)

    d3, d3_by_q = turn[..., 2], by_q[..., 2, :]
    strain, rate = rod.strain((n * d3).sum(-1)[..., None])
    stretch, rate = 1 + strain, rate[..., None]
    tangent = stretch * d3
    tangent_by_q = stretch[..., None] * d3_by_q + rate * (
        d3[..., :, None] * (n[..., None, :] @ d3_by_q)
    )
    tangent_by_n = rate * d3[..., :, None] * d3[..., None, :]

    force = density * np.asarray(rod.gravity) + np.asarray(rod.load)
    out, a = np.zeros_like(y), np.zeros((*y.shape, SIZE))
    out[..., :3] = tangent
    left = left_matrix(q)
    out[..., 3:7] = 0.5 * (left @ u[..., None])[..., 0]
    out[..., 7:10] = -force
    out[..., 10:] = -np.cross(tangent, n)
    for one in rod.fields:
        push, rate = one.force(x)
        out[..., 7:10] -= push
        a[..., 7:10, :3] -= rate
    a[..., :3, 3:7], a[..., :3, 7:10] = tangent_by_q, tangent_by_n
    through = 0.5 * left @ u_by_body
    a[..., 3:7, 3:7] = 0.5 * right_matrix(u) + through @ body_by_q
    a[..., 3:7, 10:] = through @ turn.swapaxes(-1, -2)
    across = skew(n)
    a[..., 10:, 3:7] = across @ tangent_by_q
    a[..., 10:, 7:10] = across @ tangent_by_n - skew(tangent)
    return out, a


def curvatures(rod: Rod, middle: Array, body: Array) -> tuple[Array, Array]:
    """Return curvatures and twist (…, N, 3) [1/m] under moments, with the derivative (…, N, 3, 3).

    Moments `body` (…, N, 3) [N m] in the material frame.
    """
    flexibility, _, rest = _coefficients(rod, middle)
    squared = (body * body).sum(-1)[..., None]
    bent = 1 + rod.softening * squared
    u = rest + flexibility * body * bent
    slope = flexibility[..., None] * (
        bent[..., None] * np.eye(3) + 2 * rod.softening * body[..., :, None] * body[..., None, :]
    )
    if rod.bent is not None:
        across = body[..., :2]
        size = np.sqrt((across * across).sum(-1))[..., None]
        curvature, rate = rod.bent(size)
        way, ratio = across / np.maximum(size, 1e-300), curvature / np.maximum(size, 1e-300)
        outer = way[..., :, None] * way[..., None, :]
        u, slope = u.copy(), slope.copy()
        u[..., :2] = rest[..., :2] + curvature * way
        slope[..., :2, :] = 0.0
        slope[..., :2, :2] = ratio[..., None] * np.eye(2) + (rate - ratio)[..., None] * outer
    if rod.inside is None:
        return u, slope
    own, inside = 1 / flexibility[..., :1], rod.inside  # the same about both axes
    left = body[..., :2] - own * (inside.centre - rest[..., :2])
    u, slope = u.copy(), slope.copy()
    friction = (left, own, inside.rigidity, inside.slip)
    d, slope[..., :2, :2] = (
        inner_friction.prandtl(*friction)
        if inside.strain is None
        else inner_friction.dahl(*friction, inside.strain)
    )
    u[..., :2] = inside.centre + d
    return u, slope


def _coefficients(rod: Rod, middle: Array) -> tuple[Array, Array, Array]:
    """Return compliances (N, 3) [1/(N m²)], density (N, 1) [kg/m], rest curvature (N, 3) [1/m]."""
    bending, density = np.full(len(middle), rod.bending), np.full(len(middle), rod.density)
    torsion, rest = np.full(len(middle), rod.torsion), np.zeros((len(middle), 3))
    for part in rod.sections:
        inside = (middle > part.start) & (middle < part.end)
        bending[inside] *= part.bending
        torsion[inside] *= part.bending
        density[inside] *= part.density
        rest[inside, :2] += part.curvature
    return 1 / np.stack([bending, bending, torsion], axis=1), density[:, None], rest


def jump(rod: Rod, mesh: Array, y: Array) -> tuple[Array, dict[int, Array]]:
    """Return y (T, N, 13) just behind the left nodes of the elements.

    And the derivatives (T, 13, 13), by element, where it differs.
    """
    out, turned = y.copy(), {}
    for point in rod.points:
        element = int(np.argmin(np.abs(mesh[:-1] - point.at)))
        here = out[:, element].copy()
        factor = np.tile(np.eye(SIZE), (len(y), 1, 1))
        pull = point.spring * (np.asarray(point.anchor) - here[:, :3])
        follow = rotation(here[:, 3:7]) @ np.asarray(point.follower)
        out[:, element, 7:10] -= point.mass * np.asarray(rod.gravity) + pull + follow
        factor[:, 7:10, :3] += point.spring * np.eye(3)
        bent = TENSOR @ here[:, None, None, 3:7, None]
        factor[:, 7:10, 3:7] -= np.einsum("tijk,j->tik", bent[..., 0], np.asarray(point.follower))
        if any(point.turn):
            angle = float(np.hypot(*point.turn))
            axis = np.array([*point.turn, 0.0]) / angle
            step = np.cos(angle / 2) * np.eye(4) + np.sin(angle / 2) * right_matrix(axis)
            out[:, element, 3:7] = here[:, 3:7] @ step.T
            factor[:, 3:7, 3:7] = step
        turned[element] = factor @ turned[element] if element in turned else factor
    return out, turned
