"""The command line as a person uses it: real processes, real recordings, the fixed contracts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, SAMPLES

SMALL = (
    "--solver",
    "thomas",
    "--steps",
    "10",
    "--iterations",
    "10",
    "--evaluations",
    "8",
    "--free",
    "eta_x_G,eta_q_B",
)


def test_help_answers_at_once():
    """At most 0.3 s of processor time, best of five: torch and open3d are imported inside the
    commands."""
    times = []
    for _ in range(5):
        start = os.times()
        subprocess.run([sys.executable, "-m", "ropefit", "--help"], check=True, capture_output=True)
        end = os.times()
        spent = end.children_user + end.children_system
        times.append(spent - start.children_user - start.children_system)
    assert min(times) < 0.3


@pytest.mark.parametrize("command", ["run", "preprocess", "identify", "control", "report"])
def test_every_command_has_its_fixed_options(ropefit, command):
    text = ropefit(command, "--help").stdout
    for option in ("--run", "--json"):
        assert option in text
    if command in ("identify", "run"):
        for option in ("--solver", "--loss", "--search", "thomas", "OBJ9", "grid"):
            assert option in text


def test_stages_one_by_one_on_the_cloud_sample(ropefit, tmp_path):
    """The user's commands, in order; then nothing is computed twice; then a change is noticed."""
    first = ropefit.json("preprocess", SAMPLES / "cloud")
    assert (first["frames"], first["dropped"]) == (36, [])
    assert 0.0005 < first["noise_m"] < 0.003
    found = ropefit.json("identify", "--loss", "OBJ1", *SMALL)
    assert found["rms_heldout_m"] < 0.02
    assert set(found["groups"]["group_0"]["parameters"]) >= {"eta_x_G", "eta_SOR"}
    control = ropefit.json("control", "--loss", "OBJ4", "--key", "0.5", "--evaluations", "20")
    assert len(control["deviation_m"]) == 36
    assert len(control["key_deviation_m"][0]) == 1
    report = ropefit.json("report")
    page = Path(tmp_path / report["report"]).read_text()
    assert "sample-cloud" in page
    assert len(page) < 12e6

    again = ropefit.json("identify", "--loss", "OBJ1", *SMALL)
    assert not again["computed"]
    ropefit("preprocess", SAMPLES / "cloud", "--nodes", "16")
    stale = ropefit("control", "--loss", "OBJ1", code=1).stderr
    assert "stale" in stale
    assert "ropefit identify" in stale
    listing = json.loads(ropefit("inspect", "run", "--json", code=1).stdout)
    valid = {item["file"]: item["valid"] for item in listing["artifacts"]}
    assert valid == {"observations.h5": True, "model.h5": False, "control.h5": False}


def test_run_uses_the_packaged_sample_and_says_so(ropefit):
    result = ropefit("preprocess", "--run", "somewhere")
    assert "packaged sample" in result.stderr
    assert "Traceback" not in result.stderr


def test_json_is_one_object_and_quiet_says_nothing(ropefit):
    loud = ropefit("preprocess", SAMPLES / "markers", "--json")
    assert json.loads(loud.stdout)["stage"] == "preprocess"
    assert "observations.h5" in loud.stderr
    quiet = ropefit("preprocess", SAMPLES / "markers", "--quiet")
    assert quiet.stdout == quiet.stderr == ""


def test_simulate_then_run(ropefit, tmp_path):
    (tmp_path / "spec.toml").write_text(
        'format = "ropefit-simulation/1"\nname = "s"\n[rope]\nlength = 0.5\nnodes = 10\n'
        "[motion]\nframes = 3\nend0 = { path = [[0.2, 0, 0], [0.4, 0, 0]] }\n"
        "end1 = { path = [[0, 0, 0]] }\n[sensor]\npoints = 400\noccluded = [[0.0, 0.12]]\n"
    )
    made = ropefit.json("simulate", "spec.toml", "--out", "rec")
    assert made["frames"] == 3
    found = ropefit.json("preprocess", "rec", "--nodes", "10")
    assert found["frames"] == 3
    assert found["visibility"] < 1
    refused = ropefit("simulate", "spec.toml", "--out", "rec", code=1)
    assert "exists already" in refused.stderr


