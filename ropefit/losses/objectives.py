"""OBJ1-OBJ9: the paper's table of losses, in 3D, in the image, and in the image with the lowest
point.

Image-plane residuals are pixels times the size of a pixel at the rope (its depth over the focal
length, a constant of each frame), so that every loss is in metres and `+ L_LO` adds like to like.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from array_api_compat import array_namespace

from ropefit.losses.primary import (
    Observed,
    Residual,
    lowest_point,
    point_to_line,
    segment_to_line,
    segment_to_particle,
)
from ropefit.plugins import LOSSES, named
from ropefit.rod.either import Array

if TYPE_CHECKING:
    import torch


class Pinhole(NamedTuple):
    """Camera: focal (2,) and centre (2,) [px], rotation (3, 3) and origin (3,) of its pose."""

    focal: Array
    centre: Array
    rotation: Array
    origin: Array

    def project(self, x: Array) -> Array:
        """Return (..., 2) pixels of points x (..., 3) [m]; points behind the camera are put far
        outside."""
        local = (x - self.origin) @ self.rotation
        depth = abs(local[..., 2:])
        depth = array_namespace(x).where(depth < 1e-6, 1e-6, depth)
        return local[..., :2] / depth * self.focal + self.centre

    def depth(self, x: Array) -> Array:
        """Return (...) distance along the optical axis [m]."""
        return ((x - self.origin) @ self.rotation)[..., 2]


class Scene(NamedTuple):
    """All data of F frames: in space, in the image, and the camera between them.

    pixel_size (F,) [m/px] at the rope; lowest (F, 3) [m]; down (3,) unit.
    """

    space: Observed
    image: Observed
    camera: Pinhole
    pixel_size: Array
    lowest: Array
    down: Array

    def frames(self, index: Array) -> Scene:
        """Return the same for some frames only."""
        return Scene(
            Observed(*(item[index] for item in self.space)),
            Observed(*(item[index] for item in self.image)),
            self.camera,
            self.pixel_size[index],
            self.lowest[index],
            self.down,
        )

    def tensors(self, device: torch.device | None = None) -> Scene:
        """Return the same as tensors, on a device."""
        import torch

        def put(items: Iterable[Array]) -> Iterator[torch.Tensor]:
            return (torch.tensor(np.asarray(item), device=device) for item in items)

        space, image, camera, *rest = self
        return Scene(
            Observed(*put(space)), Observed(*put(image)), Pinhole(*put(camera)), *put(rest)
        )


Primary = Callable[[Array, Observed], Residual]


class Objective(NamedTuple):
    """One row of the table: a primary loss, where it is taken, and whether L_LO is added."""

    name: str
    primary: Primary
    image: bool
    lowest: bool

    def residuals(self, x: Array, scene: Scene) -> list[Residual]:
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

    def loss(self, x: Array, scene: Scene) -> Array:
        """Return (..., F) loss [m] of each frame."""
        return sum(term.loss() for term in self.residuals(x, scene))


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
