"""MuJoCo 3: a cable, which is a chain of links with ball joints and the cable plugin."""

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
)
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.layout import E3, Layout, lay_out
from ropefit.exporters.rotation import conjugate, multiply

TIMESTEP = 0.001  # s
# A link of a cable points along its x axis; the material frame's third axis is the tangent.
LINK = np.array([0.5, -0.5, -0.5, -0.5])
HELD = 'solref="0.004 1" solimp="0.9999 0.9999 0.001"'
STEPS = 16.0  # armature = STEPS stiffness timestep^2: bending waves take some ten steps a period


class MuJoCo3(Exporter):
    """MJCF for MuJoCo 3 (up to 3.17), written for the plugin mujoco.elasticity.cable.

    This is what <composite type="cable"> expands to. It is written out because the macro gives all
    joints one stiffness and all links one mass. The plugin reads a link's stiffness off the radius
    of its first geom: that geom only carries the stiffness, a second one is seen and touched.
    """

    target: ClassVar[str] = "mujoco3"
    suffix: ClassVar[str] = ".xml"
    simulator: ClassVar[Simulator | None] = Simulator(
        "mujoco", "mujoco==3.17.*", least=(3,), below=(4,), runner="settle_mujoco.py"
    )

    def export(self, rope: RopeDescription) -> ExportResult:
        layout, lost = lay_out(rope), []
        radius = diameter_of(rope, lost) / 2
        stretch_note(rope, lost)
        friction_note(rope, lost)
        mjcf.held_notes(rope, layout, lost)
        ratio = layout.GJ / layout.EI
        if np.ptp(ratio) > 1e-3 * ratio.max():
            lost.append(
                f"GJ/EI varies from {ratio.min():.4g} to {ratio.max():.4g}; a cable has one, the "
                "mean is written and EI kept"
            )
        bending = float(layout.EI.mean())
        young = bending / (np.pi * radius**4 / 4)
        shear = bending * float(ratio.mean()) / (np.pi * radius**4 / 2)
        lines = [
            *mjcf.header("A rope for MuJoCo 3 (to 3.17), written by ropefit.", lost),
            f"<mujoco model={mjcf.escaped(rope.name)}>",
            '  <extension><plugin plugin="mujoco.elasticity.cable">',
            f'    <instance name="rope"><config key="bend" value="{young:.10g}"/>'
            f'<config key="twist" value="{shear:.10g}"/>'
            '<config key="flat" value="false"/><config key="vmax" value="0"/></instance>',
            "  </plugin></extension>",
            f'  <option integrator="implicitfast" timestep="{TIMESTEP}" '
            f'gravity="{numbers(rope.gravity)}"/>',
            "  <worldbody>",
            *mjcf.obstacles(rope),
            *mjcf.tether_sites(rope),
            *_tree(rope, layout, radius, bending),
            "  </worldbody>",
            *_exclusions(rope, layout),
            *_far_end(layout),
            *mjcf.tendons(rope, layout),
            "  <keyframe>",
            *_poses(rope, layout),
            "  </keyframe>",
            "</mujoco>",
        ]
        return ExportResult("\n".join(lines) + "\n", {}, tuple(lost))


def _tree(rope: RopeDescription, layout: Layout, radius: float, bending: float) -> list[str]:
    """Return the links, one inside the other, hung on end 0's body where there is one."""
    ends = mjcf.ends(layout)
    out = [line.removesuffix("</body>") for line in ends if 'body name="end0"' in line]
    close = len(out)
    edges = len(layout.lengths)
    for edge in range(edges):
        out.append("    " + _link(rope, layout, edge, radius, bending))
    out.append("    " + "</body>" * (edges + close))
    # Keyframes give the poses of moved bodies in their order: end 0, then end 1.
    return out + [line for line in ends if 'body name="end1"' in line]


def _link(rope: RopeDescription, layout: Layout, edge: int, radius: float, bending: float) -> str:
    length = layout.lengths[edge]
    scale = 1.0
    spring = layout.EI[0] / layout.voronoi[0]
    if edge:
        spring = layout.EI[edge - 1] / layout.voronoi[edge - 1]
        # The plugin divides by the length of the link before, not by the length that bends.
        scale = spring * layout.lengths[edge - 1] / bending
    stiff = f'type="capsule" fromto="0 0 0 {length:.10g} 0 0" contype="0" conaffinity="0" group="4"'
    friction = mjcf.touches(rope)
    look = 'contype="0" conaffinity="0"' if friction is None else mjcf.touch(friction)
    site = mjcf.node_site(rope, int(layout.node[edge]))
    last = edge == len(layout.lengths) - 1
    far = f'<site name="vertex_{edge + 1}" pos="{length:.10g} 0 0" size="0.001"/>' if last else ""
    if last and layout.held[1]:
        at = length / 2 if layout.held[1] == 2 else length
        far += (
            f'<site name="far" pos="{at:.10g} 0 0" quat="{numbers(conjugate(LINK))}" size="0.003"/>'
        )
    if last and layout.held[1] == 0:
        sites = mjcf.node_site(rope, rope.segments)
        far += sites.replace("<site ", f'<site pos="{length:.10g} 0 0" ')
    return (
        f'<body name="rope_{edge}" {_place(layout, edge)}>{_joint(layout, edge, spring)}'
        f'{_inertia(layout, edge)}<plugin instance="rope"/>'
        f'<geom {stiff} size="{radius * scale**0.25:.10g}"/>'
        f'<geom type="capsule" fromto="0 0 0 {length:.10g} 0 0" size="{radius:.10g}" {look}/>'
        f'<site name="vertex_{edge}" size="0.001"/>{site}{far}'
    )


