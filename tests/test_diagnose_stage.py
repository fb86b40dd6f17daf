"""diagnose through real processes on a sample: the artifact, the fixed JSON, report and export."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.adapters.diagnosis_content import sizes_of
from ropefit.artifacts import Model, Observations
from ropefit.diagnosis.rules import RULES, Rules
from ropefit.effects import AxialExtensibility, ContactFriction, SoftSection, StiffSection
from ropefit.fitting import posed as problems
from ropefit.fitting.nominal import with_what_is_missed
from ropefit.inference.noise import Noise
from ropefit.runs.loading import load
from ropefit.runs.protocol import Context
from ropefit.stages import diagnose
from tests.conftest import ROOT
from tests.factories import marker_recording
from tests.test_checkpoints import compute


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
    summary = json.loads(done.stdout)
    assert summary["verdict"] == "none"
    assert summary["effects"] == []
    assert summary["heldout"]["rms_after_m"] < 1.1 * summary["heldout"]["noise_m"]
    assert 0 < summary["detectable"]["point_mass"]["value"] < 0.005
    assert {"mismatch", "next_motion"} <= set(summary)
    again = json.loads(ropefit("diagnose", "--run", str(run), "--json").stdout)
    assert not again["computed"]
    done = ropefit("report", "--run", str(run))
    assert done.returncode == 0, done.stderr
    assert "Why this and not that" in (run / "report.html").read_text()
    out = tmp_path / "rope.xml"
    to = ["export", "--run", str(run), "--to", "mujoco", "--out", str(out)]
    done = ropefit(*to, "--check", "--json")
    assert done.returncode == 0, done.stderr
    assert "<mujoco" in out.read_text()
    checked = json.loads(done.stdout)["check"]
    assert checked["simulator"].startswith("mujoco 4")
    assert checked["settled"] == [True] * 6
    assert 0 < checked["largest_deviation"] < 0.01
    assert (
        "names no simulator" in ropefit(*to[:3], "--to", "json", *to[5:], "--check", code=2).stderr
    )
    wrong = ropefit(*to, "--check", "--python", "/bin/false", code=1).stderr
    assert "has no mujoco for mujoco; pip install" in wrong
    assert ropefit("inspect", str(run / "exports.h5")).returncode == 0
    ropefit("report", "--run", str(run))
    assert "At rest in mujoco 4" in (run / "report.html").read_text()
    done = ropefit("identify", "--run", str(run), "--solver", "thomas", "--steps", "5", "--quiet")
    assert done.returncode == 0, done.stderr
    (run / "diagnosis.h5").unlink()
    again = ropefit("report", "--run", str(run))  # the export was of the rope before
    assert "exports.h5 was made from an earlier fit" in again.stderr
    assert "At rest in mujoco 4" not in (run / "report.html").read_text()
    summary = json.loads(
        ropefit("diagnose", "--run", str(run), "--most-frames", "8", "--json").stdout
    )
    simulation = summary["simulation"]
    assert simulation["name"] == "the fitted thomas simulation"
    assert summary["heldout"]["rms_before_m"] == simulation["rms_m"]
    assert simulation["rms_explained_m"] <= simulation["rms_of_rope_m"]
    assert simulation["missing"] == [effect["name"] for effect in summary["effects"]]


def test_what_another_runs_rope_misses_is_noise_here():
    def marker(rms: float) -> float:
        run = SimpleNamespace(nominal=SimpleNamespace(rms_fit=rms))
        return with_what_is_missed(Noise(marker=1e-3), run).marker  # pyright: ignore[reportArgumentType]

    assert marker(0.03) == pytest.approx(0.03 / 3**0.5)
    assert marker(0.001) == 1e-3


def test_the_noise_of_the_sensor_is_no_larger_than_measured_elsewhere():
    """An upper bound of 8 mm would hide that the rope is missed by 2 mm there."""
    run: Any = SimpleNamespace(nominal=SimpleNamespace(rms_fit=2e-3 * 3**0.5))
    bound = Noise(marker=8e-3)
    assert not with_what_is_missed(bound, run).misfit
    noise = with_what_is_missed(bound, run, 6e-4)
    assert noise.misfit
    assert (noise.sensor, noise.marker) == (6e-4, pytest.approx(2e-3))


def candidate_of(effect, value):
    """What `sizes_of` reads of a candidate with one quantity."""
    lower, upper = ([getattr(q, k) for q in effect.quantities] for k in ("lower", "upper"))
    return SimpleNamespace(
        hypothesis=SimpleNamespace(effect=effect),
        fit=SimpleNamespace(quantile=2.0),
        interval=lambda width: (np.array([value - 0.2]), np.array([value + 0.2])),
        term=SimpleNamespace(lower=lower, upper=upper),
    )


def test_intervals_end_where_a_quantity_does():
    sizes = sizes_of(candidate_of(ContactFriction(), 0.6), np.array([0.6]), np.array([0.5]))  # pyright: ignore[reportArgumentType]
    low, high = sizes["coefficient"].ci95
    assert low == 0.0
    assert 1.6 < high < 1.7


@pytest.mark.parametrize(
    ("effect", "value", "name", "expected"),
    [
        (StiffSection(), 0.7, "factor", np.exp([0.7, 0.5, 0.9])),
        (SoftSection(), 0.7, "factor", np.exp([-0.7, -0.9, -0.5])),
        (AxialExtensibility(), 0.4, "EA", [1 / 0.4, 1 / 0.6, 1 / 0.2]),
        (AxialExtensibility(), 0.1, "EA", [1 / 0.1, 1 / 0.3, 1e300]),
    ],
)
def test_derived_quantities_are_reported_first_with_their_interval(effect, value, name, expected):
    sizes = sizes_of(candidate_of(effect, value), np.array([value]), np.array([0.1]))  # pyright: ignore[reportArgumentType]
    assert list(sizes) == [name, effect.quantities[0].name]
    assert [sizes[name].value, *sizes[name].ci95] == pytest.approx(list(expected))


class Reached(Exception):
    """The nominal fit would begin now."""


def test_rules_without_calibration_leave_its_errors_out(tmp_path, monkeypatch):
    marker_recording(tmp_path / "recording", frames=4)
    for stage in ("preprocess", "identify"):
        compute(tmp_path / "run", stage)
    inputs = {kind.file_name: load(tmp_path / "run", kind)[0] for kind in (Observations, Model)}

    def fitted(setup, terms, *_):
        raise Reached([term.name for term in terms])

    monkeypatch.setattr(problems, "nominal_at_rest", fitted)
    for rules, named in ((RULES, True), (Rules(calibration=False), False)):
        with pytest.raises(Reached) as caught:
            diagnose.diagnosed(inputs, diagnose.DiagnoseSettings(), Context(), rules)
        assert "EI" in caught.value.args[0]
        assert ("gravity" in caught.value.args[0]) is named
