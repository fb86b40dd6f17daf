"""The user's stopwatch: a row that takes twice its recorded multiple fails the check."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from benchmarks import felt
from benchmarks.felt import ROWS, Spent


def test_every_checked_row_is_recorded() -> None:
    recorded = json.loads(felt.RATIOS.read_text())
    assert {row.name for row in ROWS if row.checked} == set(recorded)
    assert all(value > 0 for value in recorded.values())


@pytest.mark.parametrize(("times", "good"), [(1.9, True), (2.1, False)])
def test_a_row_that_got_slower_is_told(tmp_path: Path, monkeypatch, capsys, times, good) -> None:
    row = ROWS[0]
    recorded = json.loads(felt.RATIOS.read_text())[row.name]
    took = iter([5.0, 4.0, times])  # of the three tries, as multiples of what is recorded

    def spent(*command: str, folder: Path) -> Spent:
        processor = recorded * next(took) if "ropefit" in command else 1.0
        return Spent(processor, processor, 0.0)

    monkeypatch.setattr(felt, "spent", spent)
    assert felt.check(tmp_path, [row]) is good
    assert ("SLOWER" in capsys.readouterr().out) is not good


def test_a_process_is_timed(tmp_path: Path) -> None:
    took = felt.spent("-c", "a = bytearray(300_000_000); sum(range(10**6))", folder=tmp_path)
    assert took.processor > 0
    assert took.seconds >= 0.5 * took.processor
    assert took.memory > 300


def test_rows_are_commands(tmp_path: Path) -> None:
    help_ = next(row for row in ROWS if row.typed == "--help")
    assert felt.typed(help_, tmp_path).seconds < 60
    assert all(re.fullmatch(r"[\w./, -]+", row.typed) for row in ROWS)
