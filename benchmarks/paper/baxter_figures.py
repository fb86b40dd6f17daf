"""Figures of the inextensible rope."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.paper.drawing import (
    DATA,
    FITTED,
    START,
    TRUE,
    curve,
    front,
    panels,
    plt,
    points,
    save,
)
from benchmarks.paper.results import MEANING, Results, cloud, lengths, states


def extremes(r: Results) -> tuple[int, int]:
    """Return rows of the most bent and the most tensioned frame."""
    return states(r.observations("thomas"))


def projection(r: Results) -> Path:
    o = r.observations("thomas")
    row = extremes(r)[0]
    figure, axes = panels(2)
    for axis, up, title in zip(axes, (2, 1), ("front", "top"), strict=True):
        points(axis, cloud(o, row, projected=False), DATA, "measured", up, 3)
        points(axis, cloud(o, row), FITTED, "projected", up, 3)
        axis.set(title=title, xlabel="x [mm]", ylabel="zy"[2 - up] + " [mm]")
    axes[0].legend(frameon=False, markerscale=3)
    return save(figure, r.figures, "projection")


def thomas_fit(r: Results) -> Path:
    o, m = r.observations("thomas"), r.model("thomas")
    figure, axes = panels(2)
    for axis, row, title in zip(axes, extremes(r), ("bending", "tensioned"), strict=True):
        points(axis, cloud(o, row), DATA, "points")
        curve(axis, m.x_initial[row], START, "before", marker=".", markersize=3)
        curve(axis, m.x[row], FITTED, "after", marker=".", markersize=3)
        front(axis, title)
    axes[0].legend(frameon=False)
    return save(figure, r.figures, "thomas")


def jacobi_states(r: Results) -> Path:
    frames, two = r.observations("jacobi-100").frames, r.model("jacobi-100")
    figure, axes = panels(1, 5.0)
    for rms, color, label in (
        (two.rms_initial, START, "the paper's 0.26"),
        (r.model("jacobi-one").rms, DATA, "one weight"),
        (two.rms, FITTED, "a weight for each state"),
    ):
        axes[0].plot(frames, 1e3 * rms, color=color, label=label)
    axes[0].set(xlabel="frame", ylabel="rms [mm]", ylim=(0, None))
    axes[0].legend(frameon=False, fontsize=8)
    return save(figure, r.figures, "jacobi")


def losses(r: Results) -> Path:
    o, names = r.observations("thomas"), list(MEANING)
    row = len(o.frames) // 4
    figure, axes = plt.subplots(2, 5, figsize=(12, 4.6))
    cells = list(axes.flat)
    for axis, name in zip(cells, names, strict=False):
        points(axis, cloud(o, row), DATA, "points", up=1)
        x = r.control("thomas", name).x[row]
        axis.plot(1e3 * x[:, 0], 1e3 * x[:, 1], color=FITTED, linewidth=1)
        axis.set(title=name, ylim=(-80, 80))
    sums = [float(np.mean(r.control("thomas", name).obj1)) for name in names]
    cells[-1].bar([name[3:] for name in names], sums, color=START)
    cells[-1].set(title="OBJ1 [m] by loss", yscale="log")
    return save(figure, r.figures, "losses")


def solvers(r: Results) -> Path:
    truth = r.truth("baxter")["gripper"]
    figure, axes = panels(2, 4.2)
    runs = {"thomas": ("Thomas", FITTED), "jacobi": ("Jacobi, fitted", DATA),
            "jacobi-one": ("Jacobi, paper's weights", START)}  # fmt: skip
    for run, (label, color) in runs.items():
        c = r.control(run, "OBJ1")
        error = np.linalg.norm(c.position - truth[c.cases], axis=1)
        axes[0].plot(c.cases, 1e3 * error, color=color, label=label)
        axes[1].plot(c.cases, lengths(c.x), color=color, label=label)
    axes[0].set(xlabel="frame", ylabel="control point off [mm]")
    axes[1].set(xlabel="frame", ylabel="length [m]")
    axes[1].axhline(r.observations("thomas").length, color=TRUE, linewidth=0.8, label="true")
    axes[1].legend(frameon=False, fontsize=8)
    return save(figure, r.figures, "solvers")


def distance(r: Results) -> Path:
    figure, axes = panels(3)
    runs = {"thomas": ("Thomas", FITTED), "jacobi-one": ("Jacobi", DATA)}
    for run, (label, color) in runs.items():
        m, rest = r.model(run), r.observations(run).length
        assert m.iterated is not None
        for row, style, state in zip(extremes(r), ("-", "--"), ("bent", "tensioned"), strict=True):
            how = {"color": color, "linestyle": style, "label": f"{label}, {state}"}
            i = m.iterated
            axes[0].plot(i.iteration, 1e3 * i.distance_violation[row], **how)
            axes[1].plot(i.iteration, rest * (1 + i.length_error[row]), **how)
            edges = np.linalg.norm(np.diff(m.x[row], axis=0), axis=1)
            axes[2].plot(1e3 * np.abs(edges - rest / len(edges)), **how)
    axes[0].set(xlabel="iteration", ylabel="largest ‖C^D‖ [mm]", yscale="log", xscale="log")
    axes[1].set(xlabel="iteration", ylabel="length [m]", xscale="log")
    axes[2].set(xlabel="pair", ylabel="‖C^D‖ at the end [mm]", yscale="log")
    axes[1].legend(frameon=False, fontsize=7)
    return save(figure, r.figures, "distance")


def flattened(r: Results) -> Path:
    o = r.observations("sideways")
    row = int(np.argmax([np.abs(o.point_offset[a:b]).max() for a, b in
                         zip(o.point_start[:-1], o.point_start[1:], strict=True)]))  # fmt: skip
    figure, axes = panels(1, 5.0)
    points(axes[0], cloud(o, row, projected=False), DATA, "measured", 1, 4)
    points(axes[0], cloud(o, row), FITTED, "projected", 1, 4)
    axes[0].set(xlabel="x [mm]", ylabel="y [mm]")
    axes[0].legend(frameon=False, markerscale=3)
    return save(figure, r.figures, "flattened")
