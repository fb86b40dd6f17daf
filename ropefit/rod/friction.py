"""Coulomb friction of nodes on what they touch, by increments from frame to frame.

A node is held, across the normal, by a spring of the contact's hardness at the place where it was
in the frame before; the spring bears no more than the coefficient times the normal force, and what
is too long is dragged along (Wriggers, Computational Contact Mechanics, 5.2). So is one that only
now touches down: it slides the way that it comes. Were it free until the next frame, part of the
rope would not rub at the end of every increment, and shapes would jump with what touches when.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.potential import Potential, derivatives_of, slope_of

TINY = 1e-30  # m², N²: keeps the direction of nothing at zero


class Grip(NamedTuple):
    """place (..., N+1, 3) [m] where the nodes are held, held (..., N+1): those that are, once
    they touch."""

    place: np.ndarray
    held: np.ndarray


def push(contact: Potential, x: np.ndarray) -> np.ndarray:
    """Return (..., 3) the normal force [N] of one whole node at x (..., 3) [m]."""
    return -slope_of(contact, x)


def dragged(contact: Potential, grip: Grip, x: np.ndarray) -> np.ndarray:
    """Return (..., N+1, 3) [m] where nodes that have come to x are held."""
    offset, reach = _offset(grip, x, push(contact, x), contact)
    length = _size(offset)
    kept = np.where(length > reach, reach / length, 1.0)
    return np.where(grip.held[..., None], x - kept[..., None] * offset, x)


def force(contact: Potential, grip: Grip, x: np.ndarray) -> np.ndarray:
    """Return (..., N+1, 3) [N] the friction on the nodes at x."""
    assert contact.hardness is not None
    assert contact.rubbing is not None
    return contact.hardness * contact.rubbing[..., None] * (dragged(contact, grip, x) - x)


def after(contact: Potential, grip: Grip, x: np.ndarray) -> Grip:
    """Return the grip once a frame has settled at x."""
    assert contact.rubbing is not None
    held = np.broadcast_to(contact.rubbing > 0, x.shape[:-1])
    return Grip(dragged(contact, grip, x), held)


def potential(contact: Potential, grip: Grip) -> Potential:
    """Return an energy whose slope is the friction, for a normal force that stays as it is."""
    assert contact.hardness is not None
    assert contact.rubbing is not None
    hardness = contact.hardness

    def energy(x: np.ndarray) -> np.ndarray:
        offset, reach = _offset(grip, x, push(contact, x), contact)
        length = _size(offset)
        inside, beyond = 0.5 * length**2, reach * (length - 0.5 * reach)
        value = hardness * np.where(length > reach, beyond, inside)
        return np.where(grip.held, value, 0.0)

    def touching(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return which nodes (..., N+1) touch where they are held, and of those M: how far they are
        from there (M, 3) [m], that as a multiple of how far they can be, the normal (M, 3)."""
        pushed = push(contact, x)
        at = (pushed != 0).any(-1) & grip.held
        few = Grip(np.broadcast_to(grip.place, x.shape)[at], np.ones(int(at.sum()), dtype=bool))
        offset, reach = _offset(few, x[at], pushed[at], contact)
        with np.errstate(divide="ignore"):  # without friction
            return at, offset, _size(offset) / reach, pushed[at]

    def slope(x: np.ndarray) -> np.ndarray:
        at, offset, times, _ = touching(x)
        out = np.zeros_like(x)
        out[at] = (hardness / np.maximum(times, 1.0))[:, None] * offset
        return out

    def derivatives(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at, offset, times, pushed = touching(x)
        held = (hardness / np.maximum(times, 1.0))[:, None]
        way = np.where(times > 1, 1.0, 0.0)[:, None] * _unit(offset)
        normal = _unit(pushed)
        across = np.eye(3) - _square(way) - _square(normal)
        first, second = np.zeros_like(x), np.zeros((*x.shape, 3))
        first[at], second[at] = held * offset, held[..., None] * across
        return first, second

    return Potential(
        energy, contact.rubbing, cornered=True, derivatives=derivatives, slope=slope
    )  # fmt: skip


def slopes(contact: Potential, grip: Grip, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (..., N+1, 3, 3) the derivatives of `dragged` in the nodes and in the places."""
    assert contact.hardness is not None
    assert contact.friction is not None
    slope, curvature = derivatives_of(contact, x)
    pushed, pushed_by_x = -slope, -curvature
    offset, reach = _offset(grip, x, pushed, contact)
    normal, size = _unit(pushed)[..., None], _size(pushed)[..., None, None]
    along = (normal * (x - grip.place)[..., None]).sum(-2, keepdims=True)
    size_by_x = normal.swapaxes(-1, -2) @ pushed_by_x
    normal_by_x = (pushed_by_x - normal * size_by_x) / size
    across = np.eye(3) - normal * normal.swapaxes(-1, -2)
    # Of the offset, across the normal, which turns with the node.
    along_by_x = (x - grip.place)[..., None, :] @ normal_by_x
    by_x = across - normal * along_by_x - along * normal_by_x
    by_place = -across
    touches = (pushed != 0).any(-1)[..., None, None]
    reach_by_x = np.where(touches, contact.friction / contact.hardness * size_by_x, 0.0)
    length, way = _size(offset), _unit(offset)[..., None]
    slides = (length > reach)[..., None, None]
    share = (reach / length)[..., None, None]
    level = np.eye(3) - way * way.swapaxes(-1, -2)
    moved = np.where(slides, way * reach_by_x + share * (level @ by_x), by_x)
    held = grip.held[..., None, None]
    return (
        np.where(held, np.eye(3) - moved, np.eye(3)),
        np.where(held, -np.where(slides, share * (level @ by_place), by_place), 0.0),
    )


def _size(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors**2).sum(-1) + TINY)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / _size(vectors)[..., None]


def _square(vectors: np.ndarray) -> np.ndarray:
    return vectors[..., :, None] * vectors[..., None, :]


def _offset(
    grip: Grip, x: np.ndarray, pushed: np.ndarray, contact: Potential
) -> tuple[np.ndarray, np.ndarray]:
    """Return how far nodes are from where they are held, across the normal, and can be [m]."""
    assert contact.friction is not None
    assert contact.hardness is not None
    size = _size(pushed)
    normal = pushed / size[..., None]
    offset = x - grip.place
    offset = offset - (offset * normal).sum(-1, keepdims=True) * normal
    touches = (pushed != 0).any(-1)
    return offset, np.where(touches, contact.friction * size / contact.hardness, 0.0)
