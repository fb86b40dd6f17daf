"""What rigid bodies that the rope touches have in common. A contact effect subclasses `Contact`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ropefit.effects.base import Effect
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import horizontal
from ropefit.rod.potential import Potential
from ropefit.rod.setup import Setup

HARDNESS = 200.0  # weights of the rope per metre of indentation: a hundredth of its weight: 50 µm
MOST_CONTACT_NODES = 60  # about so many nodes stand for all, which bounds the cost of contact
NO_SPREAD = 1e-4  # m: added to the noise, of which markers may have next to none


class Contact(Effect):
    """A body that the rope touches in some frames.

    Contact has no derivative before it is made: it is never scanned, but proposed by `starts` from
    where the data stop. At rest it may act in two neighbouring frames, of which neither predicts
    the other: stretches of the rope are held out instead of frames.
    """

    linear = False
    scanned = False
    slow = True
    held_out = "stretches"


def hardness(setup: Setup) -> np.ndarray:
    """Return the stiffness [N/m] of contact for this rope."""
    return np.array(HARDNESS * setup.weight)


def with_contact(
    setup: Setup,
    gap: Callable[[np.ndarray], np.ndarray],
    share: np.ndarray,
    shape: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None,
) -> Setup:
    """Return the setup with a frictionless body at gap(x (..., 3)) -> (...,) [m], negative inside.

    share (N+1,): how many nodes each node stands for. shape(x): the gap's slope (..., 3), or
    (3,) everywhere, and its curvature (..., 3, 3) [1/m], or () zero; None: by differences, slower.
    """
    stiff = hardness(setup)

    def energy(x: np.ndarray) -> np.ndarray:
        return 0.5 * stiff * np.maximum(-gap(x), 0.0) ** 2

    if shape is None:
        return setup._replace(potentials=(*setup.potentials, Potential(energy, share, stiff)))

    def derivatives(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gaps, slope, rows = gap(x), np.zeros_like(x), np.zeros((*x.shape, 3))
        deep = gaps < 0  # few nodes are
        if deep.any():
            inside, (normal, curvature) = gaps[deep][:, None], shape(x[deep])
            slope[deep] = stiff * inside * normal
            square = normal[..., :, None] * normal[..., None, :]
            rows[deep] = stiff * (square + inside[..., None] * curvature)
        return slope, rows

    def slope(x: np.ndarray) -> np.ndarray:
        gaps, out = gap(x), np.zeros_like(x)
        deep = gaps < 0
        if deep.any():
            out[deep] = stiff * gaps[deep][:, None] * shape(x[deep])[0]
        return out

    body = Potential(energy, share, stiff, derivatives=derivatives, slope=slope)
    return setup._replace(potentials=(*setup.potentials, body))


def with_body(setup: Setup, *row: np.ndarray | float) -> Setup:
    """Return the setup of a rope in motion with one more body; row: see `Moving.bodies`."""
    body = np.hstack(row)[None]
    bodies = body if setup.bodies is None else np.concatenate([setup.bodies, body])
    return setup._replace(bodies=bodies)


def bears_most(depth: np.ndarray, place: np.ndarray) -> tuple[int, np.ndarray] | None:
    """Return the frame in which nodes at place (F, N+1, 3) [m] are deepest in a body, by the sum of
    their depths (F, N+1) [m], and the centre (3,) [m] of these; None where none is inside."""
    frame = int(depth.sum(axis=1).argmax())
    if not depth[frame].any():
        return None
    return frame, np.average(place[frame], axis=0, weights=depth[frame])


def touching(segments: int) -> np.ndarray:
    """Return (N+1,) shares of the nodes in contact, of which some stand for the others."""
    every = max(1, segments // MOST_CONTACT_NODES)
    share = np.zeros(segments + 1)
    share[::every] = every
    return share


def up_and_normal(setup: Setup, slope_1: float, slope_2: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (3,), (3,) unit vectors against gravity, and normal to a plane of these slopes."""
    first, second = horizontal(setup.gravity)
    up = setup.up
    normal = up - slope_1 * first - slope_2 * second
    return up, normal / np.linalg.norm(normal)


def up_of(setup: Setup) -> np.ndarray:
    """Return (3,) the unit vector against gravity."""
    return setup.up


def has_free_end(misfit: Misfit) -> bool:
    """Return whether an end is free: a cantilever that lies on something has no smooth path."""
    return bool(np.isnan(misfit.setup.ends).any())
