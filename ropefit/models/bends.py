"""The bend elements of settled frames: what their memory works on, and how it moves."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from ropefit.rod.bending import springs
from ropefit.rod.quaternion import conjugate_product
from ropefit.rod.rod import Rod
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.conditions import Conditions, FrictionElements
from ropefit.solvers.equilibrium.solution import ARRAYS, Solution, States
from ropefit.solvers.equilibrium.turns import rolled


def vectors(solution: Solution) -> np.ndarray:
    """Return (F, N+1, 2) the vector parts of the bend elements; zero where there is none."""
    return darboux(solution)[..., 1:3]


def darboux(solution: Solution) -> np.ndarray:
    """Write p = a* b, of the sign that lies nearer to the rest rotation."""
    return _darboux(solution.rod, solution.conditions, solution)


def _darboux(rod: Rod, held: Conditions, states: States) -> np.ndarray:
    clamp = np.nan_to_num(held.clamp)
    around = np.concatenate([clamp[:, :1], states.q, clamp[:, 1:]], axis=1)
    p = conjugate_product(around[:, :-1], around[:, 1:])
    rest, stiffness = (t.reshape(-1, *t.shape[-2:]) for t in (rod.rest, rod.stiffness))
    real = np.sqrt(np.maximum(1 - (rest**2).sum(-1), 0.0))
    nearer = p[..., 0] * real + (p[..., 1:] * rest).sum(-1)
    sign = np.where(nearer < 0, -1.0, 1.0)
    return p * np.where(np.any(stiffness > 0, axis=-1), sign, 0.0)[..., None]


def elements_of(setup: Setup, rod: Rod, frames: int) -> FrictionElements | None:
    """Return the setup's law of bending on a rod, in every frame; None for a linear one."""
    if setup.bending is None:
        return None
    drag, centre, slip = springs(setup.bending, rod)
    rows = frames, drag.shape[1], drag.shape[2]
    # In C order, as compiled code takes them: in another they would be copied once more.
    return FrictionElements.slipping(
        np.array(np.broadcast_to(drag, rows), order="C"),
        np.array(np.broadcast_to(centre[:, None], (*rows, 2)), order="C"),
        np.array(np.broadcast_to(slip, rows), order="C"),
    )


def joined(one: FrictionElements | None, other: FrictionElements | None) -> FrictionElements | None:
    """Return the elements of both, in the same frames."""
    if one is None or other is None:
        return one or other
    return FrictionElements(*(np.concatenate(f, axis=1) for f in zip(one, other, strict=True)))


def axial_law_of(setup: Setup) -> np.ndarray | None:
    """Return (A,) the setup's law of axial strain; None for a linear one."""
    return setup.axial


def conditions_of(setup: Setup, rod: Rod | None = None) -> Conditions:
    """Return what holds a rope without memory in every frame, its laws included."""
    elements = elements_of(setup, rod or setup.rod(), len(setup.ends))
    return Conditions(
        setup.ends, setup.clamp, friction_elements=elements, axial=axial_law_of(setup)
    )


def vector_change(p: np.ndarray, turns: np.ndarray, clamp: np.ndarray | None) -> np.ndarray:
    """Return (P, N+1, 2) change of the vectors of Darboux quaternions p (N+1, 4) when the frames
    turn by (P, N, 3), the clamps by clamp (P, 2, 3), each about its own axes."""
    ends = np.zeros((len(turns), 2, 3)) if clamp is None else clamp
    every = np.concatenate([ends[:, :1], turns, ends[:, 1:]], axis=1)
    low, high = every[:, :-1], every[:, 1:]
    moved = 0.5 * (p[:, :1] * (high - low) + np.cross(p[:, 1:], high + low))
    return moved[..., :2]


def spun(rod: Rod, held: Conditions, start: States, toward: np.ndarray) -> States:
    """Return a start whose frames are all spun alike, for its bends to lie as `toward` (N+1, 2)
    does."""
    out = start.copy()
    out.q[:] = rolled(start.q, _darboux(rod, held, start)[..., 1:3], toward[None])
    return out


def merged(parts: list[Solution]) -> Solution:
    """Return solutions of one frame each as one: a support is there in all where it is in any."""
    rods = Rod(*(np.concatenate(f) for f in zip(*(s.rod.each(1) for s in parts), strict=True)))
    held = [s.conditions for s in parts]
    friction_elements = FrictionElements(
        *(np.concatenate(f) for f in zip(*(c.friction_elements for c in held), strict=True))
    )
    ends, clamp = (np.concatenate([getattr(c, n) for c in held]) for n in ("ends", "clamp"))
    far = held[0].far_supports
    keys = [_numbered(c.node) for c in held]
    every = sorted(set().union(*keys))
    place = {key: k for k, key in enumerate(every)}
    frames, many = len(parts), len(every)
    direction = np.zeros((frames, many, 3))
    offset = np.zeros((frames, many))
    compliance = np.ones((frames, many))
    active = np.zeros((frames, many), dtype=bool)
    reaction = np.zeros((frames, far + many))
    for t, (c, own) in enumerate(zip(held, keys, strict=True)):
        reaction[t, :far] = parts[t].reaction[0, :far]
        if c.node is None or not own:
            continue
        assert c.direction is not None
        assert c.offset is not None
        assert c.compliance is not None
        at = [place[key] for key in own]
        direction[t, at], offset[t, at] = c.direction[0], c.offset[0]
        compliance[t, at] = c.compliance[0]
        active[t, at] = True if c.active is None else c.active[0]
        reaction[t, [far + k for k in at]] = parts[t].reaction[0, far:]
    axial = held[0].axial
    conditions = Conditions(ends, clamp, friction_elements=friction_elements, axial=axial)
    if every:
        node = np.array([key[0] for key in every])
        conditions = Conditions(
            ends, clamp, node, direction, offset, compliance, active, friction_elements, axial
        )  # fmt: skip
    arrays: dict[str, Any] = {name: np.concatenate([getattr(s, name) for s in parts])
              for name in ARRAYS if name != "reaction"}  # fmt: skip
    return Solution(**arrays, reaction=reaction, rod=rods, conditions=conditions)


def _numbered(node: np.ndarray | None) -> list[tuple[int, int]]:
    """Return supports as (node, which of that node's)."""
    out: list[tuple[int, int]] = []
    for k in [] if node is None else node.tolist():
        out.append((k, sum(other == k for other, _ in out)))
    return out


def stacked(parts: list[Solution]) -> States:
    """Return the states of solutions of one frame each; q is NaN where one has not converged."""
    every = [s.states for s in parts]
    out = States(*(np.concatenate([getattr(s, f.name) for s in every]) for f in fields(States)))
    out.q[[not s.converged[0] for s in parts]] = np.nan
    return out