@pytest.mark.parametrize("name", ["cable_black_unweighted", "wire_black", "mocap_dlo1/eval_054"])
def test_real_recordings_go_through_without_special_cases(ropefit, real, name):
    """preprocess, identify, control, report; small searches, since the fit is not the point."""
    found = ropefit.json("preprocess", real / name, "--nodes", "14")
    assert found["dropped"] == []
    fitted = ropefit.json("identify", *SMALL, "--most-frames", "20")
    assert fitted["rms_fit_m"] > 1e-4
    assert not fitted["solver_converged"]
    control = ropefit.json("control", "--evaluations", "10")
    assert len(control["converged"]) == found["frames"]
    report = ropefit.json("report")
    assert Path(ropefit.directory / report["report"]).stat().st_size > 3e4


@pytest.mark.parametrize(
    ("identify", "diagnosed"),
    [("", 1), ("--free EI,rest_curve", 1), ("--solver thomas", 0), ("--search=grid", 0)],
)
def test_make_batch_diagnoses_what_can_be(tmp_path, identify, diagnosed):
    """As `ropefit run` does: not the paper's weights, nor what a loss was fitted to."""
    (tmp_path / "a").mkdir()
    done = subprocess.run(
        ["make", "--dry-run", "--old-file", ".venv/.installed", "batch",
         f"RECORDINGS={tmp_path / 'a'}", f"RUNS={tmp_path / 'out'}", f"IDENTIFY={identify}"],
        cwd=ROOT, capture_output=True, text=True, check=True,
        env={k: v for k, v in os.environ.items() if not k.startswith("MAKE")},
    )  # fmt: skip
    called = [line.split()[1] for line in done.stdout.splitlines() if "ropefit " in line]
    stages = ["preprocess", "identify", *["diagnose"] * diagnosed, "control", "report"]
    assert called == stages


@pytest.mark.skipif(not (ROOT / ".venv/bin/ropefit").exists(), reason="needs `make install`")
def test_make_batch_redoes_only_what_changed(tmp_path):
    """Two recordings side by side; a second make does nothing; a changed file redoes its own."""
    text = (
        'format = "ropefit-simulation/1"\nname = "{name}"\n[rope]\nlength = 0.5\nnodes = 10\n'
        "[motion]\nframes = 3\nend0 = {{ path = [[0.2, 0, 0], [0.4, 0, 0]] }}\n"
        'end1 = {{ path = [[0, 0, 0]] }}\n[sensor]\nkind = "markers"\npoints = 8\n'
    )
    for name in ("a", "b"):
        (tmp_path / f"{name}.toml").write_text(text.format(name=name))
        subprocess.run(
            [sys.executable, "-m", "ropefit", "simulate", f"{name}.toml", "--out", name],
            cwd=tmp_path,
            check=True,
            capture_output=True,
        )
    out = tmp_path / "out"

    def make(*names: str, code: int = 0) -> str:
        recordings = " ".join(str(tmp_path / name) for name in names)
        result = subprocess.run(
            [
                "make",
                "-j2",
                "batch",
                f"RECORDINGS={recordings}",
                f"RUNS={out}",
                "PREPROCESS=--nodes 10",
                f"IDENTIFY={' '.join(SMALL)}",
                "CONTROL=--evaluations 5",
            ],
            cwd=ROOT,
            capture_output=True,
            text=True,
            env={k: v for k, v in os.environ.items() if not k.startswith("MAKE")},
        )
        assert (result.returncode == 0) == (code == 0), result.stderr
        return result.stdout + result.stderr

    make("a", "b")
    times = {path: path.stat().st_mtime_ns for path in out.glob("*/*")}
    names = ["control.h5", "model.h5", "observations.h5", "report.html"]
    assert sorted({path.name for path in times}) == names
    assert len(times) == 8
    assert "preprocess" not in make("a", "b")
    assert {path: path.stat().st_mtime_ns for path in out.glob("*/*")} == times
    markers = tmp_path / "a" / "markers.csv"
    markers.write_text(markers.read_text().replace("0.2", "0.2001", 1))
    log = make("a", "b")
    assert str(tmp_path / "a") in log
    for path, was in times.items():
        assert (path.stat().st_mtime_ns > was) == (path.parent.name == "a"), path
    assert "usage" in make(code=2)
    assert "same folder name" in make("a", "a", code=2)
