"""Control, kind shape: the poses that give the wanted shapes, and how near the rope comes."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Control
from ropefit.reporting.camera import broadside
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    NOMINAL,
    TARGET,
    Figure,
    at,
    dots,
    evenly,
    path,
    space,
    thinned,
)
from ropefit.reporting.html import heading, paragraph, sequence, table
from ropefit.reporting.words import millimetres, number, percent

MOST_CASES = 60


def shape(run: RunContents, c: Control) -> Markup:
    """Return poses reached, the rope against its target points, and the deviations of those."""
    shown = evenly(len(c.cases), MOST_CASES)
    labels = [f"Target {c.cases[i]}" for i in shown]
    body = heading("Pose reached") + _poses(c)
    body += sequence([_ropes(run, c, shown)], labels)
    body += heading("Target points") + _targets(c, shown)
    return body + paragraph(thinned(len(c.cases), MOST_CASES, "targets"), "note")


def _vector(values: np.ndarray, digits: int) -> str:
    if not np.isfinite(values).all():
        return "not set"
    return ", ".join(f"{v:.{digits}f}".replace("-", "−") for v in values)


def _poses(c: Control) -> Markup:
    head = [
        "target",
        "position x, y, z (m)",
        "orientation w, x, y, z",
        "deviation",
        "error of length",
        "search",
    ]
    rows = []
    for i in evenly(len(c.cases), MOST_CASES):
        known = c.key_deviation[i][np.isfinite(c.key_deviation[i])]
        rms = float(np.sqrt(np.mean(known**2))) if known.size else None
        rows.append(
            [
                c.cases[i],
                _vector(c.position[i], 4),
                _vector(c.orientation[i], 4),
                f"{millimetres(rms)} rms" if rms is not None else "–",
                percent(float(c.length_error[i])),
                "converged" if c.converged[i] else "not converged",
            ]
        )
    return table(head, rows)


def _targets(c: Control, shown: np.ndarray) -> Markup:
    rows = []
    for i in shown:
        for k in np.flatnonzero(np.isfinite(c.key_reference[i]).all(axis=1)):
            arc = c.key_arc[i, k]
            rows.append(
                [
                    c.cases[i],
                    f"{number(float(arc))} m" if np.isfinite(arc) else "anywhere",
                    _vector(c.key_reference[i, k], 4),
                    _vector(c.key_position[i, k], 4),
                    millimetres(float(c.key_deviation[i, k])),
                ]
            )
    head = ["target", "arc length", "wanted x, y, z (m)", "reached x, y, z (m)", "deviation"]
    return table(head, rows[:200])


def _ropes(run: RunContents, c: Control, shown: np.ndarray) -> Figure:
    traces = [
        path("rope", NOMINAL, 4),
        dots("wanted points", TARGET, 8),
        dots("gripper’s start", "soft", 8, symbol="diamond-open"),
        dots("gripper", "ink", 8, symbol="diamond"),
    ]
    steps, everything = [], []
    for i in shown:
        parts = [c.x[i], c.key_reference[i], c.start[i][None], c.position[i][None]]
        everything += parts
        steps.append([at(part) for part in parts])
    cloud = np.concatenate(everything)
    low, high = np.nanmin(cloud, axis=0), np.nanmax(cloud, axis=0)
    eye, up = broadside(run.observations, cloud)
    return Figure(
        "The rope and its target points",
        traces,
        space(low, high, eye, up),
        "The simulated rope at the pose reached, and the points it was to pass through.",
        height=460,
        steps=steps,
    )
