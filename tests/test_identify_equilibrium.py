"""identify and control with the rope in equilibrium, as a person runs them, on the samples."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

from tests.conftest import SAMPLES

TRUE = 7e-4  # N m², of the cloud and rgbd samples; see sample_data/README.md


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A folder with `run`, the rgbd sample fitted by least squares, and what was told."""
    from tests.conftest import Command

    folder = tmp_path_factory.mktemp("rgbd")
    command = Command(folder)
    command("preprocess", SAMPLES / "rgbd", "--quiet")
    return folder, command.json("identify")


def parameters(found):
    return found["groups"]["group_0"]["parameters"]


def test_rigidity_of_the_sample_with_units_interval_and_calibration(fitted):
    _, found = fitted
    bend = parameters(found)["EI"]
    assert bend["unit"] == "N m^2"
    assert bend["verdict"] == "determined"
    assert abs(np.log(bend["value"] / TRUE)) < 0.05
    assert bend["ci95"][0] < bend["value"] < bend["ci95"][1]
    assert found["frames_converged"] == 8
    assert found["mass_known"]
    assert {"camera_rotation_x", "scale", "gravity_x", "end_0_x"} <= set(found["calibration"])
    weight = 0.05 * 9.81  # N/m, of 50 g
    assert found["bending_length_m"] == pytest.approx((bend["value"] / weight) ** (1 / 3), rel=1e-6)


def test_a_fit_that_leaves_far_more_than_noise_says_so(ropefit, tmp_path):
    copy = tmp_path / "rec"
    shutil.copytree(SAMPLES / "cloud", copy)
    text = (copy / "recording.toml").read_text()
    told = re.sub(r"gravity = .*", "gravity = [0.0, 9.81, 0.0]", text)
    assert told != text
    (copy / "recording.toml").write_text(told)
    ropefit("preprocess", copy, "--quiet")
    assert "something is missing, or the set-up is described wrongly" in ropefit("identify").stderr
    ropefit("preprocess", SAMPLES / "cloud", "--run", "good", "--quiet")
    assert "something is missing" not in ropefit("identify", "--run", "good").stderr


def test_without_the_mass_the_rigidity_is_a_ratio(ropefit, tmp_path):
    copy = tmp_path / "rec"
    shutil.copytree(SAMPLES / "rgbd", copy)
    text = (copy / "recording.toml").read_text().splitlines()
    (copy / "recording.toml").write_text(
        "\n".join(line for line in text if not line.startswith("mass")) + "\n"
    )
    ropefit("preprocess", copy, "--quiet")
    result = ropefit("identify")
    assert "the mass is not known" in result.stderr
    found = ropefit.json("identify")
    bend = parameters(found)["EI"]
    assert bend["unit"] == "m^3"
    assert abs(np.log(bend["value"] / (TRUE / (0.05 * 9.81)))) < 0.05
    assert found["bending_length_m"] == pytest.approx(bend["value"] ** (1 / 3), rel=1e-6)


@pytest.mark.parametrize("search", ["gradient", "grid"])
def test_any_loss_by_the_papers_searches(fitted, tmp_path, search):
    from tests.conftest import Command

    shutil.copytree(fitted[0] / "run", tmp_path / "run")
    rounds = ["--rounds", "5", "--levels", "5"] if search == "grid" else []
    found = Command(tmp_path).json("identify", "--search", search, "--loss", "OBJ4", *rounds)
    bend, twist = parameters(found)["EI"], parameters(found)["GJ"]
    assert abs(np.log(bend["value"] / TRUE)) < 0.2
    assert twist["value"] == pytest.approx(2 / 3 * bend["value"])
    assert found["search"] == search


def test_control_and_another_runs_parameters(fitted, tmp_path):
    from tests.conftest import Command

    shutil.copytree(fitted[0] / "run", tmp_path / "run")
    ropefit = Command(tmp_path)
    found = ropefit.json("control", "--key", "0.5", "--evaluations", "60")
    assert np.median(found["deviation_m"]) < 0.003
    assert (
        np.abs(found["length_error"]).max() < 2e-3
    )  # as the sensor with its error of scale sees it
    turned = ropefit.json("control", "--turn", "--evaluations", "15")
    assert np.allclose(np.linalg.norm(turned["orientation"], axis=1), 1)
    shutil.copytree(tmp_path / "run", tmp_path / "other")
    frozen = ropefit.json("identify", "--run", "other", "--from", "run")
    bend = parameters(frozen)["EI"]
    assert bend["verdict"] == "fixed"
    assert bend["value"] == pytest.approx(parameters(fitted[1])["EI"]["value"])
    again = ropefit.json("identify", "--run", "other", "--from", "run")
    assert not again["computed"]
    ropefit("identify", "--start", "EI=1e-3", "--free", "EI", "--groups", "0-3,4-7", "--quiet")
    refused = ropefit("identify", "--run", "other", "--from", "run", code=2).stderr
    assert "2 parameter sets" in refused
