"""`ropefit inspect` of recordings and of what can be imported: a dry check, nothing written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.conftest import SAMPLES
from tests.factories import cloud_recording, edit, marker_recording
from tests.sources import wide_csv


def files(where: Path) -> set[Path]:
    return set(where.rglob("*"))


@pytest.mark.parametrize(("name", "word"), [("markers", "markers"), ("cloud", "clouds")])
def test_samples(ropefit, name: str, word: str) -> None:
    before = files(SAMPLES / name)
    data = ropefit.json("inspect", SAMPLES / name)
    rows = dict(data["summary"])
    assert word in rows["data"]
    assert str(data["frames"]) in rows["frames"]
    assert len(data["traced"]) == 3
    assert all("points on" in text for text in data["traced"].values())
    assert rows["gravity"] == "0, 0, -9.81 m/s²"
    assert files(SAMPLES / name) == before


def test_what_will_mislead_is_said(ropefit, tmp_path: Path) -> None:
    where = marker_recording(tmp_path / "r", rope="")
    edit(where / "recording.toml", 'name = "tiny"', 'name = "tiny"\ngravity = [0, 0, -1.6]')
    edit(where / "ends.csv", "1,0.5,1,0.7,0,0\n", "")
    result = ropefit("inspect", "r")
    assert "gravity is 1.6 m/s²" in result.stderr
    assert "no [rope] length" in result.stderr
    assert "frame 1: end 1 has no pose (1 of 3 frames)" in result.stderr
    assert "ropefit preprocess r --run my_run" in result.stderr
    assert "9 markers" in result.stdout


def test_what_preprocess_refuses_is_refused(ropefit, tmp_path: Path) -> None:
    where = cloud_recording(tmp_path / "r")
    edit(where / "recording.toml", "length = 1.0", "length = 0.5")
    refused = ropefit("inspect", "r", code=3).stderr
    assert "correct [rope] length or the ends" in refused


def test_a_source_is_told_how_it_becomes_a_recording(ropefit, tmp_path: Path) -> None:
    wide_csv(tmp_path / "take.csv")
    result = ropefit("inspect", "take.csv", "--json")
    data = json.loads(result.stdout)
    assert len(data["contents"]) > 2
    assert "ropefit import take.csv --from mocap --out my_recording" in data["next"]


def test_no_run_is_ever_advised_into_a_recording(ropefit, tmp_path: Path) -> None:
    marker_recording(tmp_path / "r")
    for command in (["identify", "--run", "r"], ["report", "--run", "r"]):
        refused = ropefit(*command, code=1).stderr
        assert "--run r`" not in refused
        assert "ropefit preprocess r --run my_run" in refused
