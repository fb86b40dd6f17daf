"""What rigid bodies that the rope touches have in common. A contact effect subclasses `Contact`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import horizontal
from ropefit.rod.setup import Potential, Setup

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


def hardness(setup: Setup) -> Tensor:
    """Return the stiffness [N/m] of contact for this rope."""
    return HARDNESS * setup.weight.detach()


def with_contact(
    setup: Setup,
    gap: Callable[[Tensor], Tensor],
    share: Tensor,
    shape: Callable[[Tensor], tuple[Tensor, Tensor]] | None = None,
) -> Setup:
    """Return the setup with a frictionless body at gap(x (..., 3)) -> (...,) [m], negative inside.

    share (N+1,): how many nodes each node stands for. shape(x): the gap's slope (..., 3), or
    (3,) everywhere, and its curvature (..., 3, 3) [1/m], or () zero; None: by autograd, slower.
    """
    stiff = hardness(setup)

    def energy(x: Tensor) -> Tensor:
        return 0.5 * stiff * torch.clamp(-gap(x), min=0.0) ** 2

    def derivatives(x: Tensor) -> tuple[Tensor, Tensor]:
        assert shape is not None
        gaps, slope, rows = gap(x), torch.zeros_like(x), x.new_zeros((*x.shape, 3))
        deep = gaps < 0  # few nodes are
        if deep.any():
            inside, (normal, curvature) = gaps[deep][:, None], shape(x[deep])
            slope[deep] = stiff * inside * normal
            square = normal[..., :, None] * normal[..., None, :]
            rows[deep] = stiff * (square + inside[..., None] * curvature)
        return slope, rows

    def slope(x: Tensor) -> Tensor:
        assert shape is not None
        gaps, out = gap(x), torch.zeros_like(x)
        deep = gaps < 0
        if deep.any():
            out[deep] = stiff * gaps[deep][:, None] * shape(x[deep])[0]
        return out

    body = Potential(energy, share, stiff)
    if shape is not None:
        body = body._replace(derivatives=derivatives, slope=slope)
    return setup._replace(potentials=(*setup.potentials, body))


def with_body(setup: Setup, *row: Tensor) -> Setup:
    """Return the setup of a rope in motion with one more body; row: see `Moving.bodies`."""
    body = torch.cat([torch.atleast_1d(part) for part in row])[None]
    bodies = body if setup.bodies is None else torch.cat([setup.bodies, body])
    return setup._replace(bodies=bodies)


def bears_most(depth: np.ndarray, place: np.ndarray) -> tuple[int, np.ndarray] | None:
    """Return the frame in which nodes at place (F, N+1, 3) [m] are deepest in a body, by the sum of
    their depths (F, N+1) [m], and the centre (3,) [m] of these; None where none is inside."""
    frame = int(depth.sum(axis=1).argmax())
    if not depth[frame].any():
        return None
    return frame, np.average(place[frame], axis=0, weights=depth[frame])


def touching(segments: int) -> Tensor:
    """Return (N+1,) shares of the nodes in contact, of which some stand for the others."""
    every = max(1, segments // MOST_CONTACT_NODES)
    share = torch.zeros(segments + 1, dtype=torch.float64)
    share[::every] = float(every)
    return share


def up_and_normal(setup: Setup, slope_1: Tensor, slope_2: Tensor) -> tuple[Tensor, Tensor]:
    """Return (3,), (3,) unit vectors against gravity, and normal to a plane of these slopes."""
    first, second = horizontal(setup.gravity)
    up = setup.up
    normal = up - slope_1 * first - slope_2 * second
    return up, normal / normal.norm()


def up_of(setup: Setup) -> np.ndarray:
    """Return (3,) the unit vector against gravity."""
    return setup.up.numpy()


def has_free_end(misfit: Misfit) -> bool:
    """Return whether an end is free: a cantilever that lies on something has no smooth path."""
    return bool(torch.isnan(misfit.setup.ends).any())
