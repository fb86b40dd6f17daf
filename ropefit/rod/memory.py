"""Bending that remembers: springs in parallel to the rod's own that relax, or slip, at once or
gradually.

Each is an incremental potential in the vector part v of a bend element's Darboux quaternion, about
the first two directors. From frame to frame its strain e follows

    de/dt = dv/dt - e/time,   |e| <= slip,

with v on a straight line in between, so that steps of any size are exact on such a path:
e = clip(kept e + given (v - v before)). Without `slip` this is Maxwell's element (Simo & Hughes,
Computational Inelasticity, 10.3), without `time` Prandtl's (there 1.2, return mapping). Those
that slip gradually follow `rod.dahl` instead.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.dahl import strained
from ropefit.rod.rod import Rod, at_nodes


class Branch(NamedTuple):
    """A spring along the whole rope: bend (N,) [N m²] its rigidity; slip () [1/m]: the curvature
    beyond which it slides; time () [s] in which it relaxes; infinity where it does not. fresh: it
    was unloaded at the rest shape before the first frame, else in the first frame. gradual: it does
    not slide at once, but builds up over the range `slip`, see `rod.dahl`; its time is infinite."""

    bend: np.ndarray
    slip: np.ndarray
    time: np.ndarray
    fresh: bool
    gradual: bool = False


class Laws(NamedTuple):
    """B branches at the bend elements, for H frames: drag (B, N+1) [N m], slip (B, N+1), kept and
    given (H, B), fresh and gradual (B,). As P derivatives: with a dimension P in front."""

    drag: np.ndarray
    slip: np.ndarray
    kept: np.ndarray
    given: np.ndarray
    fresh: np.ndarray
    gradual: np.ndarray


class State(NamedTuple):
    """vector (..., N+1, 2) of the last frame and strain (..., B, N+1, 2) of the branches there."""

    vector: np.ndarray
    strain: np.ndarray


def laws(branches: tuple[Branch, ...], rod: Rod, bend: np.ndarray, time: np.ndarray) -> Laws:
    """Return the branches on a rod of bending rigidity `bend` (N,), in frames at time (H,) [s].

    A branch is shared among the elements as the rod's own rigidity is. Time that goes back is that
    of a new clip, see `restarts`.
    """
    length, stiffness = rod.length.reshape(-1, rod.length.shape[-1])[0], rod.stiffness
    at_node = at_nodes(length)
    stiffness = stiffness.reshape(-1, *stiffness.shape[-2:])[0, :, 0]
    step = np.maximum(np.diff(time, prepend=time[:1]), 0.0)
    drag, slip, kept, given = [], [], [], []
    for b in branches:
        drag.append(stiffness * at_nodes(length * b.bend / bend) / at_node)
        slip.append(0.25 * at_node * b.slip)  # v = sin(turn / 2)
        share = step / b.time
        kept.append(np.exp(-share))
        given.append(np.where(share > 0, -np.expm1(-share) / np.maximum(share, 1e-300), 1.0))
    fresh, gradual = (
        np.array([getattr(b, name) for b in branches], dtype=bool) for name in ("fresh", "gradual")
    )
    if not branches:
        none, in_frames = np.zeros((0, len(at_node))), np.zeros((len(time), 0))
        return Laws(none, none, in_frames, in_frames, fresh, gradual)
    return Laws(
        np.stack(drag),
        np.stack(slip),
        np.stack(kept, axis=-1),
        np.stack(given, axis=-1),
        fresh,
        gradual,
    )


def restarts(time: np.ndarray) -> np.ndarray:
    """Return (H,) bool: the frames before which nothing is known, the first ones of clips."""
    return np.diff(time, prepend=time[:1] + 1) < 0


def unloaded(rest: np.ndarray, branches: int) -> State:
    """Return the state before a first frame: at the rest shape's vector (N+1, 2)."""
    return State(rest, np.zeros((branches, *rest.shape)))


