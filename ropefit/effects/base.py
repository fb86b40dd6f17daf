"""What an effect is: one piece of physics or of measurement that a model may include.

An effect changes a `Setup`, in torch, so that every derivative follows by itself.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor

from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.setup import Setup

Kind = Literal["physics", "measurement", "solver"]
Locus = Literal["point", "interval", "end", "whole"]


@dataclass(frozen=True)
class Quantity:
    """A number of an effect: unit, bounds, and a usual size, at which one starts to look for it.

    The size may depend on the rope: `scale` is then a multiple of its weight [N] per power of its
    weight and length: size = scale * weight**by_weight * length**by_length; and be one of times:
    then it is a multiple of the recording's duration [s] as well. `inexact` is the share of its
    value by which it is off even where the noise is nothing: added to its standard error in
    quadrature.
    """

    name: str
    unit: str
    scale: float
    lower: float = -float("inf")
    upper: float = float("inf")
    by_weight: float = 0.0
    by_length: float = 0.0
    by_time: float = 0.0
    inexact: float = 0.0

    def size(self, setup: Setup) -> float:
        """The usual size for this rope, in SI."""
        weight, length = float(setup.weight), float(setup.properties.length.sum())
        size = self.scale * weight**self.by_weight * length**self.by_length
        return size if self.by_time == 0.0 else size * duration(setup) ** self.by_time


class Effect(ABC):
    """One file an effect. Values are given in SI: the `quantities`, then the place.

    The place is nothing for locus "whole" and "end" (there `end` is 0 or 1), the arc length [m] for
    "point", centre and width [m] for "interval". At zero quantities an effect does nothing.
    """

    name: ClassVar[str]
    kind: ClassVar[Kind] = "physics"
    locus: ClassVar[Locus] = "whole"
    quantities: ClassVar[tuple[Quantity, ...]]
    # Shapes change in proportion at small sizes; others are looked for by their whole response.
    linear: ClassVar[bool] = True
    # Small sizes are an error of the set-up, which every fit allows for within its prior.
    calibrated: ClassVar[bool] = False
    # Of the quantities, so many of the last say how the effect acts, not how much: they are looked
    # for at these multiples of their usual sizes.
    shaping: ClassVar[int] = 0
    tries: ClassVar[tuple[float, ...]] = (1.0,)
    # Quantities that are components of one vector are told as its size, under this name and unit.
    vector: ClassVar[tuple[str, str] | None] = None

    def __init__(self, end: int = 0) -> None:
        self.end = end

    def applies(self, setup: Setup) -> bool:
        """Whether the effect can occur in this setup at all."""
        return True

    @abstractmethod
    def apply(self, setup: Setup, values: Tensor) -> Setup:
        """The setup with the effect, of the sizes and at the place in values (n,)."""

    @abstractmethod
    def sentence(self, values: dict[str, float]) -> str:
        """What a person is told, given quantities and place by name (arc_length, centre, width)."""

    @property
    def place_names(self) -> tuple[str, ...]:
        return {"point": ("arc_length",), "interval": ("centre", "width")}.get(self.locus, ())

    @property
    def names(self) -> tuple[str, ...]:
        """Of all values, in order."""
        return (*(q.name for q in self.quantities), *self.place_names)


def duration(setup: Setup) -> float:
    """[s] from the first frame to the last."""
    return float((setup.clock.max() - setup.clock.min()).clamp_min(1e-9))


def one_end(end: int, value: Tensor) -> Tensor:
    """(2, ...) with value (...) at one end and zero at the other."""
    zero = torch.zeros_like(value)
    return torch.stack([value, zero] if end == 0 else [zero, value])


def turned_clamp(setup: Setup, end: int, turn: Tensor) -> Setup:
    """The setup with one end's clamp turned by turn (3,) [rad] about its own axes."""
    wide = torch.zeros(2, 1, dtype=torch.bool)
    wide[end] = True
    turned = multiply(setup.clamp, from_rotation_vector(turn).expand_as(setup.clamp))
    return setup._replace(clamp=torch.where(wide, turned, setup.clamp))


def where(end: int) -> str:
    """An end in words."""
    return "the gripper's end (end 0)" if end == 0 else "the other end (end 1)"
