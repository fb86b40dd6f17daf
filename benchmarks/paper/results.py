"""What an experiment's runs hold, as the tables and figures want it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.pipeline import Experiment
from benchmarks.paper.recordings import load_truth
from benchmarks.paper.runner import Place
from ropefit.adapters.scene import pinhole
from ropefit.artifacts import Control, FittedModel, Model, Observations
from ropefit.runs.loading import load

PAPER_WEIGHTS = ("eta_x_G", "eta_x_D", "eta_x_S", "eta_q_S", "eta_q_B", "eta_SOR")
SYMBOL = {
    "eta_x_G": "η_x^G", "eta_x_D": "η_x^D", "eta_x_S": "η_x^S", "eta_q_S": "η_q^S",
    "eta_q_B": "η_q^B", "eta_SOR": "η^SOR", "eta_x_G_0": "η_x^G, end 0 to gripper",
    "eta_x_G_1": "η_x^G, gripper to end 1",
}  # fmt: skip

MEANING = {
    "OBJ1": "3D point to line",
    "OBJ2": "2D point to line",
    "OBJ3": "2D point to line + lowest",
    "OBJ4": "3D segment to particle",
    "OBJ5": "2D segment to particle",
    "OBJ6": "2D segment to particle + lowest",
    "OBJ7": "3D segment to line",
    "OBJ8": "2D segment to line",
    "OBJ9": "2D segment to line + lowest",
}


@dataclass(frozen=True)
class Results:
    """An experiment that was performed: its files, and what its commands said."""

    experiment: Experiment
    place: Place
    said: dict[str, Any]
    figures: Path

    def observations(self, run: str) -> Observations:
        return load(self.place.run(run), Observations)[0]

    def model(self, run: str) -> FittedModel:
        return load(self.place.run(run), Model)[0].nominal

    def control(self, run: str, name: str) -> Control:
        return load(self.place.control(run, name), Control)[0]

    def truth(self, recording: str) -> dict[str, np.ndarray]:
        return load_truth(self.place.recording(recording))

    def values(self, run: str, group: str = "group_0") -> dict[str, float]:
        """Return the parameters as identified."""
        found = self.said[run]["identify"]["groups"][group]["parameters"]
        return {name: p["value"] for name, p in found.items()}

    def interval(self, run: str, name: str, group: str = "group_0") -> str:
        """Return a parameter with its 95 % interval."""
        p = self.said[run]["identify"]["groups"][group]["parameters"][name]
        unit = "" if p["unit"] == "1" else f" {p['unit']}"
        if p["ci95"] is None:
            return f"{p['value']:.3g}{unit} ({p['verdict']})"
        return f"{p['value']:.3g}{unit} ({p['ci95'][0]:.3g} to {p['ci95'][1]:.3g})"


Part = Callable[[Results], str]


def assemble(r: Results, title: str, parts: dict[str, tuple[tuple[str, ...], Part]]) -> str:
    """Return a chapter of parts {heading: (runs that it needs, its text)}.

    A part whose runs are not done says so.
    """
    out = [f"## {title}\n"]
    for heading, (needs, part) in parts.items():
        missing = [run for run in needs if run not in r.said]
        text = part(r) if not missing else f"Not run: {', '.join(missing)}.\n"
        out.append(f"### {heading}\n\n{text}")
    return "\n".join(out)


def states(o: Observations) -> tuple[int, int]:
    """Return the rows of the most bent and of the most tensioned frame, by the ends' distance."""
    apart = np.linalg.norm(o.end_position[:, 1] - o.end_position[:, 0], axis=1)
    return int(apart.argmin()), int(apart.argmax())


def cloud(o: Observations, row: int, projected: bool = True) -> np.ndarray:
    """Return (N, 3) [m] a frame's points, as they are used or as they were measured."""
    mine = slice(o.point_start[row], o.point_start[row + 1])
    points = o.points[mine]
    if o.projected and not projected:
        points = points + o.point_offset[mine, None] * o.plane_normal[row]
    return points


def pixels(o: Observations, x: np.ndarray) -> np.ndarray:
    """Return (N, 2) [px] where the camera sees points (N, 3) [m]."""
    return pinhole(o).project(x)


def lengths(x: np.ndarray) -> np.ndarray:
    """Return (F,) [m] lengths of ropes (F, K, 3)."""
    return np.linalg.norm(np.diff(x, axis=1), axis=2).sum(axis=1)


def at_arc(truth: dict[str, np.ndarray], s: float) -> np.ndarray:
    """Return the true rope's point (T, 3) [m] at arc length s [m]."""
    arc, nodes = truth["arc"], truth["nodes"]
    k = int(np.clip(np.searchsorted(arc, s), 1, len(arc) - 1))
    part = (s - arc[k - 1]) / (arc[k] - arc[k - 1])
    return (1 - part) * nodes[:, k - 1] + part * nodes[:, k]
