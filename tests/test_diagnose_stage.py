"""diagnose through real processes on a sample: the artifact, the fixed JSON, report and export."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from ropefit.adapters.diagnosis_content import sizes_of
from ropefit.effects import ContactFriction
from ropefit.inference.noise import Noise
from ropefit.stages.diagnose import with_what_is_missed
from tests.conftest import ROOT


def test_diagnose_report_and_export_of_the_sample(ropefit, tmp_path):
    run = tmp_path / "run"
    for arguments in (
        ["preprocess", str(ROOT / "sample_data" / "cloud")],
        ["identify"],
    ):
        done = ropefit(*arguments, "--run", str(run), "--quiet")
        assert done.returncode == 0, done.stderr
    done = ropefit("diagnose", "--run", str(run), "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["verdict"] == "none"
    assert told["effects"] == []
    assert told["heldout"]["rms_after_m"] < 1.1 * told["heldout"]["noise_m"]
    assert 0 < told["detectable"]["point_mass"]["value"] < 0.005
    assert {"mismatch", "next_motion"} <= set(told)
    again = json.loads(ropefit("diagnose", "--run", str(run), "--json").stdout)
    assert not again["computed"]
    done = ropefit("report", "--run", str(run))
    assert done.returncode == 0, done.stderr
    assert "What was left out" in (run / "report.html").read_text()
    out = tmp_path / "rope.xml"
    to = ["export", "--run", str(run), "--to", "mujoco", "--out", str(out)]
    done = ropefit(*to, "--check", "--json")
    assert done.returncode == 0, done.stderr
    assert "<mujoco" in out.read_text()
    checked = json.loads(done.stdout)["check"]
    assert checked["simulator"].startswith("mujoco 4")
    assert checked["settled"] == [True] * 6
    assert 0 < checked["largest_deviation"] < 0.01
    assert "none runs it" in ropefit(*to[:3], "--to", "json", *to[5:], "--check", code=2).stderr
    wrong = ropefit(*to, "--check", "--python", "/bin/false", code=1).stderr
    assert "has no mujoco for mujoco; pip install" in wrong
    assert ropefit("inspect", str(run / "exports.h5")).returncode == 0
    ropefit("report", "--run", str(run))
    assert "At rest in mujoco 4" in (run / "report.html").read_text()
    done = ropefit("identify", "--run", str(run), "--solver", "thomas", "--steps", "5", "--quiet")
    assert done.returncode == 0, done.stderr
    (run / "diagnosis.h5").unlink()
    again = ropefit("report", "--run", str(run))  # the export was of the rope before
    assert "exports.h5 is of an earlier rope" in again.stderr
    assert "At rest in mujoco 4" not in (run / "report.html").read_text()
    refused = ropefit("diagnose", "--run", str(run), code=2)
    assert "equilibrium" in refused.stderr


def test_what_another_runs_rope_misses_is_noise_here():
    def told(source: str, recording: str, rms: float, sd: float = 1e-3) -> float:
        o = SimpleNamespace(source=source, recording=recording)
        run = SimpleNamespace(recording="was", nominal=SimpleNamespace(rms_fit=rms))
        return with_what_is_missed(Noise(marker=sd), run, o).marker  # pyright: ignore[reportArgumentType]

    assert told("markers", "changed", 0.03) == pytest.approx(0.03 / 3**0.5)
    assert told("markers", "changed", 0.001) == 1e-3
    assert told("markers", "was", 0.03) == 1e-3  # its own misfit is what is to be explained
    assert told("cloud", "changed", 0.03) == 1e-3


def test_intervals_end_where_a_quantity_does():
    rival = SimpleNamespace(
        family=SimpleNamespace(effect=ContactFriction()), fit=SimpleNamespace(quantile=2.0)
    )
    sizes = sizes_of(rival, np.array([0.6]), np.array([0.5]))  # pyright: ignore[reportArgumentType]
    low, high = sizes["coefficient"].ci95
    assert low == 0.0
    assert 1.6 < high < 1.7
