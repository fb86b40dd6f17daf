"""What holds a rope in each frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ropefit.rod.either import Array, plain


class FrictionElements(NamedTuple):
    """B friction elements (Prandtl, or Dahl) at every bend element of F frames.

    Each is a spring between the vector part of the element's Darboux quaternion, about the first
    two directors, and centre (F, B, N+1, 2); of stiffness drag (F, B, N+1) [N m], with a force that
    no longer grows where it is longer than slip (F, B, N+1). Where gradual (F, B) it is strained by
    strain (F, B, N+1, 2) at the centre and builds up over the range slip, see `rod.dahl`.
    """

    drag: np.ndarray
    centre: np.ndarray
    slip: np.ndarray
    strain: np.ndarray
    gradual: np.ndarray

    @classmethod
    def slipping(cls, drag: np.ndarray, centre: np.ndarray, slip: np.ndarray) -> FrictionElements:
        """Return Prandtl's elements, all of them."""
        return cls(drag, centre, slip, np.zeros_like(centre), np.zeros(drag.shape[:2], dtype=bool))

    def frames(self, index: np.ndarray) -> FrictionElements:
        """Return those of some of the frames."""
        return FrictionElements(*(item[index] for item in self))


@dataclass(frozen=True)
class Conditions:
    """What holds the rope in F frames.

    ends (F, 2, 3) [m] and clamp (F, 2, 4), NaN where not held. More supports: node (S,),
    direction (F, S, 3), offset (F, S) [m], compliance (F, S) [m/N], active (F, S): the force λ on
    the node along the direction obeys direction · x + compliance λ = offset.
    friction_elements: what the past of a rope that remembers has left in it. axial (A,): the law
    of axial strain, see `rod.axial`; none where that is in proportion to tension.
    """

    ends: Array
    clamp: Array
    node: np.ndarray | None = None
    direction: Array | None = None
    offset: Array | None = None
    compliance: Array | None = None
    active: np.ndarray | None = None
    friction_elements: FrictionElements | None = None
    axial: np.ndarray | None = None

    @cached_property
    def free(self) -> bool:
        """Return whether nothing holds node 0."""
        return _unknown(self.ends[:, 0])

    @cached_property
    def far_held(self) -> bool:
        """Return whether the far end's place is given."""
        return not _unknown(self.ends[:, 1])

    @property
    def far_supports(self) -> int:
        """Return how many supports hold the far end: 3, or 0 where it is free. They come first."""
        return 3 if self.far_held else 0

    @property
    def supports(self) -> int:
        """Return S, the far end's included."""
        return self.far_supports + (0 if self.node is None else len(self.node))

    def frames(self, index: np.ndarray) -> Conditions:
        """Return the conditions of some of the frames."""
        few = self._each(lambda value: value[index])
        active = None if self.active is None else self.active[index]
        past = None if self.friction_elements is None else self.friction_elements.frames(index)
        return replace(self, active=active, friction_elements=past, **few)

    def in_numpy(self) -> Conditions:
        """Return the conditions without tensors."""
        return replace(self, **self._each(plain))

    def _each(self, change: Callable[[Array], Array]) -> dict[str, Array]:
        """Return what is made of every array that may be a tensor, and is given."""
        names = ("ends", "clamp", "direction", "offset", "compliance")
        return {n: change(value) for n in names if (value := getattr(self, n)) is not None}


def _unknown(array: Array) -> bool:
    """Return whether any value is NaN."""
    return bool((array != array).any())
