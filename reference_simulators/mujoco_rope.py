"""MuJoCo's discrete elastic rod (1D flex) with the loads of `rod_equations`, brought to rest.

It can have masses, sections of other weight or stiffness, steady loads, tethers, planes and
round bars (MuJoCo's own contact, with or without friction). It never twists: its edges spin freely.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from reference_simulators.kirchhoff_rod import CLAMPED, Ends
from reference_simulators.rod_equations import Array, Field, Rod, rotation

# Its functions come from a compiled module that type checkers cannot see.
mujoco: Any = importlib.import_module("mujoco")

TIMESTEP = 0.001  # s
DAMPING = 8.0  # 1/s, drag on every velocity, near critical for a metre of rope
MOVE_TIME, FIRST_MOVE_TIME = 1.0, 4.0  # s, simulated, from one pose to the next
SLOW_MOVE_TIME = 1.5  # s, where the way matters: drag stays a few hundredths of the weight
REST_SPEED = 5e-5  # m/s, largest velocity of a rope at rest
# The same where friction holds it: MuJoCo's friction gives way slowly for ever, and any state
# that it holds is one of rest.
HELD_SPEED = 1e-4
MOST_TIME = 30.0  # s, to come to rest
HARDER = 100  # friction against normal force, as constraints
EXACT = 1e-14  # tolerance of the solver of constraints where there is friction
EDGES = 120
# Between clamps a flexible rope bends within a few of them: 120 are 0.65 mm off (rms, of a metre,
# EI/(ρgL³) = 1.5e-4), which noise of 1 mm does not hide; 240 are 0.18 mm off.
CLAMPED_EDGES = 240
LONG_BAR = 5.0  # m
STILL = (np.zeros(3), np.zeros(3))
Drag = float | Callable[[Array], Array]
# One record of `flex_bending` a bend: 4 vertices, bending, two rest values, joint, twist, spare.
RECORD, BENDING, TWISTING = 10, 4, 8


def shapes(rod: Rod, held: Ends, diameter: float, rough: float = 0.0) -> tuple[Array, Array]:
    """Return arc lengths (n,) [m] and centrelines (T, n, 3) [m] of all frames, each at rest.

    diameter [m]; rough: the coefficient of friction on what the rope touches. Raises RuntimeError
    where the rope keeps moving.
    """
    rope = Rope(rod, held, diameter, rough)
    return rope.arc_length, np.stack([rope.settled(frame) for frame in range(len(rope.ends))])


def tangents(arc_length: Array, nodes: Array) -> Array:
    """Return the derivatives (T, n, 3) of centrelines by arc length."""
    return CubicSpline(arc_length, nodes, axis=1)(arc_length, 1)


class Rope:
    """A rope whose end 1 is fixed and whose end 0 is led from pose to pose.

    A clamp holds the direction of a whole edge; the clamped edges straddle the clamping points, so
    that no part of the rope between the clamps is kept from bending.
    """

    def __init__(self, rod: Rod, held: Ends, diameter: float, rough: float = 0.0):
        self.clamped = held.kinds[0] == CLAMPED
        self.ends = held.positions
        self.directions = rotation(held.orientations)[..., 2]
        edges = CLAMPED_EDGES if self.clamped else EDGES
        spacing = rod.length / edges
        self.half = 0.5 * spacing
        self.held = 2 if self.clamped else 1
        self.move_time = SLOW_MOVE_TIME if rough else MOVE_TIME
        self.slowest = HELD_SPEED if rough else REST_SPEED
        vertices = edges + self.held
        reach = spacing * np.arange(vertices - 1, -1, -1) - (self.half if self.clamped else 0.0)
        first, last = self.ends[0]
        way = (
            self.directions[0, 1] if self.clamped else (last - first) / np.linalg.norm(last - first)
        )
        self.straight = last - np.outer(reach, way)
        # Arc length of each vertex; clamped ones lie half an edge before and behind the end.
        self.at = rod.length - reach
        self.arc_length = np.concatenate([[0.0], self.at[1:-1], [rod.length]])
        self.model = mujoco.MjModel.from_xml_string(
            _xml(rod, self.straight, spacing, diameter, self.held, rough)
        )
        self._weigh(rod, spacing)
        self._stiffen(rod)
        if rough:
            self._untwist()
        self.model.dof_armature[: 3 * self.held] = 1e3  # the rope cannot push what leads it
        # Or thin edges would ring about themselves. A rope that is free to spin rolls sideways
        # instead of rubbing: where it rubs, its edges do not spin.
        self.model.dof_armature[3 * edges :] = 1e3 if rough else 1e-7
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)
        self._load(rod, spacing)
        mujoco.mj_forward(self.model, self.data)
        self.now = (last - rod.length * way, way)
        self._lead((self.ends[0, 0], self.directions[0, 0]), FIRST_MOVE_TIME)

    def filmed(
        self, pose: Callable[[float], tuple[Array, Array]], times: Array, drag: Drag
    ) -> Array:
        """Return the centrelines (T, n, 3) [m] at times (T,) [s], from 0 on, of the moving rope.

        pose: place (3,) [m] and direction (3,) of end 0 at a time, the first of which it rests in;
        drag: [1/s] force against the velocity, per mass, or that as a function of speeds (n,).
        """
        out, step = [], 0
        for time in times:
            while (step + 0.5) * TIMESTEP < time:
                (place, way), (ahead, turned) = (pose((step + k) * TIMESTEP) for k in (0, 1))
                rate = (ahead - place) / TIMESTEP, (turned - way) / TIMESTEP
                self._step((place, way), rate, drag)
                step += 1
            out.append(self._nodes())
        return np.array(out)

    def settled(self, frame: int) -> Array:
        """Return the centreline (n, 3) [m] at rest in a frame; RuntimeError if it keeps moving."""
        return self.rest((self.ends[frame, 0], self.directions[frame, 0]), f"frame {frame}")

    def rest(self, pose: tuple[Array, Array], where: str = "its first pose") -> Array:
        """Return the same with end 0 at a place (3,) [m], facing a direction (3,)."""
        self._lead(pose, self.move_time)
        free = slice(3 * self.held, 3 * (len(self.at) - self.held))
        calm = 0
        for step in range(round(MOST_TIME / TIMESTEP)):
            self._step(self.now)
            if step % 20 == 0:
                calm = calm + 1 if np.abs(self.data.qvel[free]).max() < self.slowest else 0
                if calm == 3:
                    return self._nodes()
        raise RuntimeError(f"MuJoCo's rope does not come to rest in {where}")

    def _lead(self, pose: tuple[Array, Array], seconds: float) -> None:
        start, steps = self.now, round(seconds / TIMESTEP)
        for step in range(1, steps + 1):
            part = step / steps
            part = part * part * (3 - 2 * part)
            way = (1 - part) * start[1] + part * pose[1]
            place = (1 - part) * start[0] + part * pose[0]
            self._step((place, way / np.linalg.norm(way)))
        self.now = pose

    def _step(
        self,
        pose: tuple[Array, Array],
        rate: tuple[Array, Array] = STILL,
        drag: Drag = DAMPING,
    ) -> None:
        data, count = self.data, 3 * self.held
        if callable(drag):
            speeds = np.linalg.norm(data.qvel[: 3 * len(self.at)].reshape(-1, 3), axis=1)
            data.qvel[: 3 * len(self.at)] *= np.repeat(np.exp(-drag(speeds) * TIMESTEP), 3)
        else:
            data.qvel *= np.exp(-drag * TIMESTEP)
        data.qpos[:count] = (self._led(pose) - self.straight[: self.held]).ravel()
        data.qvel[:count] = self._led(rate).ravel()
        for body, spring, anchor, steady in self.tethers:
            data.xfrc_applied[body, :3] = steady + spring * (anchor - data.xpos[body])
        mujoco.mj_step(self.model, data)

    def _led(self, pose: tuple[Array, Array]) -> Array:
        """Return the places (held, 3) of the vertices that are led, or their rates."""
        place, way = pose
        return place[None] + (self.half * np.outer([-1.0, 1.0], way) if self.clamped else 0.0)

    def _nodes(self) -> Array:
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_flex(self.model, self.data)
        x = self.data.flexvert_xpos.copy()
        if not self.clamped:
            return x
        return np.vstack([x[:2].mean(axis=0), x[1:-1], x[-2:].mean(axis=0)])

    def _shares(self, at: float) -> list[tuple[int, float]]:
        """Return the bodies next to an arc length [m], and the share of each."""
        right = int(np.clip(np.searchsorted(self.at, at), 1, len(self.at) - 1))
        part = (at - self.at[right - 1]) / (self.at[right] - self.at[right - 1])
        bodies = self.model.flex_vertbodyid
        return [(int(bodies[right - 1]), 1 - part), (int(bodies[right]), float(part))]

    def _weigh(self, rod: Rod, spacing: float) -> None:
        """Set the mass of each vertex: of the rope next to it, and what hangs on it."""
        bodies: NDArray[np.int32] = self.model.flex_vertbodyid
        for vertex, at in enumerate(self.at):
            low, high = max(at - spacing / 2, 0.0), min(at + spacing / 2, rod.length)
            mass = rod.density * max(high - low, 0.0)
            for part in rod.sections:
                inside = max(min(high, part.end) - max(low, part.start), 0.0)
                mass += rod.density * (part.density - 1) * inside
            if bodies[vertex] > 0:
                self.model.body_mass[bodies[vertex]] = max(mass, 1e-6)
        for point in rod.points:
            for body, part in self._shares(point.at):
                self.model.body_mass[body] += part * point.mass

    def _stiffen(self, rod: Rod) -> None:
        """Set the rigidity of bends within sections."""
        for k in range(int(self.model.flex_bending[0])):
            record = 1 + RECORD * k
            at = self.at[int(self.model.flex_bending[record + 1])]
            for part in rod.sections:
                if part.start <= at < part.end:
                    self.model.flex_bending[record + BENDING] *= part.bending
                    self.model.flex_bending[record + TWISTING] *= part.bending

    def _untwist(self) -> None:
        """Have no bend resist twist, which edges that do not spin could not give way to."""
        for k in range(int(self.model.flex_bending[0])):
            self.model.flex_bending[1 + RECORD * k + TWISTING] = 0.0

    def _load(self, rod: Rod, spacing: float) -> None:
        """Apply steady forces; note where tethers pull."""
        steady = np.zeros((self.model.nbody, 3))
        for vertex, at in enumerate(self.at):
            low, high = max(at - spacing / 2, 0.0), min(at + spacing / 2, rod.length)
            body = int(self.model.flex_vertbodyid[vertex])
            steady[body] += max(high - low, 0.0) * np.asarray(rod.load)
        self.data.xfrc_applied[1:, :3] = steady[1:]
        self.tethers = [
            (body, part * point.spring, np.asarray(point.anchor), steady[body])
            for point in rod.points
            if point.spring
            for body, part in self._shares(point.at)
        ]


def _xml(
    rod: Rod, points: Array, spacing: float, diameter: float, held: int, rough: float
) -> str:  # fmt: skip
    """Return the MJCF of the rope, straight through `points` (n, 3) [m], and of obstacles."""
    # Friction is a soft constraint that creeps: the less, the harder it is against the normal one.
    # Solved less exactly, nodes tremble, and a rope that trembles slides down to no friction.
    solver = f'cone="elliptic" impratio="{HARDER}" tolerance="{EXACT}"' if rough else ""
    rubs = f'condim="3" friction="{rough:.6g} 0.005 0.0001"' if rough else 'condim="1"'
    radius = 0.5 * diameter
    young = rod.bending / (0.25 * np.pi * radius**4)  # Pa, so that E I = EI
    gravity = " ".join(f"{value:.9g}" for value in rod.gravity)
    point = " ".join(f"{value:.12g}" for value in points.ravel())
    element = " ".join(f"{i} {i + 1}" for i in range(len(points) - 1))
    pins = " ".join(str(i) for i in range(len(points) - held, len(points)))
    touched = "".join(_geom(one, radius, rubs) for one in rod.fields)
    contact = 1 if rod.fields else 0
    mass = rod.density * spacing * len(points)
    # The default edge equality is soft enough to stretch a hanging rope by several per cent.
    return f"""
