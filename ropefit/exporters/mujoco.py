"""MuJoCo 4: a 1D flex, which is a discrete elastic rod."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ropefit.exporters import mjcf
from ropefit.exporters.base import (
    Exporter,
    ExportResult,
    Simulator,
    diameter_of,
    friction_note,
    numbers,
    stretch_note,
    varies,
)
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.layout import Layout, lay_out

TIMESTEP = 0.001  # s
# MuJoCo's default equality lets a hanging rope stretch by several per cent.
INEXTENSIBLE = 'solref="0.004 1" solimp="0.9999 0.9999 0.001"'


class MuJoCo(Exporter):
    """MJCF for MuJoCo 4.0.1 and later. The poses are keyframes `pose0`, `pose1`, ...

    The flex is written out, vertex by vertex: the macro <flexcomp> gives every vertex the same mass
    and can pin to one body only, and a rope has two ends.
    """

    target: ClassVar[str] = "mujoco"
    suffix: ClassVar[str] = ".xml"
    simulator: ClassVar[Simulator | None] = Simulator(
        "mujoco", "mujoco-core>=4.0.1", least=(4, 0, 1), runner="settle_mujoco.py"
    )

    def export(self, rope: RopeDescription) -> ExportResult:
        layout, lost = lay_out(rope), []
        radius = diameter_of(rope, lost) / 2
        stretch_note(rope, lost)
        friction_note(rope, lost)
        lost.append(
            "damping: the vertices of a flex cannot have any, so this rope swings on; multiply "
            "qvel by exp(-8 timestep) each step to bring it to rest"
        )
        mjcf.held_notes(rope, layout, lost)
        if varies(layout.GJ):
            lost.append(
                f"GJ varies from {rope.GJ.min():.4g} to {rope.GJ.max():.4g} N m^2; a flex has one, "
                "the harmonic mean is written (the rope as a whole twists as much)"
            )
        torsion = len(layout.GJ) / float(np.sum(1 / layout.GJ))
        flexes = _flexes(layout, radius, torsion, mjcf.touches(rope), lost)
        lines = [
            *mjcf.header("A rope for MuJoCo 4.0.1 or later, written by ropefit.", lost),
            f"<mujoco model={mjcf.escaped(rope.name)}>",
            f'  <option integrator="discrete" timestep="{TIMESTEP}" '
            f'gravity="{numbers(rope.gravity)}"/>',
            "  <worldbody>",
            *mjcf.obstacles(rope),
            *mjcf.tether_sites(rope),
            *mjcf.ends(layout),
            *_vertices(rope, layout),
            *_twists(layout, torsion),
            "  </worldbody>",
            "  <deformable>",
            *flexes,
            "  </deformable>",
            "  <equality>",
            f'    <flex flex="rope" {INEXTENSIBLE}/>',
            "  </equality>",
            *mjcf.tendons(rope, layout),
            "  <keyframe>",
            *_poses(rope, layout),
            "  </keyframe>",
            "</mujoco>",
        ]
        return ExportResult("\n".join(lines) + "\n", {}, tuple(lost))


def _body_of(layout: Layout, vertex: int) -> str:
    if vertex < layout.held[0]:
        return "end0"
    return "end1" if vertex >= len(layout.masses) - layout.held[1] else f"rope_{vertex}"


def _vertices(rope: RopeDescription, layout: Layout) -> list[str]:
    """Return a point mass with three slides a vertex that moves."""
    out = []
    for vertex in layout.free:
        mass = layout.masses[vertex]
        inertia = mass * (0.1 * layout.lengths.min()) ** 2  # MuJoCo wants one; nothing ever turns
        slides = "".join(
            f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")
        )
        out.append(
            f'    <body name="rope_{vertex}" pos="{numbers(layout.rest_x[vertex])}">'
            f'<inertial pos="0 0 0" mass="{mass:.10g}" diaginertia="{numbers([inertia] * 3)}"/>'
            f"{slides}{mjcf.node_site(rope, int(layout.node[vertex]))}</body>"
        )
    return out


def _twist_edges(layout: Layout) -> list[int]:
    """Return edges that may roll about themselves: all that no clamp holds."""
    edges = len(layout.lengths)
    return list(range(layout.held[0] == 2, edges - (layout.held[1] == 2)))


def _twists(layout: Layout, torsion: float) -> list[str]:
    """Return a hinge an edge for its twist.

    Its true inertia is so small that it would ring faster than the time step; the armature slows
    that down to some twenty steps and changes no shape at rest.
    """
    out = []
    edges = len(layout.lengths)
    for edge in _twist_edges(layout):
        name = "rope_twist" if edge == edges - 1 else f"rope_twist_{edge}"
        stiffness = 2 * torsion / layout.lengths[edge]
        armature = stiffness * (3 * TIMESTEP) ** 2
        out.append(
            f'    <body name="{name}"><inertial pos="0 0 0" mass="1e-9" '
            'diaginertia="1e-12 1e-12 1e-12"/>'
            f'<joint name="{name}" type="hinge" axis="1 0 0" armature="{armature:.6g}" '
            f'damping="{armature * 0.2 / TIMESTEP:.6g}"/></body>'
        )
    return out


def _flexes(
    layout: Layout, radius: float, torsion: float, friction: float | None, lost: list[str]
) -> list[str]:
    """Return the rope, and where it is stiffer than at its softest, more flexes on the same
    vertices."""
    everything = np.arange(len(layout.masses))
    # Differences of a part in a thousand are not worth a flex each.
    softest = float(layout.EI.min()) if varies(layout.EI) else float(layout.EI.mean())
    contact = 'contype="0" conaffinity="0"'
    if friction is not None:
        contact = mjcf.touch(friction)
    out = _flex("rope", layout, everything, radius, softest, torsion, contact)
    extra = layout.EI - softest if varies(layout.EI) else np.zeros_like(layout.EI)
    start = 0
    count = 0
    while start < len(extra):
        stop = start + 1
        while stop < len(extra) and abs(extra[stop] - extra[start]) <= 1e-6 * softest:
            stop += 1
        if extra[start] > 1e-6 * softest:
            run = everything[start : stop + 2]
            nothing = 'contype="0" conaffinity="0"'
            out += _flex(f"stiff{count}", layout, run, radius, float(extra[start]), 0.0, nothing)
            count += 1
        start = stop
    if count and np.abs(layout.curvature[:, :2]).max() > 0:
        lost.append(
            "where the rope is both curved at rest and stiffer than elsewhere, the stiffer part "
            "holds the amount of its rest curvature, not its direction"
        )
    return out


def _flex(
    name: str,
    layout: Layout,
    vertices: np.ndarray,
    radius: float,
    bending: float,
    torsion: float,
    contact: str,
) -> list[str]:
    young = bending / (np.pi * radius**4 / 4)
    # Zero would mean the isotropic value; an extra flex has no twist joints and needs no shear.
    shear = max(torsion / (np.pi * radius**4 / 2), 1e-9)
    bodies = " ".join(_body_of(layout, int(vertex)) for vertex in vertices)
    local = np.concatenate([_local(layout, int(vertex)) for vertex in vertices])
    element = " ".join(f"{i} {i + 1}" for i in range(len(vertices) - 1))
    return [
        f'    <flex name="{name}" dim="1" radius="{radius:.10g}" body="{bodies}"',
        f'          vertex="{numbers(local)}" element="{element}">',
        f'      <elasticity young="{young:.10g}" shear="{shear:.10g}"/>',
        f'      <contact {contact} selfcollide="none"/>',
        "    </flex>",
    ]


def _local(layout: Layout, vertex: int) -> np.ndarray:
    """Return (3,) a vertex in the frame of its body: on the z axis of a clamp, else at the
    origin."""
    count = len(layout.masses)
    for end, first in ((0, 0), (1, count - 2)):
        if layout.held[end] == 2 and vertex in (first, first + 1):
            half = layout.lengths[-1 if end else 0] / 2
            return np.array([0.0, 0.0, half if vertex == first + 1 else -half])
    return np.zeros(3)


def _poses(rope: RopeDescription, layout: Layout) -> list[str]:
    out = []
    twists = np.zeros(len(_twist_edges(layout)))
    for pose in range(rope.poses):
        moved = [layout.start[pose, vertex] - layout.rest_x[vertex] for vertex in layout.free]
        qpos = np.concatenate([*moved, twists])
        held = ""
        if any(layout.held):
            mpos, mquat = mjcf.end_pose(layout, rope, pose)
            held = f' mpos="{mpos}" mquat="{mquat}"'
        out.append(f'    <key name="pose{pose}" qpos="{numbers(qpos)}"{held}/>')
    return out