def _place(layout: Layout, edge: int) -> str:
    """Return position and quaternion of a link in the one before, in the stress-free shape."""
    if edge:
        turn = multiply(
            conjugate(multiply(layout.rest_q[edge - 1], LINK)),
            multiply(layout.rest_q[edge], LINK),
        )
        return f'pos="{layout.lengths[edge - 1]:.10g} 0 0" quat="{numbers(turn)}"'
    if layout.held[0] == 0:
        q = multiply(layout.rest_q[0], LINK)
        return f'pos="{numbers(layout.rest_x[0])}" quat="{numbers(q)}"'
    back = -layout.lengths[0] / 2 * E3 if layout.held[0] == 2 else 0 * E3
    return f'pos="{numbers(back)}" quat="{numbers(LINK)}"'


def _joint(layout: Layout, edge: int, spring: float) -> str:
    if edge == 0 and layout.held[0] == 2:
        return ""
    if edge == 0 and layout.held[0] == 0:
        return '<joint type="free"/>'
    return f'<joint type="ball" armature="{STEPS * spring * TIMESTEP**2:.6g}"/>'


def _inertia(layout: Layout, edge: int) -> str:
    """Return the mass of the vertex at which the link begins; the last link has that of its end
    too."""
    mass, at, last = layout.masses[edge], 0.0, len(layout.lengths) - 1
    if edge == last:
        far = layout.masses[edge + 1]
        # A held edge's outer half is no rope: nothing may hang there.
        at = 0.0 if layout.held[1] == 2 else layout.lengths[edge] * far / (mass + far)
        mass = mass + far
    thin = mass * layout.lengths[edge] ** 2
    return (
        f'<inertial pos="{at:.10g} 0 0" mass="{mass:.10g}" '
        f'diaginertia="{numbers([0.1 * thin, thin / 12, thin / 12])}"/>'
    )


def _exclusions(rope: RopeDescription, layout: Layout) -> list[str]:
    """Return what keeps neighbouring links, which overlap, from pushing each other away."""
    if mjcf.touches(rope) is None:
        return []
    edges = len(layout.lengths)
    pairs = [(i, j) for i in range(edges) for j in range(i + 1, edges)]
    return [
        "  <contact>",
        *(f'    <exclude body1="rope_{i}" body2="rope_{j}"/>' for i, j in pairs),
        "  </contact>",
    ]


def _far_end(layout: Layout) -> list[str]:
    """End 1 is tied by a constraint: a chain can hang on one body only."""
    kind = {0: None, 1: "connect", 2: "weld"}[layout.held[1]]
    if kind is None:
        return []
    # A far end that is pinned behind a held first edge needs no orientation of its own.
    return ["  <equality>", f'    <{kind} site1="far" site2="end1" {HELD}/>', "  </equality>"]


def _poses(rope: RopeDescription, layout: Layout) -> list[str]:
    out = []
    for pose in range(rope.poses):
        q = multiply(layout.frames(pose), LINK)
        rest = multiply(layout.rest_q, LINK)
        qpos: list[np.ndarray] = []
        if layout.held[0] == 0:
            qpos += [layout.start[pose, 0], q[0]]
        elif layout.held[0] == 1:
            qpos.append(multiply(conjugate(rest[0]), q[0]))
        for edge in range(1, len(q)):
            bent = multiply(conjugate(q[edge - 1]), q[edge])
            straight = multiply(conjugate(rest[edge - 1]), rest[edge])
            qpos.append(multiply(conjugate(straight), bent))
        held = ""
        if any(layout.held):
            mpos, mquat = mjcf.end_pose(layout, rope, pose)
            held = f' mpos="{mpos}" mquat="{mquat}"'
        text = numbers(np.concatenate(qpos))
        out.append(f'    <key name="pose{pose}" qpos="{text}"{held}/>')
    return out
