"""The vertices a simulator is given: the rope's nodes, with the clamped ends made right.

A clamp fixes the direction of a whole edge, and a discrete rod does not bend inside an edge. If the
first edge of the rope were held, half of it would be lost to bending. So the held edge straddles
the clamping point: its outer half is no part of the rope, its inner half ends at h/2, and all other
nodes stay where they are. Curvature then covers exactly the rope's length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.attachments import EndTwist
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.divide import Divided, divide
from ropefit.exporters.rotation import from_vector, multiply, rotate, transport

FINENESS = 5.0  # vertices within the length in which the rope turns beside a clamp
MOST_PIECES = 8.0
VERTICES = {"free": 0, "pinned": 1, "clamped": 2}  # that an end of each kind holds
E3 = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Layout(Divided):
    """The rope divided, and how it is held.

    held: how many vertices each end holds (0 free, 1 pinned, 2 clamped).
    rest_x (V, 3), rest_q (V-1, 4): the stress-free shape. end_q: (P, 2, 4) orientation of the ends,
    the identity where they are not clamped.
    """

    held: tuple[int, int]
    rest_x: np.ndarray
    rest_q: np.ndarray
    end_q: np.ndarray

    @property
    def voronoi(self) -> np.ndarray:
        """Return (V-2,) [m] the length of rope that bends at each inner vertex."""
        half = self.lengths / 2
        # The outer half of a held edge is no rope, its inner half is: both are half an edge.
        return half[:-1] + half[1:]

    @property
    def free(self) -> range:
        """Return vertices that no end holds."""
        return range(self.held[0], len(self.masses) - self.held[1])

    def vertex(self, node: int) -> int:
        """Return the vertex at a node of the rope."""
        return int(np.flatnonzero(self.node == node)[0]) if node in self.node else -1

    def frames(self, pose: int) -> np.ndarray:
        """Return (V-1, 4) frames of the edges in a pose, with the least twist the ends allow."""
        x = self.start[pose]
        tangents = np.diff(x, axis=0)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        q = transport(self.end_q[pose, 0] if self.held[0] == 2 else self.rest_q[0], tangents)
        # The rest twist is put in, then what is missing at a second clamp is spread evenly.
        turned = np.concatenate([[0.0], np.cumsum(self.curvature[:, 2] * self.voronoi)])
        q = multiply(q, from_vector(turned[:, None] * E3))
        if self.held[1] == 2:
            last = multiply(q[-1] * np.array([1.0, -1, -1, -1]), self.end_q[pose, 1])
            angle = 2 * np.arctan2(last[3], last[0])
            angle = (angle + np.pi) % (2 * np.pi) - np.pi
            if self.held[0] == 2:
                share = np.linspace(0, 1, len(q))
            else:
                share = np.ones(len(q))  # an end that turns freely gives way
            q = multiply(q, from_vector((angle * share)[:, None] * E3))
        return q


def lay_out(rope: RopeDescription) -> Layout:
    """Return the vertices of a rope, edges near clamps divided, point masses added to theirs."""
    end_q = _end_orientations(rope)
    held = (VERTICES[rope.end_kinds[0]], VERTICES[rope.end_kinds[1]])
    fine = divide(rope, _pieces(rope))
    for end in (0, 1):
        if held[end]:
            fine.start[:, -1 if end else 0] = rope.end_positions[:, end]
    for end in (0, 1):
        if held[end] == 2:
            fine = _straddle(fine, end, rotate(end_q[:, end], E3))
    first = end_q[0, 0] if held[0] == 2 else None
    rest_x, rest_q = rest_shape(fine.lengths, fine.curvature, fine.start[0], first)
    return Layout(**vars(fine), held=held, rest_x=rest_x, rest_q=rest_q, end_q=end_q)


def _pieces(rope: RopeDescription) -> np.ndarray:
    """Return (N,) into how many pieces each segment is cut: finer where a clamp bends the rope
    sharply.

    Beside a clamp the rope turns within sqrt(EI / tension), often less than a segment. The weight
    of the rope stands for the tension; a tauter rope bends more sharply than is resolved.
    """
    pieces = np.ones(rope.segments, dtype=int)
    weight = float(rope.masses.sum() * np.linalg.norm(rope.gravity))
    if weight == 0:
        return pieces
    after = np.cumsum(rope.rest_lengths) - rope.rest_lengths
    before = rope.length - after - rope.rest_lengths
    for end, distance in ((0, after), (1, before)):
        if rope.end_kinds[end] == "clamped":
            turn = np.sqrt(rope.EI[-1 if end else 0] / weight)
            wanted = rope.rest_lengths / np.maximum(turn, distance) * FINENESS
            pieces = np.maximum(pieces, np.ceil(np.minimum(wanted, MOST_PIECES)).astype(int))
    return pieces


def _straddle(fine: Divided, end: int, tangent: np.ndarray) -> Divided:
    """Return the clamped end's node becomes two held vertices, half an edge before and behind
    it."""
    order = slice(None, None, -1) if end else slice(None)  # end 1 is end 0 seen from behind
    arrays = {
        key: getattr(fine, key)[order] for key in ("lengths", "EA", "GA", "EI", "GJ", "curvature")
    }
    masses, node = fine.masses[order], fine.node[order]
    x = fine.start[:, order]
    half = arrays["lengths"][0] / 2
    inward = -half * tangent if end else half * tangent
    pair = np.stack([x[:, 0] - inward, x[:, 0] + inward], axis=1)
    grown = {key: np.concatenate([a[:1], a])[order] for key, a in arrays.items()}
    grown["lengths"] = np.concatenate([[2 * half, half], arrays["lengths"][1:]])[order]
    return Divided(
        **grown,
        masses=np.concatenate([[masses[0] / 2] * 2, masses[1:]])[order],
        node=np.concatenate([[-1, -1], node[1:]])[order],
        start=np.concatenate([pair, x[:, 1:]], axis=1)[:, order],
    )


def _end_orientations(rope: RopeDescription) -> np.ndarray:
    """Return (P, 2, 4) with end twists put in; the identity at ends that are not clamped."""
    q = np.tile([1.0, 0, 0, 0], (rope.poses, 2, 1))
    for end in (0, 1):
        if rope.end_kinds[end] == "clamped":
            q[:, end] = rope.end_orientations[:, end]
            q[:, end] /= np.linalg.norm(q[:, end], axis=1, keepdims=True)
            for effect in rope.effects:
                if isinstance(effect, EndTwist) and effect.end == end:
                    q[:, end] = multiply(q[:, end], from_vector(effect.angle * E3))
    return q


def rest_shape(
    lengths: np.ndarray, curvature: np.ndarray, x: np.ndarray, first: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return (V, 3), (V-1, 4) the stress-free shape, laid out from the first vertex of a pose x (V,
    3).

    first: (4,) frame of the first edge; without one it points along the pose's first edge.
    """
    if first is None:
        first = transport(np.array([1.0, 0, 0, 0]), _unit(x[1] - x[0])[None])[0]
    q: list[np.ndarray] = [np.asarray(first)]
    for turn, a, b in zip(curvature, lengths[:-1], lengths[1:], strict=True):
        q.append(multiply(q[-1], from_vector(turn * (a + b) / 2)))
    frames = np.array(q)
    steps = lengths[:, None] * rotate(frames, E3)
    return np.concatenate([x[:1], x[0] + np.cumsum(steps, axis=0)]), frames


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)
