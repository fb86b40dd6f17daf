"""diagnose through real processes on a sample: the artifact, the fixed JSON, report and export."""

import json

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
