"""Figures of docs/paper.md, in the colours of the report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

DATA, FITTED, START, TRUE = "#56b4e9", "#d55e00", "#999999", "#009e73"
DPI = 90
mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})


def panels(columns: int, width: float = 3.4, height: float = 2.8) -> tuple[Any, Any]:
    """Return a figure with a row of axes."""
    figure, axes = plt.subplots(1, columns, figsize=(width * columns, height), squeeze=False)
    return figure, axes[0]


def curve(axes: Any, x: np.ndarray, color: str, label: str, **style: Any) -> None:
    """Plot a rope (N, 3) [m] from the front, in mm."""
    style = {"linewidth": 1.0} | style
    axes.plot(1e3 * x[:, 0], 1e3 * x[:, 2], color=color, label=label, **style)


def points(axes: Any, x: np.ndarray, color: str, label: str, up: int = 2, size: float = 2) -> None:
    """Plot points (N, 3) [m] from the front (up = 2) or from above (up = 1), in mm."""
    axes.scatter(
        1e3 * x[:, 0], 1e3 * x[:, up], s=size, color=color, label=label, linewidths=0, zorder=3
    )


def front(axes: Any, title: str) -> None:
    """Set axes up for a front view."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(title=title, xlabel="x [mm]", ylabel="z [mm]")


def save(figure: Any, folder: Path, name: str) -> Path:
    """Save a figure as PNG, small enough for the repository."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"paper-{name}.png"
    figure.tight_layout()
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
    return path
