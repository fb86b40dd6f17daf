"""identify --solver dynamics: a simulated rope's parameters come back, through the command line."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from ropefit.adapters.motion_setup import SEGMENTS
from ropefit.artifacts import Diagnosis, Model, Observations, read
from ropefit.fitting.motion import diagnosed_motion, restored_motion
from ropefit.inference.bins import match
from tests.shaken_ropes import AIR, EI, LOSS, WEIGHT_AT, filmed, shaken


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return shaken(tmp_path_factory.mktemp("shaken"))


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
    assert model.nominal.stepped.segments in SEGMENTS
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


def test_a_simulation_in_motion_lacks_a_weight_and_bends_another_rope(ropefit, tmp_path):
    """The weight is named as missing, the simulation's rigidity and the other one come back."""
    mass, stiffer = 0.012, 2.0
    ropefit("preprocess", shaken(tmp_path / "real", mass), "--run", "run")
    ropefit("preprocess", shaken(tmp_path / "simulated", bend=stiffer * EI), "--run", "own")
    ropefit("identify", "--solver", "dynamics", "--holdout", 0, "--run", "run")
    told = ropefit.json("diagnose", "--run", "run", "--simulation", "own")
    simulation = told["simulation"]
    assert simulation["missing"] == ["point_mass"]
    assert simulation["verdict"] == "none"
    low, high = simulation["rope"]["EI"]["ci95"]
    assert low < stiffer * EI < high
    assert simulation["rope"]["EI"]["value"] == pytest.approx(stiffer * EI, rel=0.1)
    assert any(text.startswith("EI is ") for text in simulation["differences"])
    assert told["heldout"]["rms_before_m"] == simulation["rms_m"] > 0.01
    assert told["heldout"]["rms_after_m"] < 2e-3
    (tmp_path / "run" / "report.html").unlink(missing_ok=True)
    ropefit("report", "--run", "run")
    page = (tmp_path / "run" / "report.html").read_text()
    assert "lacks point mass" in page
    assert "the simulation" in page


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
    told = ropefit("identify", "--solver", "dynamics", "--run", "cloud", code=3).stderr
    assert "20 frames" in told


def test_clouds_show_a_motion_by_what_lies_across_the_rope(ropefit, tmp_path):
    """From a depth camera at 33 frames a second: rigidity and damping, both bounds."""
    ropefit("preprocess", filmed(tmp_path / "filmed"), "--run", "run")
    told = ropefit.json("identify", "--solver", "dynamics", "--holdout", 0, "--run", "run")
    found = told["groups"]["group_0"]["parameters"]
    for name, truth in {"EI": EI, "bend_damping": LOSS, "air_damping": AIR}.items():
        low, high = found[name]["ci95"]
        assert low < truth < high
        assert found[name]["value"] == pytest.approx(truth, rel=0.2)
    assert told["rms_fit_m"] < 4e-3
    assert ropefit.json("diagnose", "--run", "run")["verdict"] == "none"


def test_a_weight_is_named_from_clouds_in_motion(ropefit, tmp_path):
    mass = 0.012
    ropefit("preprocess", filmed(tmp_path / "filmed", mass), "--run", "run")
    ropefit("identify", "--solver", "dynamics", "--holdout", 0, "--run", "run")
    told = ropefit.json("diagnose", "--run", "run")
    (effect,) = told["effects"]
    assert effect["name"] == "point_mass"
    size = effect["parameters"]["mass"]
    assert size["ci95"][0] < mass < size["ci95"][1]
    assert size["value"] == pytest.approx(mass, rel=0.2)
    low, high = effect["arc_length_m"]
    assert low < WEIGHT_AT < high
    assert high - low < 0.15
