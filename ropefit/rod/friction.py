"""Coulomb friction of nodes on what they touch, by increments from frame to frame.

A node is held, across the normal, by a spring of the contact's hardness at the place where it was
in the frame before; the spring bears no more than the coefficient times the normal force, and what
is too long is dragged along (Wriggers, Computational Contact Mechanics, 5.2). So is one that only
now touches down: it slides the way that it comes. Were it free until the next frame, part of the
rope would not rub at the end of every increment, and shapes would jump with what touches when.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ropefit.rod.setup import Potential

TINY = 1e-30  # m², N²: keeps the direction of nothing at zero


class Grip(NamedTuple):
    """place (..., N+1, 3) [m] where the nodes are held, held (..., N+1): those that are, once
    they touch."""

    place: Tensor
    held: Tensor


def push(contact: Potential, x: Tensor) -> Tensor:
    """Return (..., 3) the normal force [N] of one whole node at x (..., 3) [m]."""
    if contact.slope is not None and not x.requires_grad:
        return -contact.slope(x)
    with torch.enable_grad():
        at = x if x.requires_grad else x.detach().requires_grad_()
        slope = torch.autograd.grad(contact.energy(at).sum(), at, create_graph=x.requires_grad)[0]
    return -slope


def dragged(contact: Potential, grip: Grip, x: Tensor) -> Tensor:
    """Return (..., N+1, 3) [m] where nodes that have come to x are held."""
    offset, reach = _offset(grip, x, push(contact, x), contact)
    length = torch.sqrt((offset**2).sum(-1) + TINY)
    kept = torch.where(length > reach, reach / length, 1.0)
    return torch.where(grip.held[..., None], x - kept[..., None] * offset, x)


def force(contact: Potential, grip: Grip, x: Tensor) -> Tensor:
    """Return (..., N+1, 3) [N] the friction on the nodes at x."""
    assert contact.hardness is not None
    assert contact.rubbing is not None
    return contact.hardness * contact.rubbing[..., None] * (dragged(contact, grip, x) - x)


def after(contact: Potential, grip: Grip, x: Tensor) -> Grip:
    """Return the grip once a frame has settled at x."""
    assert contact.rubbing is not None
    held = (contact.rubbing > 0).expand(x.shape[:-1])
    return Grip(dragged(contact, grip, x).detach(), held)


def potential(contact: Potential, grip: Grip) -> Potential:
    """Return an energy whose slope is the friction, for a normal force that stays as it is."""
    assert contact.hardness is not None
    assert contact.rubbing is not None
    hardness = contact.hardness

    def lengths(x: Tensor) -> tuple[Tensor, Tensor]:
        offset, reach = _offset(grip, x, push(contact, x.detach()).detach(), contact)
        return torch.sqrt((offset**2).sum(-1) + TINY), reach

    def energy(x: Tensor) -> Tensor:
        length, reach = lengths(x)
        inside, beyond = 0.5 * length**2, reach * (length - 0.5 * reach)
        value = hardness * torch.where(length > reach, beyond, inside)
        return torch.where(grip.held, value, 0.0)

    def touching(x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return which nodes (..., N+1) touch where they are held, and of those M: how far they are
        from there (M, 3) [m], that as a multiple of how far they can be, the normal (M, 3)."""
        pushed = push(contact, x)
        at = (pushed != 0).any(-1) & grip.held
        few = Grip(grip.place.expand(x.shape)[at], grip.held.expand(at.shape)[at])
        offset, reach = _offset(few, x[at], pushed[at], contact)
        length = torch.sqrt((offset**2).sum(-1) + TINY)
        return at, offset, length / reach, pushed[at]

    def slope(x: Tensor) -> Tensor:
        at, offset, times, _ = touching(x)
        out = torch.zeros_like(x)
        out[at] = (hardness / times.clamp_min(1.0))[:, None] * offset
        return out

    def derivatives(x: Tensor) -> tuple[Tensor, Tensor]:
        at, offset, times, pushed = touching(x)
        held = (hardness / times.clamp_min(1.0))[:, None]
        way = torch.where(times > 1, 1.0, 0.0)[:, None] * _unit(offset)
        normal = _unit(pushed)
        across = torch.eye(3, dtype=x.dtype) - way[..., :, None] * way[..., None, :]
        across = across - normal[..., :, None] * normal[..., None, :]
        first, second = torch.zeros_like(x), x.new_zeros((*x.shape, 3))
        first[at], second[at] = held * offset, held[..., None] * across
        return first, second

    return Potential(
        energy, contact.rubbing, cornered=True, derivatives=derivatives, slope=slope
    )  # fmt: skip


def _unit(vectors: Tensor) -> Tensor:
    return vectors / torch.sqrt((vectors**2).sum(-1, keepdim=True) + TINY)


def slopes(contact: Potential, grip: Grip, x: Tensor) -> tuple[Tensor, Tensor]:
    """Return (..., N+1, 3, 3) the derivatives of `dragged` in the nodes and in the places."""
    x = x.detach().requires_grad_()
    place = grip.place.detach().requires_grad_()
    out = dragged(contact, grip._replace(place=place), x)
    rows = [torch.autograd.grad(out[..., a].sum(), (x, place), retain_graph=True) for a in range(3)]
    return torch.stack([r[0] for r in rows], -2), torch.stack([r[1] for r in rows], -2)


def _offset(grip: Grip, x: Tensor, pushed: Tensor, contact: Potential) -> tuple[Tensor, Tensor]:
    """Return how far nodes are from where they are held, across the normal, and can be [m]."""
    assert contact.friction is not None
    assert contact.hardness is not None
    size = torch.sqrt((pushed**2).sum(-1) + TINY)
    normal = pushed / size[..., None]
    offset = x - grip.place
    offset = offset - (offset * normal).sum(-1, keepdim=True) * normal
    touches = (pushed != 0).any(-1)
    return offset, torch.where(touches, contact.friction * size / contact.hardness, 0.0)
