"""Kirchhoff's rod in space, solved as a boundary-value problem.

It shares no code and no discretisation with ropefit: no nodes, springs or iterations, but the
rod's differential equations (`rod_equations`) at fourth order (`collocation`), continued from the
catenary.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from reference_simulators import rod_equations
from reference_simulators.collocation import NotConverged, derivatives, solve
from reference_simulators.rod_equations import Array, Rod, rotation

PINNED, CLAMPED, ROLLING, FREE = "pinned", "clamped", "rolling", "free"


@dataclass(frozen=True)
class Ends:
    """How both ends are held in T frames.

    `positions` (T, 2, 3) [m]; `orientations` (T, 2, 4) quaternions (w, x, y, z), material ->
    recording; `kinds`: pinned, clamped, rolling (tangent held, free to spin) or free.
    """

    positions: Array
    orientations: Array
    kinds: tuple[str, str]


@dataclass(frozen=True)
class RodProblem:
    """A rod and its end conditions as a `collocation.Problem`."""

    rod: Rod
    held: Ends
    mesh: Array
    gauge: bool = False  # nothing holds the spin: that of end 0 is fixed

    def slope(self, y: Array) -> tuple[Array, Array]:
        return rod_equations.slope(self.rod, 0.5 * (self.mesh[1:] + self.mesh[:-1]), y)

    def jump(self, y: Array) -> tuple[Array, dict[int, Array]]:
        return rod_equations.jump(self.rod, self.mesh, y)

    def ends(self, frames: NDArray[np.int_], first: Array, last: Array) -> tuple[Array, Array]:
        sides = []
        for end, (y, outward) in enumerate(((first, -1.0), (last, 1.0))):
            kind = self.held.kinds[end]
            place = y[:, :3] - self.held.positions[frames, end]
            wanted = rotation(self.held.orientations[frames, end])
            frame = rotation(y[:, 3:7])
            tangent, moment = frame[..., 2], y[:, 10:]
            spring = self.rod.end_springs[end]
            if spring is not None:  # the clamp's moment on the rope turns it towards a direction
                stiffness, direction = spring
                moment = moment - outward * stiffness * np.cross(tangent, direction)
            error = wanted.swapaxes(-1, -2) @ frame
            twist = _roll(error)
            spin = (moment * tangent).sum(-1)
            lean = error[:, :2, 2]
            if kind == FREE:
                rows = [y[:, 7:10], moment]
            elif kind == PINNED:
                # In a torque-free rod of no preferred side one of the spins says nothing.
                across = (frame[..., :2].swapaxes(-1, -2) @ moment[..., None])[..., 0]
                third = twist if self.gauge and end == 0 else spin
                rows = [place, across, third[:, None]]
            elif kind == CLAMPED:
                rows = [place, lean, twist[:, None]]
            else:
                third = twist if self.gauge and end == 0 else spin
                rows = [place, lean, third[:, None]]
            if end == 0:
                rows.append((y[:, 3:7] * y[:, 3:7]).sum(-1)[:, None] - 1.0)
            sides.append(np.concatenate(rows, axis=1))
        return sides[0], sides[1]


def _roll(turn: Array) -> Array:
    """Return the angles (T,) [rad] of turns (T, 3, 3) about their third axes, complex-safe. Their
    sines would be zero for half a turn, too: a rope twisted by 2 rad would end at 2 - pi."""
    side, ahead = turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1]
    angle = np.arctan2(side.real, ahead.real)
    c, s = np.cos(angle), np.sin(angle)
    return angle + np.arctan((side * c - ahead * s) / (ahead * c + side * s))


def problem(rod: Rod, held: Ends, elements: int = 80, breaks: list[float] | None = None):
    """Return the problem on a mesh that resolves the rod's breaks and `breaks` [m]."""
    free = CLAMPED not in held.kinds and rod.isotropic
    inside = [s for s in breaks or [] if 1e-6 < s < rod.length - 1e-6]
    places = sorted({*rod.breaks, *inside})
    return RodProblem(rod, held, _mesh(rod, places, elements), free)


def _mesh(rod: Rod, breaks: list[float], elements: int) -> Array:
    """Return arc lengths (N + 1,) [m]: nodes on the breaks, finer there and at the ends."""
    layer = np.sqrt(rod.bending / (0.3 * rod.density * 9.81 * rod.length))
    corners = np.array([0.0, *breaks, rod.length])
    s = np.linspace(0, rod.length, 4001)
    wanted = np.ones_like(s)
    for corner in corners:
        wanted += min(3.0, 0.15 * rod.length / layer) * np.exp(-np.abs(s - corner) / (1.5 * layer))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (wanted[1:] + wanted[:-1]))])
    total *= elements / total[-1]
    at = np.interp(corners, s, total)
    parts = [
        np.interp(np.linspace(a, b, max(3, round(b - a) + 1))[:-1], total, s)
        for a, b in pairwise(at)
    ]
    mesh = np.concatenate([*parts, [rod.length]])
    for corner in corners:
        mesh[np.argmin(np.abs(mesh - corner))] = corner
    return mesh


