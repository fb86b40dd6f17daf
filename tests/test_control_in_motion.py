"""control with what was found: after a diagnosis in motion, and after the paper's model."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from ropefit.artifacts import Control, read
from ropefit.models.equilibrium_rope import EquilibriumRope
from ropefit.models.gripped_rope import GrippedRope, gripped
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.quaternion import director, from_rotation_vector, multiply
from ropefit.rod.rod import uniform
from ropefit.rod.setup import bare
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle
from tests.moving_ropes import DOWN
from tests.shaken_ropes import (
    FINE,
    LENGTH,
    MARKERS,
    OTHER_END,
    fine_rope,
    level_clamps,
    posed,
    shaken,
)

WEIGHT = 0.012
GRIPPER = np.array([0.12, -0.08, 0.06])  # where no frame has it


def target_shape(folder: Path) -> Path:
    """Write points of the true rope at rest, with its end 0 at GRIPPER, level as recorded."""
    ends = np.stack([GRIPPER, OTHER_END])[None]
    found = settle(fine_rope(WEIGHT).rod, Conditions(ends, level_clamps()[None]))
    assert found.converged.all()
    every = FINE // (MARKERS - 1)
    arc = np.linspace(0, LENGTH, FINE + 1)[every:-every:every]
    rows = [
        ",".join(f"{v:.9g}" for v in (*x, s))
        for x, s in zip(found.x[0, every:-every:every], arc, strict=True)
    ]
    path = folder / "target.csv"
    path.write_text("x,y,z,arc_length\n" + "\n".join(rows) + "\n")
    return path


def test_control_moves_the_rope_that_was_found_in_motion(ropefit, tmp_path):
    """A weight that the diagnosis names is on the rope that control moves: without it the gripper
    would go elsewhere."""
    ropefit("preprocess", shaken(tmp_path / "shaken", WEIGHT), "--run", "run")
    ropefit("identify", "--solver", "dynamics", "--run", "run")
    shutil.copytree(tmp_path / "run", tmp_path / "nominal")
    named = ropefit.json("diagnose", "--run", "run")
    assert [effect["name"] for effect in named["effects"]] == ["point_mass"]
    target, off = target_shape(tmp_path), {}
    for run in ("run", "nominal"):
        ropefit("control", "--run", run, "--target", target)
        c, _ = read(tmp_path / run / Control.file_name, Control)
        assert c.converged.all()
        off[run] = np.linalg.norm(c.position[0] - GRIPPER)
        if run == "run":
            assert np.nanmax(c.key_deviation) < 4e-3
    assert off["run"] < 6e-3
    assert off["nominal"] > 3 * off["run"]
    # In the frames of the recording the rope swings: its inertia acts as it was seen to move (at
    # rest it would be 65 mm off).
    said = ropefit("control", "--run", "run")
    assert "point_mass" in said.stdout + said.stderr
    c, _ = read(tmp_path / "run" / Control.file_name, Control)
    assert c.solver == "equilibrium"
    assert np.median(c.deviation[c.converged]) < 0.015
    assert "Traceback" not in ropefit("report", "--run", "run").stderr
    # `run` does the same: everything but control is up to date.
    motion = ["run", tmp_path / "shaken", "--run", "run", "--solver", "dynamics"]
    refused = ropefit(*motion, "--target", tmp_path / "none.csv", code=3)
    assert "none.csv" in refused.stderr
    assert "control" in ropefit.json(*motion, "--target", target)
    c, _ = read(tmp_path / "run" / Control.file_name, Control)
    assert c.kind == "shape"
    assert np.linalg.norm(c.position[0] - GRIPPER) < 6e-3


def test_after_the_papers_model_control_moves_the_rope_that_was_found(ropefit, tmp_path):
    """Beside the weights a rope in equilibrium is diagnosed: that rope, with the weight, is moved;
    by the weights alone the gripper would go elsewhere."""
    ropefit("preprocess", posed(tmp_path / "posed", WEIGHT), "--run", "run")
    fast = ["--solver", "thomas", "--steps", "20", "--iterations", "10", "--evaluations", "12"]
    ropefit("identify", *fast, "--run", "run")
    shutil.copytree(tmp_path / "run", tmp_path / "weights")
    named = ropefit.json("diagnose", "--run", "run")
    assert [effect["name"] for effect in named["effects"]] == ["point_mass"]
    target, off, solver = target_shape(tmp_path), {}, {}
    for run in ("run", "weights"):
        ropefit("control", "--run", run, "--target", target)
        c, _ = read(tmp_path / run / Control.file_name, Control)
        off[run], solver[run] = np.linalg.norm(c.position[0] - GRIPPER), c.solver
    assert solver == {"run": "equilibrium", "weights": "thomas"}
    assert off["run"] < 6e-3
    assert off["weights"] > 3 * off["run"]


def held_rope(first: float, last: float) -> GrippedRope:
    """A clamped rope of 1 m, held straight up to `first` and from `last` on."""
    p = uniform(length=last - first, segments=48, bend=2e-3, density=0.08)
    tilt = [quaternion_along(np.array(v)) for v in ((1.0, 0.2, -1), (1.0, 0, 1))]
    clamp = np.stack(tilt)[None]
    tangent = director(clamp)
    outer = np.stack([first * tangent[0, 0], -(1 - last) * tangent[0, 1]])[None]
    ends = np.array([[[0.0, 0, 0], [0.6, 0.1, 0.1]]]) + outer
    setup = bare(p, DOWN, ends, clamp, np.array([0.0, -2, 0]))
    inner = EquilibriumRope(setup, 1, 0, recorded=ends)
    arc, nodes = np.linspace(0, 1, 21), np.linspace(first, last, 49)
    return GrippedRope(inner, outer, gripped(nodes, arc), np.arange(1, 41, 2))


VALUES = torch.tensor([[2e-3, 2e-3, torch.inf, 1.0]], dtype=torch.float64)


def test_a_grip_holds_the_rope_straight_and_turns_with_it():
    first, last = 0.07, 0.96
    rope = held_rope(first, last)
    values = VALUES.clone()
    values[:, 3] = last - first
    turn = torch.tensor([[0.3, -0.2, 0.5]], dtype=torch.float64)
    frame = multiply(from_rotation_vector(turn), rope.start.q[:, 0])
    move = torch.tensor([[0.05, 0.02, -0.03]], dtype=torch.float64)
    for turned in (None, frame):
        x = rope.settle(values, move=move, frame=turned).x[0]
        tangent = director(rope.start.q[:, 0] if turned is None else turned)[0]
        assert torch.allclose(x[0], rope.start.x[0, 0] + move[0], atol=1e-12)
        assert torch.allclose(x[1], x[0] + 0.05 * tangent, atol=1e-12)
        assert torch.allclose(x[-1], torch.tensor([0.6, 0.1, 0.1]).double(), atol=1e-12)
        length = torch.linalg.norm(x.diff(dim=0), dim=-1).sum()
        assert 0.99 < length < 1.0  # chords of a bent rope
    finest = rope.finest.settle(values, move=move).x[0]
    assert finest.shape == (51, 3)
    assert float(torch.linalg.norm(finest.diff(dim=0), dim=-1).sum()) == pytest.approx(1, abs=1e-9)


def test_derivatives_reach_through_a_grip_that_turns():
    rope, values = held_rope(0.07, 0.96), VALUES.clone()
    values[:, 3] = 0.89
    at = torch.zeros(6, dtype=torch.float64, requires_grad=True)
    weights = torch.randn(21, 3, generator=torch.Generator().manual_seed(1)).double()

    def total(u):
        frame = multiply(from_rotation_vector(u[None, 3:]), rope.start.q[:, 0])
        return (weights * rope.settle(values, move=u[None, :3], frame=frame).x[0]).sum()

    (slope,) = torch.autograd.grad(total(at), at)
    for k in range(6):
        step = 1e-5 * torch.eye(6, dtype=torch.float64)[k]
        with torch.no_grad():
            expected = (total(at + step) - total(at - step)) / 2e-5
        assert float(slope[k]) == pytest.approx(float(expected), rel=1e-4, abs=1e-4)
