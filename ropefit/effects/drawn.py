"""What a picture shows of an effect, in terms of any effect: a symbol, a direction, a place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Symbol = Literal[
    "stretch", "weight", "load", "arc", "kink", "clamp", "turn", "arrow", "tether", "plane",
    "bar", "gravity", "clock", "centre", "follower",
    # of what has no place on the rope
    "ruler", "camera", "spring", "dashpot", "swing", "mesh", "loop", "graph",
]  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """A symbol at the effect's place on the rope; the default is the stretch that it acts on.

    vector (3,): the direction of an arrow, an axis or a normal; point (3,) [m]: a place in space
    against the middle of the ends; size: of a stretch, its thickness against the rest; of an arc
    or a bar, the radius [m]; of a force, positive outwards. curve (P, 2): of a graph. label: beside
    the symbol; if empty, the effect's first quantity.
    """

    symbol: Symbol = "stretch"
    vector: np.ndarray | None = None
    point: np.ndarray | None = None
    size: float = 1.0
    label: str = ""
    curve: np.ndarray | None = None


def components(values: dict[str, float], name: str) -> np.ndarray:
    """Return (3,) the components `name`x, y, z of a vector among an effect's values."""
    return np.array([values[f"{name}{axis}"] for axis in "xyz"])
