"""What an effect is: one piece of physics or of measurement that a model may include.

An effect changes a `Setup`, in torch, so that every derivative follows by itself.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

from torch import Tensor

from ropefit.rod.setup import Setup

Kind = Literal["physics", "measurement", "solver"]
Locus = Literal["point", "interval", "end", "whole"]


@dataclass(frozen=True)
class Quantity:
    """A number of an effect: unit, bounds, and the size at which one starts to look for it."""

    name: str
    unit: str
    lower: float
    upper: float
    scale: float


class Effect(ABC):
    """One file an effect. Values are given in SI, in the order of `quantities` and then the place.

    The place is nothing for locus "whole" and "end" (there `end` is 0 or 1), the arc length [m] for
    "point", centre and width [m] for "interval".
    """

    name: ClassVar[str]
    kind: ClassVar[Kind] = "physics"
    locus: ClassVar[Locus] = "whole"
    quantities: ClassVar[tuple[Quantity, ...]]
    # Whether shapes change in proportion at small sizes; others are looked for at a finite size.
    linear: ClassVar[bool] = True

    def __init__(self, end: int = 0) -> None:
        self.end = end

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
