"""Accuracy of preprocess: rendered RGB-D frames, and clouds with outliers and a table.

    python -m benchmarks.perception [--frames 10] [--write docs/results.md] [--json FILE]

Rendered (benchmarks/perception/rendered.py): 1280 x 720, six ropes of 4-12 mm; in every other frame
the rope crosses itself in the picture. Both ends are known, as in a lab. A stretch
counts as marked unseen where no point lies within MARK of it along the rope.
"""

from __future__ import annotations

import time
from typing import Any

import cv2
import numpy as np
from scipy.spatial import KDTree

from benchmarks.document import parser, publish
from benchmarks.perception.rendered import (
    DISTANCE,
    LENGTH,
    ROPES,
    Frame,
    Kind,
    camera,
    render,
    shape,
)
from ropefit.perception.cloud import trace_cloud
from ropefit.perception.learning import Picture, best_looks
from ropefit.perception.rgbd import trace_rgbd
from ropefit.perception.segment import Looked
from ropefit.perception.trace import FrameRejected, Trace

MARK = 0.006  # m
MARGIN = 0.008  # m: edges of hidden stretches that count for neither
LEARN_FROM = 3  # frames of a rope, as preprocess does
CLOUD_POINTS, TABLE_POINTS, OUTLIERS = 1500, 4000, 0.05


def measure(frames: int) -> dict[str, Any]:
    """Return all numbers of the tables."""
    cv2.setNumThreads(1)
    rows = []
    for number, kind in enumerate(ROPES):
        seen = [
            render(kind, np.random.default_rng([number, i]), loop=i % 2 == 1) for i in range(frames)
        ]
        rows.append(_rope(kind, seen))
    return {"frames": frames, "rgbd": rows, "clouds": [_clouds(kind) for kind in ROPES]}


def _rope(kind: Kind, frames: list[Frame]) -> dict[str, Any]:
    looked, pictures = Looked(), []
    for frame in frames[:LEARN_FROM]:
        try:
            _, found = _trace(kind, frame, looked)
            tips = camera().project(frame.curve[[0, -1]])
            pictures.append(Picture(frame.color, frame.depth, tips, found))
        except FrameRejected:
            continue
    looked = Looked(looks=best_looks(pictures))
    errors, seconds, dropped, flips, crossed, resolved = [], [], [], 0, 0, 0
    marked, hidden, false, shown = 0, 0, 0, 0
    for i, frame in enumerate(frames):
        started = time.process_time()
        try:
            trace, found = _trace(kind, frame, looked)
        except FrameRejected as reason:
            dropped.append(f"frame {i}: {reason}")
            continue
        seconds.append(time.process_time() - started)
        seen = distances(trace, frame)
        errors.append(seen)
        truth = _true_arc(frame, trace.points)
        flips += int(np.corrcoef(truth, trace.point_arc)[0, 1] < 0)
        unseen = _marked(frame, trace)
        clear = _clear(frame)
        hidden += int((frame.hidden & clear).sum())
        marked += int((frame.hidden & clear & unseen).sum())
        shown += int((~frame.hidden & clear).sum())
        false += int((~frame.hidden & clear & unseen).sum())
        if frame.crossing:
            crossed += 1
            # Resolved: the order along the rope is right on both sides of the crossing.
            resolved += int(np.abs(truth - trace.point_arc).max() < 0.03)
    all_errors = np.concatenate(errors) if errors else np.array([np.nan])
    return {
        "name": kind.name,
        "diameter_m": kind.diameter,
        "used": len(seconds),
        "dropped": dropped,
        "median_m": float(np.median(all_errors)),
        "p95_m": float(np.percentile(all_errors, 95)),
        "unseen_recall": marked / max(hidden, 1),
        "seen_marked_unseen": false / max(shown, 1),
        "flips": flips,
        "crossings": crossed,
        "resolved": resolved,
        "seconds": float(np.median(seconds)) if seconds else None,
    }


def _trace(kind: Kind, frame: Frame, looked: Looked):
    ends = frame.curve[[0, -1]]
    length = float(frame.arc[-1])
    return trace_rgbd(frame.color, frame.depth, camera(), ends, length, kind.diameter / 2, looked)


def distances(trace: Trace, frame: Frame) -> np.ndarray:
    """Return distances [m] of the true centreline, where visible, from the traced one."""
    at = np.flatnonzero(~frame.hidden & _clear(frame))[::10]
    dense = np.stack(
        [np.interp(np.linspace(0, trace.length, 8000), trace.arc, c) for c in trace.centreline.T], 1
    )
    return np.asarray(KDTree(dense).query(frame.curve[at])[0])


def _true_arc(frame: Frame, points: np.ndarray) -> np.ndarray:
    return frame.arc[np.asarray(KDTree(frame.curve).query(points)[1])]


def _marked(frame: Frame, trace: Trace) -> np.ndarray:
    gap, _ = KDTree(trace.point_arc[:, None]).query(frame.arc[:, None])
    return np.asarray(gap) > MARK


def _clear(frame: Frame) -> np.ndarray:
    """Return whether (N,) points are away from the edges of hidden stretches."""
    edges = frame.arc[1:][np.diff(frame.hidden.astype(int)) != 0]
    out = np.ones(len(frame.arc), dtype=bool)
    for edge in edges:
        out &= np.abs(frame.arc - edge) > MARGIN
    return out


