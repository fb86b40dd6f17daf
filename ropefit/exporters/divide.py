"""Segments of a rope cut into pieces; mass, stiffness and rest shape stay what they were."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.attachments import PointMass
from ropefit.exporters.description import RopeDescription


@dataclass(frozen=True)
class Divided:
    """V vertices and V - 1 edges.

    lengths: (V-1,) [m]; EA, GA: (V-1,) [N]; EI, GJ: (V-2,) [N m^2]; curvature: (V-2, 3) rest
    curvature and twist [1/m] in the material frame; masses: (V,) [kg], of held vertices too.
    node: (V,) the rope's node at each vertex, -1 where there is none; start: (P, V, 3) vertices in
    each pose.
    """

    lengths: np.ndarray
    EA: np.ndarray
    GA: np.ndarray
    EI: np.ndarray
    GJ: np.ndarray
    curvature: np.ndarray
    masses: np.ndarray
    node: np.ndarray
    start: np.ndarray


def divide(rope: RopeDescription, pieces: np.ndarray) -> Divided:
    """Return the rope with segment i cut into pieces[i] (N,) equal ones."""
    n = rope.segments
    lengths = np.repeat(rope.rest_lengths / pieces, pieces)
    first = np.concatenate([[0], np.cumsum(pieces)])  # the vertex at each node
    node = np.full(first[-1] + 1, -1)
    node[first] = np.arange(n + 1)
    # Values at vertices that are no nodes: between those of the nodes, in arc length.
    at_nodes = np.concatenate([[0.0], np.cumsum(rope.rest_lengths)])
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    inner = at_nodes[1:-1]
    curvature = np.column_stack([rope.rest_curvature, rope.rest_twist])

    def between(values: np.ndarray) -> np.ndarray:
        return np.interp(at[1:-1], inner, values)

    x = np.stack([[np.interp(at, at_nodes, axis) for axis in pose.T] for pose in rope.x])
    return Divided(
        lengths=lengths,
        EA=np.repeat(rope.EA, pieces),
        GA=np.repeat(rope.GA, pieces),
        EI=between(rope.EI),
        GJ=between(rope.GJ),
        curvature=np.column_stack([between(column) for column in curvature.T]),
        masses=_masses(rope, pieces, lengths, first),
        node=node,
        start=np.moveaxis(x, 1, 2),
    )


def _masses(
    rope: RopeDescription, pieces: np.ndarray, lengths: np.ndarray, first: np.ndarray
) -> np.ndarray:
    """Return (V,) what a node carries of a segment that is cut moves onto the pieces, evenly."""
    half = rope.rest_lengths / 2
    reach = np.concatenate([[0.0], half]) + np.concatenate([half, [0.0]])
    share = rope.masses / reach
    of_segment = half * (share[:-1] + share[1:])
    of_piece = np.repeat(of_segment / pieces, pieces)
    masses = np.zeros(len(lengths) + 1)
    whole = np.repeat(pieces == 1, pieces)
    masses[:-1] += np.where(whole, 0.0, of_piece / 2)
    masses[1:] += np.where(whole, 0.0, of_piece / 2)
    # A segment that stays whole leaves its nodes what they had.
    kept = half * (pieces == 1)
    masses[first] += share * (np.concatenate([[0.0], kept]) + np.concatenate([kept, [0.0]]))
    for effect in rope.effects:
        if isinstance(effect, PointMass):
            masses[first[effect.node]] += effect.mass
    return masses
