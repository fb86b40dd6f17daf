"""OBJ1-OBJ9: the paper's table of losses, in 3D, in the image, and in the image with the lowest
point.

Image-plane residuals are pixels times the size of a pixel at the rope (its depth over the focal
length, a constant of each frame), so that every loss is in metres and `+ L_LO` adds like to like.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from ropefit.losses.primary import (
    Observed,
    Residual,
    lowest_point,
    point_to_line,
    segment_to_line,
    segment_to_particle,
)
from ropefit.plugins import LOSSES, named


class Pinhole(NamedTuple):
    """Camera as tensors: focal (2,) and centre (2,) [px], rotation (3, 3) and origin (3,) of its
    pose."""

    focal: Tensor
    centre: Tensor
    rotation: Tensor
    origin: Tensor

    def project(self, x: Tensor) -> Tensor:
        """Return (..., 2) pixels of points x (..., 3) [m]; points behind the camera are put far
        outside."""
        local = (x - self.origin) @ self.rotation
        depth = local[..., 2:]
        depth = torch.where(depth.abs() < 1e-6, 1e-6, depth)
        return local[..., :2] / depth.abs() * self.focal + self.centre

    def depth(self, x: Tensor) -> Tensor:
        """Return (...) distance along the optical axis [m]."""
        return ((x - self.origin) @ self.rotation)[..., 2]


class Scene(NamedTuple):
    """All data of F frames: in space, in the image, and the camera between them.

    pixel_size (F,) [m/px] at the rope; lowest (F, 3) [m]; down (3,) unit.
    """

    space: Observed
    image: Observed
    camera: Pinhole
    pixel_size: Tensor
    lowest: Tensor
    down: Tensor

    def frames(self, index: Tensor) -> Scene:
        """Return the same for some frames only."""
        return Scene(
            Observed(*(item[index] for item in self.space)),
            Observed(*(item[index] for item in self.image)),
            self.camera,
            self.pixel_size[index],
            self.lowest[index],
            self.down,
        )

    def to(self, device: torch.device) -> Scene:
        """Return the same on a device."""
        return Scene(
            Observed(*(item.to(device) for item in self.space)),
            Observed(*(item.to(device) for item in self.image)),
            Pinhole(*(item.to(device) for item in self.camera)),
            *(item.to(device) for item in (self.pixel_size, self.lowest, self.down)),
        )


Primary = Callable[[Tensor, Observed], Residual]


class Objective(NamedTuple):
    """One row of the table: a primary loss, where it is taken, and whether L_LO is added."""

    name: str
    primary: Primary
    image: bool
    lowest: bool

    def residuals(self, x: Tensor, scene: Scene) -> list[Residual]:
        """Return residual vectors [m] of ropes x (..., F, K, 3)."""
        if self.image:
            pixels = self.primary(scene.camera.project(x), scene.image)
            size = scene.pixel_size[:, None, None]
            terms = [Residual(pixels.vectors * size, pixels.mask)]
        else:
            terms = [self.primary(x, scene.space)]
        if self.lowest:
            terms.append(lowest_point(x, scene.lowest, scene.down))
        return terms

    def loss(self, x: Tensor, scene: Scene) -> Tensor:
        """Return (..., F) loss [m] of each frame."""
        return torch.stack([term.loss() for term in self.residuals(x, scene)]).sum(0)


OBJECTIVES: dict[str, Objective] = {
    f"OBJ{3 * row + column + 1}": Objective(
        f"OBJ{3 * row + column + 1}", primary, image=column > 0, lowest=column == 2
    )
    for row, primary in enumerate((point_to_line, segment_to_particle, segment_to_line))
    for column in range(3)
}


def objective(name: str) -> Objective:
    """Return a loss by its name, an add-on's by that of its entry point. Raises StageFailed."""
    return OBJECTIVES[name] if name in OBJECTIVES else named(LOSSES, name)