<mujoco>
  <option integrator="discrete" timestep="{TIMESTEP}" gravity="{gravity}" {solver}/>
  <worldbody>
    {touched}
    <flexcomp name="rope" type="direct" dim="1" mass="{mass:.12g}" radius="{radius:.9g}"
              point="{point}" element="{element}">
      <edge equality="true" solref="0.002 1" solimp="0.9999 0.9999 0.001"/>
      <elasticity young="{young:.12g}" poisson="0.3"/>
      <contact contype="{contact}" conaffinity="{contact}" {rubs} selfcollide="none"
               solref="0.004 1" solimp="0.99 0.999 0.0005"/>
      <pin id="{pins}"/>
    </flexcomp>
  </worldbody>
</mujoco>"""


def _geom(one: Field, radius: float, rubs: str) -> str:
    """Return a plane or a bar whose surface lies a radius of the rope inside the field's reach."""
    if one.kind == "plane":
        place, size, kind = one.point + (one.reach - radius) * one.axis, "5 5 0.1", "plane"
    else:
        place, size, kind = one.point, f"{one.reach - radius:.9g} {LONG_BAR / 2}", "capsule"
    where = " ".join(f"{value:.9g}" for value in place)
    axis = " ".join(f"{value:.9g}" for value in one.axis)
    return f'<geom type="{kind}" pos="{where}" zaxis="{axis}" size="{size}" {rubs}/>'