def catenary(rod: Rod, first: Array, last: Array, s: Array) -> tuple[Array, Array]:
    """Return tangents (n, 3) and forces (n, 3) [N] of an inextensible string without stiffness.

    `first`, `last` (3,) [m] are its ends; `s` (n,) [m].
    """
    g = np.asarray(rod.gravity)
    up, weight = -g / np.linalg.norm(g), rod.density * float(np.linalg.norm(g))
    chord = last - first
    rise = float(chord @ up)
    level = chord - rise * up
    width = max(float(np.linalg.norm(level)), 0.02 * rod.length)
    ahead = level / max(float(np.linalg.norm(level)), 1e-12)
    goal = np.sqrt(max(rod.length**2 - rise**2, (1.0005 * width) ** 2)) / width
    x: Any = brentq(lambda v: np.sinh(v) / v - goal, 1e-4, 60.0)  # half width over the parameter a
    a = width / (2 * x)
    # Rise over length is the tanh of the middle's distance from the lowest point, over a.
    centre = 0.5 * width - a * np.arctanh(np.clip(rise / rod.length, -0.999999, 0.999999))
    middle = a * np.sinh(centre / a)
    force = weight * (a * ahead + np.multiply.outer(s - middle, up))
    return force / np.linalg.norm(force, axis=1, keepdims=True), force


def parallel_transport(tangents: Array, start: Rotation) -> Array:
    """Return quaternions (n, 4) of frames transported along unit tangents (n, 3)."""
    now, out = start, []
    for t in tangents:
        d3 = now.as_matrix()[:, 2]
        now = Rotation.from_quat(np.append(np.cross(d3, t), 1 + d3 @ t)) * now
        out.append(np.roll(now.as_quat(), 1))
    out = np.array(out)
    for i in range(1, len(out)):
        out[i] *= np.sign(out[i] @ out[i - 1])
    return out


def facing(tangent: Array) -> Rotation:
    """Return a material frame with this tangent (3,) and its first axis near the vertical."""
    side = np.cross([0.0, 0.0, 1.0], tangent)
    side = side / np.linalg.norm(side)
    return Rotation.from_matrix(np.stack([np.cross(side, tangent), side, tangent], axis=1))


def hang(rod: Rod, held: Ends, elements: int = 80, breaks: list[float] | None = None):
    """Solve a rope without twist: return the problem and its states (T, N + 1, 13).

    Clamps hold the tangents (third axes of `held.orientations`) and let the rope spin, as when the
    gripper took hold of it there. The branch is the one continued from the catenary.
    """
    plain = replace(rod, end_springs=(None, None))
    kinds = tuple(PINNED if kind == PINNED else ROLLING for kind in held.kinds)
    wanted = rotation(held.orientations)[..., 2]
    pinned = [end for end in range(2) if held.kinds[end] == PINNED]
    mesh = problem(plain, held, elements, breaks).mesh
    y = np.zeros((len(held.positions), len(mesh), rod_equations.SIZE))
    own = np.empty_like(wanted)
    for frame, (first, last) in enumerate(held.positions):
        tangents, force = catenary(plain, first, last, mesh)
        y[frame, :, 3:7] = parallel_transport(tangents, facing(tangents[0]))
        y[frame, :, 7:10] = force
        half = 0.5 * np.diff(mesh)[:, None] * (tangents[1:] + tangents[:-1])
        y[frame, :, :3] = first + np.concatenate([np.zeros((1, 3)), np.cumsum(half, axis=0)])
        own[frame] = tangents[0], tangents[-1]
    wanted[:, pinned] = own[:, pinned]

    def at(part: float) -> RodProblem:
        directions = own + part * (wanted - own)
        turns = np.array(
            [
                [np.roll(facing(d / np.linalg.norm(d)).as_quat(), 1) for d in pair]
                for pair in directions
            ]
        )
        eased = replace(plain, bending=plain.bending * 10.0 ** (part - 1))
        eased = replace(eased, torsion=plain.torsion)
        ends = Ends(held.positions, turns, (kinds[0], kinds[1]))
        return RodProblem(eased, ends, mesh, gauge=True)

    y = follow(at, y, first=0.0)
    return at(1.0), y


def follow(at, y: Array, first: float | None = None, least: float = 1 / 256) -> Array:
    """Continue states `y` near `at(0.0)` to `at(1.0)`, in as few steps as converge.

    `at` returns the problem at a share of the way. Raises NotConverged where a step falls below
    `least`.
    """
    done, step = 0.0, 1.0
    if first is not None:
        y = solve(at(first), y, most=40)
        step = 0.25
    while done < 1.0:
        goal = min(1.0, done + step)
        try:
            y = solve(at(goal), y, most=12)
        except (NotConverged, np.linalg.LinAlgError):
            step *= 0.5
            if step < least:
                raise NotConverged(f"stuck at {done:.3f} of the way") from None
            continue
        done, step = goal, step * 1.5
    return y


__all__ = ["CLAMPED", "FREE", "PINNED", "ROLLING", "Ends", "Rod", "catenary", "derivatives", "hang"]
