"""identify --solver dynamics: a simulated rope's parameters come back, through the command line."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import torch

from ropefit.adapters.motion_setup import FINER_SEGMENTS, SEGMENTS
from ropefit.artifacts import Diagnosis, Model, Observations, read
from ropefit.fitting.motion import diagnosed_motion, restored_motion
from ropefit.inference.bins import match
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.rod import uniform
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle
from tests.moving_ropes import rope, stepped

EI, GJ, LOSS, AIR, MASS, LENGTH = 2e-3, 1.5e-3, 1e-4, 0.03, 0.06, 0.8
FRAMES, MARKERS, STEPS = 160, 9, 4


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Two clips of a clamped rope that is shaken, from a rod four times as fine."""
    folder = tmp_path_factory.mktemp("shaken")
    p = uniform(length=LENGTH, segments=160, bend=EI, twist=GJ, density=MASS / LENGTH)
    moved = rope(p, clamped=(True, True), bend=LOSS, twist=LOSS, air=AIR)
    count = (FRAMES - 1) * STEPS + 1
    time = np.arange(count) * 0.01 / STEPS
    rows, markers, times = [], [], []
    for clip in range(2):
        t = torch.from_numpy(time + 3 * clip)
        grow = torch.from_numpy(np.minimum(time / 0.3, 1) ** 2)[:, None]
        sway = torch.stack([0.1 * torch.sin(6 * t), 0.12 * torch.sin(9 * t), 0.05 * t], -1)
        ends = torch.tensor([[0.0, 0, 0], [0.5, 0.05, 0.1]], dtype=torch.float64).repeat(
            count, 1, 1
        )
        ends[:, 0] += grow * (sway - sway[:1])
        level = torch.from_numpy(
            np.stack([quaternion_along(np.array(v)) for v in ((1.0, 0, -1), (1.0, 0, 1))])
        )
        nod = torch.zeros(count, 2, 3, dtype=torch.float64)
        nod[:, 0, 0] = 0.3 * grow[:, 0] * torch.sin(5 * t)
        clamp = multiply(level.expand(count, 2, 4), from_rotation_vector(nod))
        first = settle(moved.rod, Conditions(ends[:1], clamp[:1]))
        assert first.converged.all()
        start = Start(
            torch.from_numpy(first.x), torch.from_numpy(first.q), torch.zeros(1, 161, 3).double()
        )
        found = stepped(moved, Drive(torch.from_numpy(time)[None], ends[None], clamp[None]), start)
        noise = 2e-5 * np.random.default_rng(clip).normal(size=(FRAMES, MARKERS, 3))
        markers.append(found.x[0][::STEPS, :: 160 // (MARKERS - 1)] + noise)
        times.append(time[::STEPS] + 10 * clip)
        for k in range(FRAMES):
            for end in range(2):
                at = STEPS * k
                pose = [*ends[at, end].tolist(), *clamp[at, end].tolist()]
                told = ",".join(map(repr, pose))
                rows.append(f"{k + FRAMES * clip},{float(times[-1][k])!r},{end},{told}")
    arc = np.linspace(0, LENGTH, MARKERS)
    np.savez(
        folder / "markers.npz", positions=np.concatenate(markers), time=np.concatenate(times),
        arc_length=arc,
    )  # fmt: skip
    (folder / "ends.csv").write_text("frame,time,end,x,y,z,qw,qx,qy,qz\n" + "\n".join(rows) + "\n")
    (folder / "recording.toml").write_text(
        'format = "ropefit-recording/1"\nname = "shaken"\ngravity = [0, 0, -9.81]\n'
        f"[rope]\nlength = {LENGTH}\nmass = {MASS}\n"
        '[ends]\nfile = "ends.csv"\n[markers]\nfile = "markers.npz"\n'
    )
    return folder


def test_parameters_come_back(ropefit, recording, tmp_path):
    ropefit("preprocess", recording, "--run", "run")
    told = ropefit.json("identify", "--solver", "dynamics", "--holdout", 0.5, "--run", "run")
    assert told["solver"] == "dynamics"
    assert told["clips"] == 2
    found = told["groups"]["group_0"]["parameters"]
    for name, truth in {"EI": EI, "bend_damping": LOSS, "air_damping": AIR}.items():
        p = found[name]
        assert p["verdict"] == "determined"
        assert p["value"] == pytest.approx(truth, rel=0.12)
    assert told["rms_heldout_m"] < 2e-3
    model, _ = read(tmp_path / "run" / Model.file_name, Model)
    assert model.nominal.stepped is not None
    assert model.nominal.stepped.segments in (SEGMENTS, FINER_SEGMENTS)
    assert (
        restored_motion(
            read(tmp_path / "run" / Observations.file_name, Observations)[0], model.nominal
        )[1].setup.segments
        == model.nominal.stepped.segments
    )
    report = ropefit("report", "--run", "run")
    assert "Traceback" not in report.stderr


def test_a_motion_is_run_through_and_diagnosed_by_what_another_run_knows(
    ropefit, recording, tmp_path
):
    told = ropefit.json("run", recording, "--solver", "dynamics", "--run", "run")
    assert "control" not in told
    assert told["diagnose"]["verdict"] == "none"
    o, model, found = (
        read(tmp_path / "run" / kind.file_name, kind)[0]
        for kind in (Observations, Model, Diagnosis)
    )
    span, point = diagnosed_motion(o, model.nominal, found)
    gap = match(span.data, point.seen, 1).residual
    assert np.sqrt((gap**2).sum(1).mean()) < 2e-3
    said = ropefit("export", "--run", "run", "--to", "json", "--out", "rope.json")
    assert "air_damping" in said.stdout + said.stderr
    rope = json.loads((tmp_path / "rope.json").read_text())
    assert np.median(rope["EI"]) == pytest.approx(EI, rel=0.12)
    ropefit("preprocess", recording, "--run", "again")
    said = ropefit("diagnose", "--run", "again", "--nominal", "run", "--most-frames", 4)
    assert "identify --solver dynamics" in said.stderr
    assert "none" in said.stdout or "no missing physics" in said.stdout + said.stderr


def test_a_grip_out_of_sight_ends_a_clip(ropefit, recording, tmp_path):
    copy = tmp_path / "hidden"
    shutil.copytree(recording, copy)
    rows = (copy / "ends.csv").read_text().splitlines(keepends=True)
    (copy / "ends.csv").write_text("".join(r for r in rows if not r.startswith(("60,", "61,"))))
    ropefit("preprocess", copy, "--run", "run")
    told = ropefit.json("identify", "--solver", "dynamics", "--holdout", 0.4, "--run", "run")
    assert told["clips"] == 3
    assert told["rms_heldout_m"] < 2e-3
    assert told["groups"]["group_0"]["parameters"]["EI"]["value"] == pytest.approx(EI, rel=0.12)


def test_what_it_cannot_do_is_said(ropefit, recording):
    ropefit("preprocess", recording, "--run", "run")
    wrong = ropefit("identify", "--solver", "dynamics", "--search", "grid", code=2)
    assert "least-squares" in wrong.stderr
    wrong = ropefit("identify", "--solver", "dynamics", "--free", "mass", code=2)
    assert "bend_damping" in wrong.stderr
    ropefit("preprocess", "--run", "cloud")
    assert "markers" in ropefit("identify", "--solver", "dynamics", "--run", "cloud", code=3).stderr
