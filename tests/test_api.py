"""`import ropefit`: lazy, typed, in step with the command line, differentiable; examples run."""

from __future__ import annotations

import doctest
import importlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import ropefit
from ropefit.errors import NotConverged, WrongUsage
from tests.conftest import ROOT, SAMPLES

ENDS = torch.tensor(
    [[[0.0, 0.0, 0.0], [0.6, 0.0, 0.1]], [[0.0, 0.0, 0.0], [0.3, 0.2, 0.0]]], dtype=torch.float64
)


def python(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )


def test_importing_is_light_and_complete(tmp_path):
    told = python(
        "-c",
        "import ropefit, sys\n"
        "assert not {'numpy', 'torch', 'open3d', 'numba'} & set(sys.modules)\n"
        "for name in ropefit.__all__: getattr(ropefit, name)\n"
        "assert set(dir(ropefit)) == set(ropefit.__all__)\n"
        "try: ropefit.nothing\n"
        "except AttributeError as error: print(error)",
        cwd=tmp_path,
    )
    assert told.stdout == "module 'ropefit' has no attribute 'nothing'\n", told.stderr
    assert (ROOT / "ropefit" / "py.typed").exists()


def modules_with_examples() -> list[str]:
    found = [
        path.relative_to(ROOT).with_suffix("")
        for path in sorted((ROOT / "ropefit").rglob("*.py"))
        if ">>> " in path.read_text()
    ]
    return [".".join(path.parts).removesuffix(".__init__") for path in found]


@pytest.mark.parametrize("name", modules_with_examples())
def test_docstring_examples(name):
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0
    assert result.failed == 0


def test_the_command_line_goes_on_with_what_python_made(ropefit, tmp_path):
    import ropefit as api

    seen = api.preprocess(SAMPLES / "markers", nodes=12)
    model = api.fit(seen, most_frames=8, evaluations=10)
    api.save(tmp_path / "run", seen, model)
    again = ropefit.json("preprocess", SAMPLES / "markers", "--nodes", "12")
    assert not again["computed"]
    same = ropefit.json("identify", "--most-frames", "8", "--evaluations", "10")
    assert not same["computed"]
    back = api.open_run(tmp_path / "run")
    assert back.model is not None
    np.testing.assert_array_equal(back.model.nominal.x, model.nominal.x)
    assert back.diagnosis is None
    assert "<h2>Parameters</h2>" in api.report(seen, model)
    rope = api.Rope.of(seen, model)
    x = rope(torch.tensor(seen.end_position), torch.tensor(seen.end_orientation)).numpy()
    every = (x.shape[1] - 1) // (len(seen.node_arc) - 1)
    # The fit moves the ends by millimetres (calibration); the shape is the same rope's.
    assert np.abs(x[:, ::every] - model.nominal.x).max() < 0.02 * seen.length
    with pytest.raises(WrongUsage, match="expected finite numbers"):
        api.control(seen, model, targets=np.zeros((2, 2)))


def test_gradients_of_the_rope_against_finite_differences():
    def shape(EI, mass, ends, clamp, curvature, gravity):
        clamps = torch.full((2, 2, 4), torch.nan, dtype=torch.float64)
        clamps = torch.cat([clamp[:, None], clamps[:, 1:]], dim=1)
        rope = ropefit.Rope(
            1.0, mass, EI, EA=50.0, curvature=curvature, gravity=gravity, segments=6
        )
        return rope(ends, clamps)

    def tensor(values):
        return torch.tensor(values, dtype=torch.float64, requires_grad=True)

    inputs = (
        tensor([2e-4, 2e-4, 2e-4, 8e-4, 8e-4, 8e-4]),
        tensor([[0.05], [0.03]]),
        ENDS.clone().requires_grad_(),
        torch.tensor([[0.5, 0.5, 0.5, 0.5], [1.0, 0, 0, 0]], dtype=torch.float64),
        tensor([0.3, 0.1, 0.0]),
        tensor([0.0, 0.0, -9.81]),
    )
    assert torch.autograd.gradcheck(shape, inputs, eps=1e-7, atol=1e-4, rtol=1e-3)


def test_a_rope_that_cannot_hang_is_an_error_or_nan():
    rope = ropefit.Rope(length=0.5, mass=0.05, EI=1e-4, segments=8)
    with pytest.raises(NotConverged, match=r"frame 0 \(1 of 2 fail\)"):
        rope(ENDS)
    x = rope(ENDS, throw=False)
    assert torch.isnan(x[0]).all()
    assert torch.isfinite(x[1]).all()
    for wrong in (ENDS[0], ENDS * torch.nan):
        with pytest.raises(WrongUsage, match="ends"):
            rope(wrong)
    with pytest.raises(WrongUsage, match="do not spread"):
        ropefit.Rope(0.5, 0.05, torch.ones(7, dtype=torch.float64), segments=8)(ENDS)


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.stem)
def test_examples_run(path, tmp_path):
    done = python(path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout
