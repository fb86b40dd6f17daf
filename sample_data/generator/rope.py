"""Quasi-static rope shapes from MuJoCo's 1D flex (a discrete elastic rod).

The mechanics are MuJoCo's on purpose: a sample made with ropefit's own rod would only show that
ropefit agrees with itself.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = (0.0, 0.0, -9.81)  # m/s²
TIMESTEP = 0.001  # s
DAMPING = 8.0  # 1/s, drag on every velocity: near critical for the slowest swing of a 1 m rope
MOVE_TIME = 1.5  # s, simulated time to bring the ends from one pose to the next
REST_SPEED = 1e-6  # m/s, a rope slower than this is at rest
MAX_SETTLE_TIME = 30.0  # s


@dataclass(frozen=True)
class Rope:
    """A uniform, straight-at-rest, practically inextensible rope."""

    length: float  # m
    diameter: float  # m
    mass: float  # kg, whole rope
    bending_rigidity: float  # EI [N·m²]

    @property
    def mass_per_length(self) -> float:
        """Mass per length [kg/m]."""
        return self.mass / self.length


@dataclass(frozen=True)
class EndPoses:
    """Where both ends are held; with tangents they are clamped, without they are pinned.

    ``positions`` (2, 3) [m], row 0 the control point; ``tangents`` (2, 3) unit vectors that point
    from end 0 to end 1, or None.
    """

    positions: Array
    tangents: Array | None = None

    def blend(self, other: "EndPoses", weight: float) -> "EndPoses":
        """The pose ``weight`` (0…1) of the way to ``other``."""
        positions = (1 - weight) * self.positions + weight * other.positions
        if self.tangents is None or other.tangents is None:
            return EndPoses(positions)
        tangents = (1 - weight) * self.tangents + weight * other.tangents
        return EndPoses(positions, tangents / np.linalg.norm(tangents, axis=1, keepdims=True))


class SettledRope:
    """A MuJoCo rope that is moved slowly and read only when it has come to rest.

    End 1 is pinned to the world. The vertices at end 0 are prescribed: they are set anew at every
    step and carry a huge armature (inertia without weight), so the rope cannot push them.

    Edges may roll about themselves at end 0, so a rope at rest carries no twist and its shape does
    not depend on GJ.

    A clamp fixes the direction of a whole edge. The discrete rod has no curvature there, so an
    edge inside the rope would take half of itself out of bending (mujoco issue 2208). Hence the
    clamped edges straddle the clamping points: their outer halves are not part of the rope.
    """

    def __init__(self, rope: Rope, start: EndPoses, edges: int = 160) -> None:
        """Lay the rope out straight behind end 1 of ``start`` and bring it to that pose."""
        self.clamped = start.tangents is not None
        spacing = rope.length / edges
        self._half_edge = 0.5 * spacing
        self._held = 2 if self.clamped else 1
        vertices = edges + self._held
        if start.tangents is not None:
            direction = start.tangents[1]
        else:
            chord = start.positions[1] - start.positions[0]
            direction = chord / np.linalg.norm(chord)
        reach = spacing * np.arange(vertices - 1, -1, -1)
        overhang = self._half_edge if self.clamped else 0.0
        points = start.positions[1] + np.outer(overhang - reach, direction)

        self._rest = points
        self._model = mujoco.MjModel.from_xml_string(_rope_xml(rope, points, edges, self._held))
        self._model.dof_armature[: 3 * self._held] = 1e3
        # The bare twist inertia of a thin edge is so small that its joints would ring.
        self._model.dof_armature[3 * edges :] = 1e-7
        self._data = mujoco.MjData(self._model)
        mujoco.mj_setConst(self._model, self._data)
        mujoco.mj_forward(self._model, self._data)

        tangents = np.stack([direction, direction]) if self.clamped else None
        straight = start.positions[1] - rope.length * direction
        self._pose = EndPoses(np.stack([straight, start.positions[1]]), tangents)
        self.arc_length = _arc_length(rope.length, edges, self.clamped)
        self.settle(start, move_time=4.0)

    def settle(self, pose: EndPoses, move_time: float = MOVE_TIME) -> Array:
        """Move the ends to ``pose`` in ``move_time`` [s], wait for rest, return nodes (n, 3) [m].

        Raises RuntimeError when the rope does not come to rest.
        """
        previous = self._pose
        steps = round(move_time / TIMESTEP)
        for step in range(1, steps + 1):
            phase = step / steps
            self._step(previous.blend(pose, phase * phase * (3 - 2 * phase)))
        self._pose = pose
        for _ in range(round(MAX_SETTLE_TIME / TIMESTEP)):
            self._step(pose)
            if self.speed < REST_SPEED:
                return self.nodes()
        raise RuntimeError(f"the rope still moves at {self.speed:.2e} m/s; raise MAX_SETTLE_TIME")

    @property
    def speed(self) -> float:
        """Largest velocity of a free vertex coordinate [m/s]."""
        free = self._data.qvel[3 * self._held : 3 * (len(self._rest) - self._held)]
        return float(np.abs(free).max())

    def nodes(self) -> Array:
        """The centreline (n, 3) [m] at ``arc_length``, between the clamping points only."""
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_flex(self._model, self._data)
        vertices = self._data.flexvert_xpos.copy()
        if not self.clamped:
            return vertices
        first, last = vertices[:2].mean(axis=0), vertices[-2:].mean(axis=0)
        return np.vstack([first, vertices[1:-1], last])

    def _step(self, pose: EndPoses) -> None:
        held = pose.positions[:1]
        if pose.tangents is not None:
            held = pose.positions[0] + self._half_edge * np.outer([-1.0, 1.0], pose.tangents[0])
        data, dofs = self._data, 3 * self._held
        data.qpos[:dofs] = (held - self._rest[: self._held]).ravel()
        data.qvel[:dofs] = 0.0
        data.qvel *= np.exp(-DAMPING * TIMESTEP)
        mujoco.mj_step(self._model, data)


def _arc_length(length: float, edges: int, clamped: bool) -> Array:
    if not clamped:
        return np.linspace(0.0, length, edges + 1)
    spacing = length / edges
    return np.concatenate([[0.0], spacing * (np.arange(edges) + 0.5), [length]])


def _rope_xml(rope: Rope, points: Array, edges: int, held: int) -> str:
    """MJCF of the rope; ``points`` (vertices, 3) [m] is its stress-free shape."""
    vertices = len(points)
    radius = 0.5 * rope.diameter
    young = rope.bending_rigidity / (0.25 * np.pi * radius**4)  # Pa, so that E·I = EI
    mass = rope.mass / edges * vertices  # MuJoCo gives every vertex an equal share
    point = " ".join(f"{value:.12g}" for value in points.ravel())
    element = " ".join(f"{i} {i + 1}" for i in range(vertices - 1))
    pins = " ".join(str(i) for i in range(vertices - held, vertices))
    # The default edge equality is soft enough to stretch a hanging rope by several per cent.
    return f"""
<mujoco>
  <option integrator="discrete" timestep="{TIMESTEP}" gravity="0 0 {GRAVITY[2]}"/>
  <worldbody>
    <flexcomp name="rope" type="direct" dim="1" mass="{mass:.12g}" radius="{radius}"
              point="{point}" element="{element}">
      <edge equality="true" solref="0.002 1" solimp="0.9999 0.9999 0.001"/>
      <elasticity young="{young:.12g}" poisson="0.3"/>
      <contact contype="0" conaffinity="0" selfcollide="none"/>
      <pin id="{pins}"/>
    </flexcomp>
  </worldbody>
</mujoco>"""
