"""What both dialects of MuJoCo's MJCF share: ends that can be moved, obstacles, tethers, poses."""

from __future__ import annotations

import numpy as np

from ropefit.attachments import Cylinder, EndTwist, Plane, Sphere, Tether
from ropefit.exporters.base import numbers
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.layout import E3, Layout
from ropefit.exporters.rotation import between


def header(title: str, lost: list[str]) -> list[str]:
    """Return the comment at the top: what this is and what is not in it."""
    lines = [
        f"<!-- {title}",
        "     Units: m, kg, s, N. Lengths of the rope run from end 0 to end 1.",
    ]
    lines += [f"     Not expressed: {comment(sentence)}" for sentence in lost]
    return [*lines, "-->"]


def comment(text: str) -> str:
    """Return text that may stand in an XML comment."""
    while "--" in text:
        text = text.replace("--", "- -")
    return text.rstrip("-")


def escaped(text: str) -> str:
    """Return text that may stand in an XML attribute."""
    from xml.sax.saxutils import quoteattr

    return quoteattr("".join(letter for letter in text if letter.isprintable()))


def reference(layout: Layout, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Return position and quaternion of an end's body in the stress-free shape."""
    at = layout.rest_x if end == 0 else layout.rest_x[::-1]
    q = layout.rest_q[-1 if end else 0]
    return (at[0] if layout.held[end] == 1 else (at[0] + at[1]) / 2), q


def ends(layout: Layout) -> list[str]:
    """Return a body for each held end: move it by mocap_pos and mocap_quat, as a gripper would."""
    out = []
    for end in (0, 1):
        if layout.held[end]:
            position, q = reference(layout, end)
            out.append(
                f'    <body name="end{end}" mocap="true" pos="{numbers(position)}" '
                f'quat="{numbers(q)}"><site name="end{end}" size="0.005"/></body>'
            )
    return out


def end_pose(layout: Layout, rope: RopeDescription, pose: int) -> tuple[str, str]:
    """Return mpos and mquat of a keyframe."""
    position, orientation = [], []
    for end in (0, 1):
        if layout.held[end]:
            position.append(rope.end_positions[pose, end])
            clamped = layout.held[end] == 2
            orientation.append(layout.end_q[pose, end] if clamped else reference(layout, end)[1])
    return numbers(np.array(position)), numbers(np.array(orientation))


def obstacles(rope: RopeDescription) -> list[str]:
    """Return geoms that the rope touches."""
    out = []
    for number, effect in enumerate(rope.effects):
        if isinstance(effect, Plane):
            q = between(E3, np.array(effect.normal))
            shape = f'type="plane" size="0 0 1" pos="{numbers(effect.point)}" quat="{numbers(q)}"'
        elif isinstance(effect, Sphere):
            shape = f'type="sphere" size="{effect.radius:.10g}" pos="{numbers(effect.centre)}"'
        elif isinstance(effect, Cylinder):
            shape = (
                f'type="cylinder" size="{effect.radius:.10g}" '
                f'fromto="{numbers([*effect.start, *effect.stop])}"'
            )
        else:
            continue
        out.append(f'    <geom name="obstacle{number}" {shape} {touch(effect.friction)}/>')
    return out


def touch(friction: float) -> str:
    """Return contact attributes; stiffer than MuJoCo's default so that a rope does not sink in.

    Without friction a contact must have one dimension only: with three, the rope never rests.
    """
    return (
        f'contype="1" conaffinity="1" condim="{3 if friction else 1}" '
        f'friction="{friction:.6g} 0.005 0.0001" '
        'solref="0.004 1" solimp="0.99 0.999 0.001"'
    )


def touches(rope: RopeDescription) -> float | None:
    """Return friction of the rope's own contacts; None where there is nothing to touch."""
    values = [e.friction for e in rope.effects if isinstance(e, Plane | Sphere | Cylinder)]
    # MuJoCo takes the larger of the two surfaces, so the obstacle's own value stands.
    return min(values) if values else None


def tether_sites(rope: RopeDescription) -> list[str]:
    """Return the fixed ends of tethers."""
    return [
        f'    <site name="anchor{number}" pos="{numbers(effect.anchor)}" size="0.005"/>'
        for number, effect in enumerate(rope.effects)
        if isinstance(effect, Tether)
    ]


def node_site(rope: RopeDescription, node: int) -> str:
    """Return sites on a node's body that tethers pull at."""
    return "".join(
        f'<site name="tether{number}" size="0.003"/>'
        for number, effect in enumerate(rope.effects)
        if isinstance(effect, Tether) and effect.node == node
    )


def tendons(rope: RopeDescription, layout: Layout) -> list[str]:
    """Return springs that pull only when longer than their rest length."""
    out = []
    for number, effect in enumerate(rope.effects):
        if isinstance(effect, Tether) and layout.vertex(effect.node) in layout.free:
            out += [
                f'    <spatial stiffness="{effect.stiffness:.10g}" '
                f'springlength="0 {effect.rest_length:.10g}">',
                f'      <site site="anchor{number}"/><site site="tether{number}"/>',
                "    </spatial>",
            ]
    return ["  <tendon>", *out, "  </tendon>"] if out else []


def held_notes(rope: RopeDescription, layout: Layout, lost: list[str]) -> None:
    """Return notes on effects at a place where an end's body takes them up, so that they do
    nothing."""
    for effect in rope.effects:
        if isinstance(effect, Tether) and layout.vertex(effect.node) not in layout.free:
            lost.append(f"the tether at node {effect.node} does nothing: the end there is held")
        if isinstance(effect, EndTwist) and rope.end_kinds[effect.end] != "clamped":
            lost.append(
                f"end {effect.end} is not clamped: its twist of {effect.angle:g} rad is lost"
            )
