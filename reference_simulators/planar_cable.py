"""A heavy cable held at its base in a plane: a chain of rigid pieces with any joints.

In the plane of x and z with gravity along -z. The joints bend by a law that softens, and rub: a
second spring slips beyond a curvature. Followed pose after pose in small turns of the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.81
TURN = 0.1  # rad, of the base in one step
ITERATIONS, EXACT = 200, 1e-11


@dataclass(frozen=True)
class Cable:
    """length [m] of N pieces of together `mass` [kg]; bend (N,) [N m²] and rest (N,) [rad] of the
    joints before each; weights: place (share of the length) and mass [kg] of each.

    soft [1/m]: curvature at which the moment is half of a linear law's (infinite: linear); rub, of
    `bend`: rigidity of the springs that slip at the curvature `slip` [1/m].
    """

    length: float
    mass: float
    bend: Array
    rest: Array
    weights: tuple[tuple[float, float], ...] = ()
    soft: float = np.inf
    rub: float = 0.0
    slip: float = np.inf

    @property
    def piece(self) -> float:
        """Return the length of a piece [m]."""
        return self.length / len(self.bend)

    @property
    def part(self) -> Array:
        """Return (N,) [m] the length that bends in each joint: half a piece in the first."""
        return self.piece * np.where(np.arange(len(self.bend)) == 0, 0.5, 1.0)

    def carried(self) -> Array:
        """Return (N,) [N] what hangs on each piece: all beyond, and half of itself."""
        count = np.arange(len(self.bend))
        own = self.mass * (len(count) - count - 0.5) / len(count)
        for place, mass in self.weights:
            own = own + mass * np.clip(place * len(count) - count, 0, 1)
        return GRAVITY * own

    def moments(self, bent: Array, slipped: Array) -> tuple[Array, Array]:
        """Return (N,) [N m] moments of joints bent by (N,) [rad], and their derivatives."""
        stiff = self.bend / self.part
        over = 1 + np.abs(bent - self.rest) / self.part / self.soft
        held = bent - slipped
        most = self.slip * self.part
        moment = stiff * (bent - self.rest) / over + self.rub * stiff * np.clip(held, -most, most)
        return moment, stiff / over**2 + self.rub * stiff * (np.abs(held) < most)


def poses(cable: Cable, bases: Array, places: Array) -> Array:
    """Return positions (F, M, 2) [m] at places (M,), shares of the length, with the base turned to
    each of the angles (F,) [rad], in that order from hanging."""
    angle = np.full(len(cable.bend), -np.pi / 2)
    slipped, now, out = np.zeros_like(angle), -np.pi / 2, []
    at = np.linspace(0, 1, len(angle) + 1)
    for base in bases:
        steps = max(int(abs(base - now) / TURN), 3)
        for between in np.linspace(now, base, steps + 1)[1:]:
            angle = _settled(cable, between, angle, slipped)
            bent = np.diff(angle, prepend=between)
            most = cable.slip * cable.part
            slipped = np.clip(slipped, bent - most, bent + most)
        now = base
        along = cable.piece * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        x = np.concatenate([np.zeros((1, 2)), np.cumsum(along, axis=0)])
        out.append(np.stack([np.interp(places, at, x[:, k]) for k in range(2)], axis=1))
    return np.array(out)


def _settled(cable: Cable, base: float, angle: Array, slipped: Array) -> Array:
    """Return angles (N,) of the pieces in equilibrium, by Newton's method from others."""
    carried, piece, count = cable.carried(), cable.piece, np.arange(len(angle) - 1)

    def balance(angle: Array) -> tuple[Array, Array]:
        moment, slope = cable.moments(np.diff(angle, prepend=base), slipped)
        return moment - np.append(moment[1:], 0) + piece * np.cos(angle) * carried, slope

    left, slope = balance(angle)
    for _ in range(ITERATIONS):
        matrix = np.diag(slope + np.append(slope[1:], 0) - piece * np.sin(angle) * carried)
        matrix[count, count + 1] = matrix[count + 1, count] = -slope[1:]
        least = float(np.linalg.eigvalsh(matrix)[0])
        if least <= 0:  # unstable: towards an equilibrium that is not
            matrix += (0.05 * slope.mean() - least) * np.eye(len(angle))
        step = np.linalg.solve(matrix, -left)
        step *= min(1.0, 0.5 / np.abs(step).max())
        while True:
            there, its = balance(angle + step)
            if np.linalg.norm(there) < np.linalg.norm(left) or np.abs(step).max() < 1e-6:
                break
            step = step / 2
        angle, left, slope = angle + step, there, its
        if np.linalg.norm(left) < EXACT * float((cable.bend / piece).mean()):
            break
    return angle
