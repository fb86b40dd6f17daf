"""A rope as linear USD curves with the deformable-curve physics schema; text, no USD library."""

from __future__ import annotations

import numpy as np

from ropefit.exporters.dahl import dahl
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.layout import rest_shape


def curves(rope: RopeDescription, radius: float, EA: np.ndarray, GA: np.ndarray) -> str:
    """Return the text of a .usda: every pose as a curve, the first one active; material by
    rigidities.

    radius [m]; EA, GA: [N]. USD has one material a curve: harmonic means are written, the
    stiffness of the rope as a whole. How ends are held has no place in this schema. Friction of
    bending is written as Isaac Lab takes it, beside the schema.
    """
    means = [_harmonic(EA), _harmonic(GA), _harmonic(rope.EI), _harmonic(rope.GJ)]
    names = ["Stretch", "Shear", "Bend", "Twist"]
    stiffness = [
        f"        float physics:curves{name}Stiffness = {value:.8g}"
        for name, value in zip(names, means, strict=True)
    ]
    volume = np.pi * radius**2 * rope.length
    up = "Y" if abs(rope.gravity[1]) > abs(rope.gravity[2]) else "Z"
    magnitude = float(np.linalg.norm(rope.gravity))
    direction = rope.gravity / magnitude if magnitude else np.array([0.0, 0.0, -1.0])
    lines = [
        "#usda 1.0",
        "(",
        '    doc = "A rope written by ropefit. SI units; not in it: how the ends are held, '
        'effects."',
        "    metersPerUnit = 1",
        "    kilogramsPerUnit = 1",
        f'    upAxis = "{up}"',
        '    defaultPrim = "World"',
        ")",
        "",
        'def PhysicsScene "PhysicsScene"',
        "{",
        f"    vector3f physics:gravityDirection = {_tuple(direction)}",
        f"    float physics:gravityMagnitude = {magnitude:.8g}",
        "}",
        "",
        'def Xform "World"',
        "{",
    ]
    turns = np.column_stack([rope.rest_curvature, rope.rest_twist])
    rest = rest_shape(rope.rest_lengths, turns, rope.x[0], None)[0]
    friction = _friction(rope, means[2])
    for pose, x in enumerate(rope.x):
        lines += _curve(f"Pose{pose}", x, rest, radius, friction, active=pose == 0)
    lines += [
        '    def Material "Rope" (',
        '        prepend apiSchemas = ["PhysicsCurvesDeformableMaterialAPI"]',
        "    )",
        "    {",
        *stiffness,
        f"        float physics:density = {rope.masses.sum() / volume:.8g}",
        "    }",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _friction(rope: RopeDescription, bending: float) -> list[str]:
    """Return attributes of a curve whose joints are its inner vertices; bending [N m²]."""
    reach = 0.5 * (rope.rest_lengths[1:] + rope.rest_lengths[:-1])
    strains, decay = dahl(rope, bending / reach, reach)
    if not strains.any():
        return []
    pairs = (("dahlMaxStrains", strains), ("dahlDecay", decay))
    return [
        f"            custom float[] isaaclab:cable:{name} = "
        f"[{', '.join(f'{value:.8g}' for value in values)}]"
        for name, values in pairs
    ]


def _curve(
    name: str, x: np.ndarray, rest: np.ndarray, radius: float, friction: list[str], active: bool
) -> list[str]:
    points = ", ".join(_tuple(point) for point in x)
    stress_free = ", ".join(_tuple(point) for point in rest)
    state = [] if active else ["        active = false"]
    return [
        f'    def Xform "{name}" (',
        *state,
        '        prepend apiSchemas = ["PhysicsDeformableBodyAPI"]',
        "    )",
        "    {",
        '        def BasisCurves "Curve" (',
        '            prepend apiSchemas = ["PhysicsCurvesDeformableSimAPI", '
        '"PhysicsCollisionAPI", "MaterialBindingAPI"]',
        "        )",
        "        {",
        '            uniform token type = "linear"',
        f"            int[] curveVertexCounts = [{len(x)}]",
        f"            point3f[] points = [{points}]",
        f"            point3f[] physics:restShapePoints = [{stress_free}]",
        f"            float[] physics:thicknesses = [{2 * radius:.8g}]",
        '            uniform token physics:thicknesses:elementType = "constant"',
        *friction,
        "            rel material:binding:physics = </World/Rope>",
        "        }",
        "    }",
    ]


def _tuple(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.8g}" for value in values) + ")"


def _harmonic(values: np.ndarray) -> float:
    return float(len(values) / np.sum(1 / values))
