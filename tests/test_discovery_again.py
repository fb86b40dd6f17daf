"""Recordings diagnosed again: what is compared with the answer of before."""

import copy
import subprocess
import sys

import pytest

from benchmarks.discovery.again import called, difference, markdown

ANSWER = {
    "verdict": "found",
    "effects": [
        {
            "name": "tether", "equivalent_to": ["point_mass", "kink"],
            "parameters": {"stiffness": {"value": 2.0, "unit": "N/m", "ci95": [1.0, None]}},
        }
    ],
}  # fmt: skip


def test_answers_are_told_by_effects_and_ties():
    assert called(ANSWER) == "tether = kink = point_mass"
    assert called({"verdict": "none", "effects": []}) == "none"
    assert called(None) == "no answer"


def test_values_and_intervals_are_compared():
    assert difference(ANSWER, copy.deepcopy(ANSWER)) == 0.0
    wider = copy.deepcopy(ANSWER)
    wider["effects"][0]["parameters"]["stiffness"]["ci95"][0] = 0.9
    assert difference(ANSWER, wider) == pytest.approx(0.1)
    for other in (
        None,
        {**ANSWER, "verdict": "unknown"},
        {"verdict": "found", "effects": [{**ANSWER["effects"][0], "equivalent_to": []}]},
    ):
        assert difference(ANSWER, other) is None


def test_the_table_counts_what_is_the_same_and_tells_the_longest_time():
    row = {
        "name": "one", "before": "none", "now": "none", "error": None, "differs": 0.0,
        "processor": 12.4,
    }  # fmt: skip
    other = {**row, "name": "two", "now": "kink", "differs": None, "processor": 40.0}
    table = markdown([row, other])
    assert table.index("| two | kink | none |") < table.index("| one | none | same |")
    assert "2 recordings; called the same: 1; with the same values to the last digit: 1" in table
    assert "longest processor time: 40 s" in table


def test_a_shard_beyond_the_last_is_refused(tmp_path):
    command = [sys.executable, "-m", "benchmarks.discovery.again", str(tmp_path), "--shard", "3/2"]
    told = subprocess.run(command, capture_output=True, text=True)
    assert told.returncode == 2
    assert "expected I/N with 1 <= I <= N" in told.stderr
