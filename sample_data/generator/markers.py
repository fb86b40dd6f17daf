"""Motion-capture markers glued to the rope."""

import csv
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from generator.recording import Truth

MARKERS = 13
MARKER_NOISE = 0.0003  # m, sd per axis
UNSEEN = 0.02  # share of markers the cameras lose


def write_markers(folder: Path, truth: Truth, rng: np.random.Generator) -> str:
    """Write ``markers.csv`` and return the ``[markers]`` table."""
    # The outermost markers sit beside the clamps, not inside them.
    arc_length = truth.rope.length * np.linspace(0.02, 0.98, MARKERS)
    positions = CubicSpline(truth.arc_length, truth.nodes, axis=1)(arc_length)
    positions += MARKER_NOISE * rng.standard_normal(positions.shape)
    positions[rng.random(positions.shape[:2]) < UNSEEN] = np.nan
    with (folder / "markers.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "time", "marker", "x", "y", "z"])
        for frame, row in enumerate(positions):
            for marker, position in enumerate(row):
                cells = [f"{value:.6f}" for value in position]
                writer.writerow([frame, f"{truth.times[frame]:.3f}", marker, *cells])
    stations = ", ".join(f"{value:.4f}" for value in arc_length)
    return f'[markers]\nfile = "markers.csv"\narc_length = [{stations}]\n'
