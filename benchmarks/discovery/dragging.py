"""A rope that is dragged to and fro over a rough table, by MuJoCo's contact with friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.discovery.concealed import CONTACT_HARDNESS
from benchmarks.discovery.concealment import Concealed
from benchmarks.discovery.made import Made, Sized
from benchmarks.discovery.setting import World, draw, miscalibrated
from benchmarks.discovery.strength import meter, shapes
from reference_simulators import mujoco_rope
from reference_simulators.rod_equations import Array, Field

ROUGH = (0.2, 0.6)  # coefficient of friction
HIGH = (0.3, 0.5)  # of the way from the rope's lowest point up to the ends' lowest: the table
POSES = 20
STEPS = 8  # in which it is raised


def make(seed: int, calibration: bool, rough: float | None = None) -> Made:
    """Make a pinned rope of which about half lies on the table in some frames.

    rough: its coefficient of friction; None: drawn.
    """
    rng = np.random.default_rng(seed)
    setting = draw(False, rng, back=True, count=POSES)
    low = float(setting.states[..., 2].min())
    room = float(setting.held.positions[..., 2].min()) - low
    height, drawn = float(rng.uniform(*HIGH)) * room, float(rng.uniform(*ROUGH))
    rough = drawn if rough is None else rough
    rest = None
    for part in np.linspace(1 / STEPS, 1, STEPS):
        _, rest = shapes(setting, on_table(setting.world, low + part * height), rest)
    assert rest is not None
    world = on_table(setting.world, low + height)
    scale = meter(setting)
    smooth: Array = rest[:, scale.index, :3]
    s, nodes = mujoco_rope.shapes(world.rod, world.held, setting.diameter, rough)
    dragged = CubicSpline(s, nodes, axis=1)(setting.problem.mesh[scale.index])
    frames = list(range(len(nodes)))
    lifted = np.linalg.norm(smooth - scale.points, axis=-1).max(1)
    touching = np.flatnonzero(lifted > 1e-4).tolist()
    plane = Sized(_cause("support_plane", "height", "m", low + height - 0.5 * setting.diameter),
                  height, scale.score(smooth - scale.points), touching)  # fmt: skip
    friction = Sized(_cause("contact_friction", "coefficient", "1", rough),
                     rough, scale.score(dragged - smooth), frames)  # fmt: skip
    if calibration:
        world = miscalibrated(world, rng)
        s, nodes = mujoco_rope.shapes(world.rod, world.held, setting.diameter, rough)
    ways = mujoco_rope.tangents(s, nodes)
    return Made(setting, world, [plane, friction], s, nodes, ways, "mujoco")


def on_table(world: World, height: float) -> World:
    """Return the world with a table whose top lies a radius of the rope below a height [m]."""
    up = np.array([0.0, 0.0, 1.0])
    table = Field(height * up, up, 0.0, CONTACT_HARDNESS, "plane")
    return replace(world, rod=replace(world.rod, fields=(table,)))


def _cause(name: str, parameter: str, unit: str, told: float) -> Concealed:
    return Concealed(
        name, "physics", lambda world, size: world, told, told, parameter, unit,
        reported=lambda size: told,
    )  # fmt: skip
