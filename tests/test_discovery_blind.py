"""A small fixed part of the blind benchmark: recordings by a simulator that is not ropefit's,
answered by the command line, scored by the benchmark's own rules."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.discovery.__main__ import one
from benchmarks.discovery.cases import listed
from benchmarks.discovery.report import miss

CASES = {case.name: case for case in listed("small", seed=5)}


@pytest.mark.parametrize(
    ("name", "verdict"),
    [
        ("clean-003", "none"),
        ("single-pointmass-000", "found"),
        ("decoy-gravitymisalignment-000", "found"),
        ("unknown-repulsion-000", "found"),  # by a law
    ],
)
def test_what_is_concealed_is_told(name, verdict, tmp_path):
    answered = one(CASES[name], tmp_path, make_only=False, score_only=False)
    assert isinstance(answered, dict)
    assert not miss(answered)
    assert answered["verdict"] == verdict
    if "repulsion" in name:
        assert answered["named"] == ["force_field"]
    assert all(answered["place"])
    assert all(answered["size"])


def test_some_cases_can_be_asked_for_by_name(tmp_path):
    command = [sys.executable, "-m", "benchmarks.discovery", "--score-only", "--out", tmp_path]
    told = subprocess.run(
        [*command, "--cases", "full", "--only", "clean-.*", "--real", tmp_path],
        cwd=Path(__file__).parents[1], capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert "0 of 300 recordings" in told
    assert "--cases full --seed 5 --only 'clean-.*'" in told
