"""What is told falsely of a measured rope in motion is told by exactly as much."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.real import withheld
from benchmarks.real.falsehoods import FALSEHOODS, LATE, Told
from benchmarks.real.withheld import Case, judged, taken_away
from ropefit.artifacts import Diagnosis, Model
from ropefit.artifacts.store import stored_hash
from ropefit.runs.loading import load

CLIPS, FRAMES, MARKERS = 2, 30, 8


@pytest.fixture
def told(tmp_path) -> Told:
    """Two clips of a rope whose ends swing and whose markers move."""
    rng = np.random.default_rng(0)
    line = np.linspace([0.0, 0, 0], [0.7, 0, 0], MARKERS)
    time = 0.01 * np.arange(FRAMES)
    swing = np.sin(5 * time)[:, None, None] * np.array([0.0, 0.1, 0.3]) * line[:, :1]
    clips = [line + swing + 0.01 * rng.normal(size=3) for _ in range(CLIPS)]
    np.savez(
        tmp_path / "markers.npz", positions=np.concatenate(clips),
        time=np.concatenate([time + 100 * k for k in range(CLIPS)]),
    )  # fmt: skip
    (tmp_path / "recording.toml").write_text(
        'name = "swung"\ngravity = [0.0, 0.0, -9.81]\n[rope]\nlength = 1.0\n'
        "[markers]\narc_length = [0.0, 0.5, 1.0]\n"
    )
    return Told(tmp_path, CLIPS)


def positions(folder: Path) -> np.ndarray:
    return np.stack(np.split(np.load(folder / "markers.npz")["positions"], CLIPS))


def manifest(folder: Path) -> dict:
    return tomllib.loads((folder / "recording.toml").read_text())


def test_length_and_places_are_told_too_long_alike(told):
    told.changed(FALSEHOODS["length told 2 % too long"])
    said = manifest(told.folder)
    assert said["rope"]["length"] == pytest.approx(1.02)
    assert said["markers"]["arc_length"] == pytest.approx([0.0, 0.51, 1.02])
    excess = FALSEHOODS["length told 2 % too long"].sizes["excess"]
    assert said["rope"]["length"] * (1 + excess) == pytest.approx(1.0)


def test_a_clamp_is_tilted_by_its_angle_and_stays_where_it_is(told):
    before = positions(told.folder)
    told.changed(FALSEHOODS["a clamp tilted by 5°"])
    after = positions(told.folder)
    assert np.array_equal(after[:, :, 1:], before[:, :, 1:])
    ways = [x[:, :, 1] - x[:, :, 0] for x in (before, after)]
    sizes = [np.linalg.norm(way, axis=-1) for way in ways]
    np.testing.assert_allclose(*sizes)
    cosine = (ways[0] * ways[1]).sum(-1) / (sizes[0] * sizes[1])
    np.testing.assert_allclose(np.degrees(np.arccos(cosine)), 5.0, atol=1e-6)


def test_only_the_ends_are_late(told):
    before = positions(told.folder)
    told.changed(FALSEHOODS["ends 30 ms late"])
    after = positions(told.folder)
    assert after.shape[1] == FRAMES - LATE
    assert np.array_equal(after[:, :, 2:-2], before[:, LATE:, 2:-2])
    for held in (0, 1, -2, -1):
        assert np.array_equal(after[:, :, held], before[:, :-LATE, held])


def test_gravity_is_told_falsely(told):
    told.changed(FALSEHOODS["gravity tilted by 3°"])
    tilted = np.array(manifest(told.folder)["gravity"])
    assert np.degrees(np.arccos(-tilted[2] / 9.81)) == pytest.approx(3.0, abs=1e-3)
    weak = FALSEHOODS["gravity of 4.81 m/s²"]
    told.changed(weak)
    size = np.linalg.norm(manifest(told.folder)["gravity"])
    assert size * (1 + weak.sizes["excess"]) == pytest.approx(9.81, abs=1e-3)
    assert weak.beside(weak.sizes["excess"], 0.1) == pytest.approx(9.81 / 4.81 * 1.1 - 1)


@pytest.mark.parametrize(
    ("name", "equivalent", "ci95", "expected"),
    [
        ("time_lag", [], [0.02, 0.04], (True, True, True)),
        ("time_lag", [], [0.01, 0.02], (True, True, False)),
        ("damping", ["time_lag"], [0.02, 0.04], (False, True, False)),
        ("damping", [], [0.02, 0.04], (False, False, False)),
    ],
)
def test_a_cause_counts_as_named_with_its_size_in_its_interval(name, equivalent, ci95, expected):
    effect = {"name": name, "equivalent_to": equivalent,
              "parameters": {"lag": {"value": 0.03, "ci95": ci95}}}  # fmt: skip
    found = judged({
        "answer": {"effects": [effect]}, "true": {"names": ["time_lag"], "sizes": {"lag": 0.03}},
        "scores": {"time_lag": 7.0, "damping": 9.0},
    })  # fmt: skip
    assert (found["named"], found["in_set"], found["inside"]) == expected
    assert found["score"] == 7.0


def test_dampings_are_told_as_fitted_with_what_was_found_and_as_the_effect_has_them(monkeypatch):
    """Of a rope of unknown mass parameters are per weight, sizes of effects per kg/m."""

    def model(air: float) -> SimpleNamespace:
        values = {"air_damping": air, "bend_damping": 1e-4}
        group = SimpleNamespace(parameters={k: SimpleNamespace(value=v) for k, v in values.items()})
        return SimpleNamespace(nominal=SimpleNamespace(groups={"all": group}))

    o = SimpleNamespace(mass=None, gravity=np.array([0.0, 0.0, -9.81]))
    files = {Model: model(0.9), Diagnosis: None, withheld.Observations: o}
    monkeypatch.setattr(withheld, "read", lambda path, kind: (files[kind], None))
    monkeypatch.setattr(withheld, "as_found", lambda told, found: model(0.03))
    true = withheld._true(Case(undamped=True), Path("nominal"), {"effects": []})
    assert true["sizes"] == pytest.approx({"air": 0.03 * 9.81, "bend": 1e-4 * 9.81})


def test_nothing_answered_is_nothing_named():
    found = judged(
        {"answer": None, "scores": {}, "true": {"names": ["time_lag"], "sizes": {"lag": 0.03}}}
    )
    assert not found["named"]


def test_a_run_without_its_dampings_keeps_its_diagnosis(tmp_path):
    """The model changes; the diagnosis must not be refused as stale."""
    fixtures, nominal = Path(__file__).parent / "fixtures", tmp_path / "nominal"
    nominal.mkdir()
    shutil.copy(fixtures / "model.v4.h5", nominal / Model.file_name)
    shutil.copy(fixtures / "diagnosis.v5.h5", nominal / Diagnosis.file_name)
    taken_away(nominal, tmp_path / "changed", Case(undamped=True))
    found, _ = load(tmp_path / "changed", Diagnosis)
    assert found.provenance.inputs["model.h5"] == stored_hash(tmp_path / "changed" / "model.h5")
