"""A rod and its conditions as the compiled solver takes them: contiguous float64 arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.fields import ROD, shapes
from ropefit.rod.rod import Rod
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.equilibrium.conditions import Conditions, FrictionElements
from ropefit.solvers.equilibrium.kernels.records import HELD
from ropefit.solvers.equilibrium.kernels.records import Held as HeldArrays
from ropefit.solvers.equilibrium.kernels.records import Rod as RodArrays
from ropefit.solvers.rods import check_rods, free_to_spin, rod_arrays, whole_rest
from ropefit.solvers.shapes import check_indices, check_shapes

AXES = np.eye(3)  # along which the far end is held


class Problem(NamedTuple):
    """R ropes, which of them each of F frames shows (F,), and what holds it there."""

    rods: RodArrays
    of: np.ndarray
    held: HeldArrays


def problem_of(rod: Rod, conditions: Conditions, member: np.ndarray | None) -> Problem:
    """Return the problem of a rod under conditions; member (F,) as in `solve`.

    Raises ValueError where it is not clear which frame shows which rope, ShapeError where the
    arrays do not belong together.
    """
    frames = len(conditions.ends)
    arrays = rod_arrays(rod._asdict(), ROD)
    ropes = len(arrays["length"])
    if member is None:
        if ropes not in (1, frames):
            raise ValueError(f"{ropes} ropes for {frames} frames: say which frame shows which")
        member = np.zeros(frames, dtype=np.int64) if ropes == 1 else np.arange(frames)
    gauge = _gauge(arrays, conditions)
    rods = RodArrays(**(arrays | {"rest": whole_rest(arrays["rest"])}), gauge=gauge)
    of = np.ascontiguousarray(member, dtype=np.int64)
    problem = Problem(rods, of, _held(conditions, rods.length.shape[1]))
    check_problem(problem)
    return problem


def _gauge(arrays: dict[str, np.ndarray], conditions: Conditions) -> np.ndarray:
    """Return (R,) [N m] what holds the spin of segment 0, or 0 where something else does."""
    stiffness, rest, moment = arrays["stiffness"], arrays["rest"], arrays["moment"]
    # Free to spin: no twist held, no rest curvature, no direction of easier bending, no moment.
    spins = free_to_spin(stiffness, rest) & (moment == 0).all((1, 2))
    friction_elements = conditions.friction_elements
    if friction_elements is not None and spins.any():
        away = (friction_elements.centre != 0) | (friction_elements.strain != 0)
        turned = ((friction_elements.drag[..., None] != 0) & away).any((1, 2, 3))
        spins &= ~turned if len(stiffness) == len(conditions.ends) else ~turned.any()
    return np.where(spins, stiffness[:, 1:-1, 2].max(axis=1, initial=0.0), 0.0)


def _held(conditions: Conditions, segments: int) -> HeldArrays:
    """Return the conditions' arrays, the far end's three supports first."""
    c, frames, far = conditions, len(conditions.ends), conditions.far_supports
    node, direction, offset, compliance = [], [], [], []
    if far:
        node.append(np.full(far, segments))
        direction.append(np.repeat(AXES[None], frames, axis=0))
        offset.append(as_numpy(c.ends[:, 1]))
        compliance.append(np.zeros((frames, far)))
    active = np.ones((frames, far), dtype=np.bool_)
    if c.node is not None:
        assert c.direction is not None
        assert c.offset is not None
        assert c.compliance is not None
        node.append(c.node)
        direction.append(as_numpy(c.direction))
        offset.append(as_numpy(c.offset))
        compliance.append(as_numpy(c.compliance))
        more = np.ones((frames, len(c.node)), bool) if c.active is None else c.active
        active = np.concatenate([active, more], axis=1)
    none = [np.zeros((frames, 0, segments + 1, *last)) for last in ((), (2,), ())]
    elements = c.friction_elements or FrictionElements.slipping(*none)
    axial = np.empty(0) if c.axial is None else c.axial
    clamp = as_numpy(c.clamp)
    unheld = np.isnan(clamp).any(-1)
    if unheld.any():
        clamp = clamp.copy()
        clamp[unheld] = (1.0, 0.0, 0.0, 0.0)
    return HeldArrays(
        node=np.concatenate([*node, np.empty(0)]).astype(np.int64),
        free=c.free,
        clamp=clamp,
        direction=np.concatenate([*direction, np.empty((frames, 0, 3))], axis=1),
        offset=np.concatenate([*offset, np.empty((frames, 0))], axis=1),
        compliance=np.concatenate([*compliance, np.empty((frames, 0))], axis=1),
        active=np.ascontiguousarray(active),
        **{name: np.ascontiguousarray(a) for name, a in elements._asdict().items()},
        axial=np.repeat(axial[None], frames, axis=0),
    )


def check_problem(problem: Problem) -> None:
    """Check the rods and the conditions of F frames against each other. Raises ShapeError."""
    rods, of, held = problem
    segments = rods.length.shape[1]
    sizes = {"S": len(held.node), "B": held.drag.shape[1], "A": held.axial.shape[1]}
    check_rods(rods, ROD)
    check_shapes(**{
        name: (getattr(held, name), (len(of), *shape))
        for name, shape in shapes(HELD, segments, **sizes).items()
    })  # fmt: skip
    check_indices("of", of, len(rods.length))
    check_indices("node", held.node, segments + 1)


def cut(problem: Problem, index: slice) -> Problem:
    """Return the problem of some frames."""
    rods, of, held = problem
    few = {field.name: getattr(held, field.name)[index] for field in HELD}
    return Problem(rods, of[index], held._replace(**few))
