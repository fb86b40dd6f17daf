"""The fields of the discrete rod in one table: what each is, its shape and its unit.

Checks of shapes, arrays of zeros, tangents and gradients all take their shapes from here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Axis = str | int

OCTAVES = (-6, 4)  # of speeds in m/s: from 2^-6 to 2^4, beyond which drag is linear
# Of tensions in N: from 2^-12 to 2^9, beyond which strain is in proportion to tension, and how many
# values in each octave.
TENSION_OCTAVES, PER_OCTAVE = (-12, 9), 4
# Fixed bodies that a rope in motion touches: how many at most, and what a row of them is.
BODIES = 2
NO_BODY, PLANE, BAR = 0.0, 1.0, 2.0
TENSIONS = (TENSION_OCTAVES[1] - TENSION_OCTAVES[0]) * PER_OCTAVE + 1


class Field(NamedTuple):
    """One array of the rod.

    shape: of one rope, its axes as numbers, or by name: "N" segments, "N+1" nodes (and, in other
    tables, what `shapes` is given by name). dtype: of the array, as compiled loops take it.
    """

    name: str
    shape: tuple[Axis, ...]
    unit: str
    meaning: str
    dtype: type = np.float64


ROD = (
    Field("length", ("N",), "m", "rest length of each segment"),
    Field("flexibility", ("N", 3), "1/N", "1/GA, 1/GA, 1/EA of each segment"),
    Field(
        "stiffness", ("N+1", 3), "N m", "of C^B at each node; of the clamps at both ends, or zero"
    ),
    Field("rest", ("N+1", 3), "1", "vector part of the rest Darboux quaternion at each node"),
    Field("load", ("N+1", 3), "N", "force on each node"),
    Field("moment", (2, 3), "N m", "on the first and the last segment, fixed in space"),
)
MOTION = (
    Field("strain_viscosity", ("N", 3), "N s", "of the strains of each segment"),
    Field("bend_viscosity", ("N+1", 3), "N m s", "of C^B at each node"),
    Field("mass", ("N+1",), "kg", "of each node"),
    Field("spring", ("N+1",), "N/m", "stiffness of a spring from each node to the origin"),
    Field("air", ("N+1",), "N s/m", "resistance of the air to each node"),
    Field(
        "drag",
        (OCTAVES[1] - OCTAVES[0] + 1,),
        "1",
        "logarithm of the factor on `air`, at speeds of whole octaves",
    ),
    Field(
        "bodies",
        (BODIES, 8),
        "m, 1",
        "a point, the normal of a plane or axis of a bar, radius, kind (no derivative)",
    ),
)
# End moments have no place in the dynamics.
MOVING_ROD = (*(field for field in ROD if field.name != "moment"), *MOTION)


def names(fields: tuple[Field, ...]) -> list[str]:
    """Return the names of the fields, in their order."""
    return [field.name for field in fields]


def shapes(fields: tuple[Field, ...], segments: int, **sizes: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of each field for a rope of N segments; sizes of other axes by name."""
    size = {"N": segments, "N+1": segments + 1, **sizes}
    return {
        field.name: tuple([a if isinstance(a, int) else size[a] for a in field.shape])
        for field in fields
    }


def zeros(
    fields: tuple[Field, ...], lead: tuple[int, ...], segments: int, **sizes: int
) -> dict[str, np.ndarray]:
    """Return arrays of zeros for each field, with the dimensions `lead` in front."""
    shape = shapes(fields, segments, **sizes)
    return {f.name: np.zeros((*lead, *shape[f.name]), f.dtype) for f in fields}
