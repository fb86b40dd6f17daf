"""`ropefit warm-up` compiles every loop for exactly the types that real work has."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from ropefit.inference.bins import Data, match
from ropefit.rod.rod import build, uniform
from ropefit.solvers.dynamics.derivatives import Directions as MotionDirections
from ropefit.solvers.dynamics.derivatives import tangent as motion_tangent
from ropefit.solvers.dynamics.differentiable import simulate
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.differentiable import settle
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.stability import stability
from ropefit.solvers.equilibrium.start import hanging_shape
from ropefit.stages.warm_up import calls, shares
from tests import test_compiled
from tests.conftest import ROOT
from tests.moving_ropes import DOWN, hung, in_plane, rope
from tests.rods import NOT_HELD
from tests.tensors import tensors


def compiled_folder() -> Path:
    return Path(calls()["solve_ropes"][0].stats.cache_path)


def test_every_compiled_loop_is_listed() -> None:
    """No entry point is kept on disk without its line in warm_up.py, but those for accelerators."""
    marked = 0
    for path in (ROOT / "ropefit").rglob("*.py"):
        text = path.read_text()
        if path.parent.name != "batched":
            marked += len(re.findall(r"^ *@(?:exact_)?kernel$", text, re.MULTILINE))
        if path.name != "jit.py":
            assert "njit" not in text, f"{path.name} compiles past solvers/kernels/jit.py"
    assert marked == len(calls())


def test_every_loop_is_compiled_by_one_process() -> None:
    for processors in range(1, 7):
        taken = [name for groups in shares(processors) for names in groups for name in names]
        assert sorted(taken) == sorted(calls())


def test_real_work_compiles_nothing_more() -> None:
    """Each loop has one signature, which real work meets. In a process of its own: where other
    tests have called the loops before, a second signature is nothing new."""
    check = "from tests.test_warm_up import check_real_work; check_real_work()"
    subprocess.run([sys.executable, "-c", check], cwd=ROOT, check=True)


def check_real_work() -> None:
    """Call every loop as `warm-up` does, then as real work does."""
    loops = {name: loop for name, (loop, _) in calls().items()}
    for loop, arguments in calls().values():
        loop(*arguments)
    before = {name: set(loop.signatures) for name, loop in loops.items()}
    calls_of_real_work()
    for name, loop in loops.items():
        assert set(loop.signatures) == before[name], name


def calls_of_real_work() -> None:
    """Call every loop as fits do."""
    rod = build(uniform(length=1.0, segments=4, bend=1e-3, density=0.05), DOWN, (False, False))
    ends = np.array([[[0.0, 0.0, 0.0], [0.7, 0.0, 0.0]]])
    hanging_shape(1.0, 5, DOWN, ends[0], np.full((2, 3), np.nan))
    leaves, conditions = tensors((rod, Conditions(ends, NOT_HELD)))
    leaves.stiffness.requires_grad_()
    state, solution = settle(leaves, conditions)
    state.x.sum().backward()
    tangent(solution, Directions(load=np.ones((1, 2, 5, 3))))
    stability(solution)
    moving = rope(uniform(length=1.0, segments=4, bend=1e-3, density=0.05))
    down = np.stack([np.zeros(5), np.zeros(5), -np.linspace(0, 1, 5)], axis=1)
    moving, drive, start = tensors((moving, hung(np.arange(4) * 0.01), in_plane(down)))
    moving.mass.requires_grad_()
    x, _, trajectory = simulate(moving, drive, start)
    x.sum().backward()
    motion_tangent(trajectory, MotionDirections(v0=np.ones((1, 1, 5, 3))))
    test_compiled.hanging().gradients(test_compiled.simulate_compiled)
    cloud = np.repeat(state.x.detach().numpy(), 4, axis=1)
    share, mask = np.linspace(0, 1, 20)[None], np.ones((1, 20), bool)
    match(Data(cloud, share, mask, False, np.array([0.0, -3.0, 0.0])), solution.x, 4)


def test_the_command_compiles_once(tmp_path: Path) -> None:
    """In processes of their own, and then the first run finds all compiled."""
    for loop, arguments in calls().values():
        loop(*arguments)
    kept = set(compiled_folder().glob("*.nbc"))
    command = [sys.executable, "-m", "ropefit", "warm-up", "--json"]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["loops"] == len(calls())
    assert told["compiled"] == 0
    assert Path(told["folder"]).is_dir()
    assert "already compiled" in done.stderr
    assert set(compiled_folder().glob("*.nbc")) == kept
