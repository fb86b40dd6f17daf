"""What the exported Python scripts share: the rope's numbers as literals."""

from __future__ import annotations

import numpy as np

from ropefit.exporters.description import RopeDescription
from ropefit.exporters.layout import Layout
from ropefit.exporters.rotation import matrix


def literal(values: np.ndarray) -> str:
    """Return a nested Python list, 10 significant digits."""
    array = np.asarray(values, dtype=float)
    if array.ndim == 0:
        return f"{float(array):.10g}"
    return "[" + ", ".join(literal(item) for item in array) + "]"


def assign(name: str, values: np.ndarray, note: str) -> str:
    """Return one line `NAME = np.array([...])  # note`."""
    return f"{name} = np.array({literal(values)})  # {note}"


def title(rope: RopeDescription, what: str, lost: list[str]) -> list[str]:
    """Return the script's docstring; the name is shown as a Python literal, so that it cannot end
    it."""
    safe = ascii(rope.name).replace('"', "'")
    lines = [f'"""{what} Written by ropefit from {safe}.', ""]
    lines.append("Units: m, kg, s, N. The rope runs from end 0 to end 1.")
    if lost:
        lines += ["", "Not expressed:", *(f"- {sentence}" for sentence in lost)]
    return [*lines, '"""', ""]


def directors(layout: Layout, pose: int) -> np.ndarray:
    """Return (V-1, 3, 3) the rows are the material axes e1, e2, e3 of each edge."""
    return np.swapaxes(matrix(layout.frames(pose)), -1, -2)
