"""What holds a rope in each frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor


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

    ends: Tensor
    clamp: Tensor
    node: np.ndarray | None = None
    direction: Tensor | None = None
    offset: Tensor | None = None
    compliance: Tensor | None = None
    active: np.ndarray | None = None
    friction_elements: FrictionElements | None = None
    axial: np.ndarray | None = None

    @cached_property
    def free(self) -> bool:
        """Return whether nothing holds node 0."""
        return bool(torch.isnan(self.ends[:, 0]).any())

    @cached_property
    def far_held(self) -> bool:
        """Return whether the far end's place is given."""
        return not bool(torch.isnan(self.ends[:, 1]).any())

    @property
    def far_supports(self) -> int:
        """Return how many supports hold the far end: 3, or 0 where it is free. They come first."""
        return 3 if self.far_held else 0

    @property
    def supports(self) -> int:
        """Return S, the far end's included."""
        return self.far_supports + (0 if self.node is None else len(self.node))

    def frames(self, index: Tensor | np.ndarray) -> Conditions:
        """Return the conditions of some of the frames."""
        index = torch.as_tensor(index)
        few = {
            name: value[index]
            for name in ("ends", "clamp", "direction", "offset", "compliance")
            if (value := getattr(self, name)) is not None
        }
        active = None if self.active is None else self.active[index.numpy()]
        past = (
            None if self.friction_elements is None else self.friction_elements.frames(index.numpy())
        )
        return replace(self, active=active, friction_elements=past, **few)