def _clouds(kind: Kind, count: int = 10) -> dict[str, Any]:
    """Measure one-sided clouds of a rope over a table, with outliers and a hidden tenth."""
    errors, seconds, dropped = [], [], []
    for i in range(count):
        rng = np.random.default_rng([77, i])
        arc, curve = shape(rng, loop=False)
        points = cloud(rng, arc, curve, kind.diameter / 2)
        started = time.process_time()
        try:
            trace = trace_cloud(
                points, curve[[0, -1]], float(arc[-1]), kind.diameter / 2, np.zeros(3)
            )
        except FrameRejected as reason:
            dropped.append(f"cloud {i}: {reason}")
            continue
        seconds.append(time.process_time() - started)
        frame = Frame(np.zeros(0), np.zeros(0), curve, arc, np.zeros(len(arc), dtype=bool), None)
        errors.append(distances(trace, frame))
    everything = np.concatenate(errors) if errors else np.array([np.nan])
    return {
        "name": kind.name,
        "diameter_m": kind.diameter,
        "used": len(errors),
        "dropped": dropped,
        "median_m": float(np.median(everything)),
        "p95_m": float(np.percentile(everything, 95)),
        "seconds": float(np.median(seconds)) if seconds else None,
    }


def cloud(
    rng: np.random.Generator, arc: np.ndarray, curve: np.ndarray, radius: float
) -> np.ndarray:
    """Return points (N, 3) [m] on the visible side of a rope, a table behind it, and outliers."""
    at = rng.integers(0, len(arc), CLOUD_POINTS)
    tangent = np.gradient(curve, axis=0)[at]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    sight = -curve[at] / np.linalg.norm(curve[at], axis=1, keepdims=True)
    front = sight - (sight * tangent).sum(1, keepdims=True) * tangent
    front /= np.linalg.norm(front, axis=1, keepdims=True)
    across = rng.uniform(-0.95, 0.95, CLOUD_POINTS)[:, None]  # evenly over the width, as seen
    out = np.sqrt(1 - across**2) * front + across * np.cross(tangent, front)
    rope = curve[at] + radius * out + 0.001 * rng.standard_normal((CLOUD_POINTS, 3))
    stray = rng.random(CLOUD_POINTS) < OUTLIERS
    rope[stray] += 0.05 * rng.standard_normal((int(stray.sum()), 3))
    table = np.column_stack(
        [
            rng.uniform(-0.8, 0.8, TABLE_POINTS),
            rng.uniform(-0.5, 0.5, TABLE_POINTS),
            DISTANCE + 0.32 + 0.002 * rng.standard_normal(TABLE_POINTS),
        ]
    )
    return rng.permutation(np.concatenate([rope, table]))


def tables(data: dict[str, Any]) -> str:
    """Return the table in Markdown."""
    lines = [
        f"Written by `python -m benchmarks.perception`; ropes of {LENGTH:g} m. Rendered RGB-D, "
        f"{data['frames']} frames",
        "of 1280 x 720 a rope: a fifth of it hidden, clutter, shadows, Azure-Kinect-like noise in",
        "whole millimetres, flying pixels; in every other frame the rope crosses itself. Clouds:",
        "one-sided, with 5 % outliers (5 cm), a table plane behind, 1 mm noise. Time: processor",
        "time of a frame, after the rope's appearance is learned.",
        "",
        "| rope | diameter [mm] | frames used | median [mm] | 95 % [mm] | hidden found "
        "| visible marked hidden | flips | crossings resolved | time [ms] "
        "| clouds used | median [mm] | 95 % [mm] | time [ms] |",
        "|---" * 14 + "|",
    ]
    for row, cloud in zip(data["rgbd"], data["clouds"], strict=True):
        lines.append(
            f"| {row['name']} | {row['diameter_m'] * 1e3:g} | {_used(row)} "
            f"| {row['median_m'] * 1e3:.2f} | {row['p95_m'] * 1e3:.2f} "
            f"| {row['unseen_recall']:.3f} | {row['seen_marked_unseen']:.3f} | {row['flips']} "
            f"| {row['resolved']}/{row['crossings']} | {1e3 * (row['seconds'] or np.nan):.0f} "
            f"| {_used(cloud)} | {cloud['median_m'] * 1e3:.2f} | {cloud['p95_m'] * 1e3:.2f} "
            f"| {1e3 * (cloud['seconds'] or np.nan):.0f} |"
        )
    reasons = [
        f"{row['name']}, {reason}"
        for row in [*data["rgbd"], *data["clouds"]]
        for reason in row["dropped"]
    ]
    if reasons:
        lines += ["", "Dropped: " + "; ".join(reasons) + "."]
    return "\n".join(lines) + "\n"


def _used(row: dict[str, Any]) -> str:
    """Return how many frames were used, of how many."""
    return f"{row['used']}/{row['used'] + len(row['dropped'])}"


def main() -> None:
    """Print the tables; write them where asked."""
    arguments = parser(__doc__)
    arguments.add_argument("--frames", type=int, default=10, help="rendered frames of each rope")
    options = arguments.parse_args()
    data = measure(options.frames)
    publish(options, "perception", tables(data), data)


if __name__ == "__main__":
    main()