def friction_elements(law: Laws, t: int, first: bool, before: State) -> tuple[np.ndarray, ...]:
    """Return what stands for the branches in frame t: the fields of `FrictionElements`.

    The stiffness (B, N+1) [N m] of springs, the vector (B, N+1, 2) where each is unloaded, the
    length (B, N+1) beyond which it slips, the strain (B, N+1, 2) there, which are gradual (B,).
    """
    kept, given = _steps(law, t, first)
    drag = law.drag * given[..., 0] * (law.fresh[:, None] if first else 1.0)
    gradual = law.gradual[:, None, None]
    centre = before.vector - np.where(gradual, 0.0, kept / given * before.strain)
    strain = np.where(gradual, before.strain, 0.0)
    return drag, centre, law.slip / given[..., 0], strain, law.gradual


def after(law: Laws, t: int, first: bool, before: State, vector: np.ndarray) -> State:
    """Return the state once frame t has settled at vector (N+1, 2)."""
    kept, given = _steps(law, t, first)
    moved = vector - before.vector
    strain = clipped(kept * before.strain + given * moved, law.slip)[0]
    if law.gradual.any():
        g = law.gradual
        strain[g] = strained(before.strain[g], moved[None], law.slip[g]).strain
    if first:
        strain = strain * law.fresh[:, None, None]
    return State(vector, strain)


class Answer(NamedTuple):
    """First-order changes in one frame, P of them: force (P, N+1, 2) [N m] at the vector that it
    has; strain (P, B, N+1, 2) likewise, and by_vector (B, N+1, 2, 2) what a change of the vector
    adds to it."""

    force: np.ndarray
    strain: np.ndarray
    by_vector: np.ndarray

    def then(self, vector: np.ndarray) -> State:
        """Return the state's change when the vector changes by (P, N+1, 2)."""
        return State(vector, self.strain + _times(self.by_vector, vector[:, None]))


def answer(
    law: Laws, slope: Laws, t: int, first: bool, before: State, change: State, vector: np.ndarray
) -> Answer:
    """Return how the branches' force in frame t, at vector (N+1, 2), changes with the laws
    (`slope`) and with the state before (`change`)."""
    kept, given = _steps(law, t, first)
    moved = vector - before.vector
    strain, across, direction = clipped(kept * before.strain + given * moved, law.slip)
    left = across[..., None, None] * (
        np.eye(2) - direction[..., :, None] * direction[..., None, :]
    )  # what is along the slip's direction is lost
    by_vector, by_strain = given[..., None] * left, kept[..., None] * left
    # What slides is as long as the slip allows.
    by_slip = np.where((across < 1)[..., None], direction, 0.0)
    if law.gradual.any():
        g = law.gradual
        strain[g], by_vector[g], by_strain[g], by_slip[g] = strained(
            before.strain[g], moved[None], law.slip[g]
        )
    strain_slope = _times(by_strain, change.strain) - _times(by_vector, change.vector[:, None])
    with np.errstate(invalid="ignore"):
        strain_slope = strain_slope + np.where(by_slip != 0.0, slope.slip[..., None] * by_slip, 0.0)
    if not first:
        trial = slope.kept[:, t, :, None, None] * before.strain
        trial = trial + slope.given[:, t, :, None, None] * moved
        strain_slope = strain_slope + _times(left, trial)
    active = (law.fresh if first else np.ones_like(law.fresh))[:, None, None]
    strain, strain_slope = active * strain, active * strain_slope
    force = slope.drag[..., None] * strain + law.drag[..., None] * strain_slope
    return Answer(force.sum(1), strain_slope, active[..., None] * by_vector)


def _steps(law: Laws, t: int, first: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return kept and given of the step to frame t, (B, 1, 1)."""
    if first:
        one = np.ones((len(law.fresh), 1, 1))
        return one, one
    return law.kept[t, :, None, None], law.given[t, :, None, None]


def clipped(strain: np.ndarray, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return strains (B, N+1, 2) no longer than slip (B, N+1), by how much they were shortened, and
    their unit vectors where they were."""
    size = np.linalg.norm(strain, axis=-1)
    long = size > slip
    share = np.where(long, slip / np.maximum(size, 1e-300), 1.0)
    direction = strain / np.maximum(size, 1e-300)[..., None] * long[..., None]
    return share[..., None] * strain, share, direction


def _times(slope: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return slopes (B, N+1, 2, 2) times changes (P, B, N+1, 2), or (P, 1, N+1, 2)."""
    return slope[..., 0] * change[..., :1] + slope[..., 1] * change[..., 1:]
