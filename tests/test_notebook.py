"""The notebook is run: its cells, in order, in one namespace. It is stored without outputs."""

from __future__ import annotations

import json

import pytest

from tests.conftest import ROOT

NOTEBOOK = json.loads((ROOT / "examples" / "first_recording.ipynb").read_text())
CELLS = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def test_nothing_is_stored_that_was_computed() -> None:
    assert NOTEBOOK["nbformat"] == 4
    assert len({cell["id"] for cell in NOTEBOOK["cells"]}) == len(NOTEBOOK["cells"])
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in CELLS)


def test_the_cells_run_in_order(tmp_path, monkeypatch, capsys) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for cell in CELLS:
        exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    said = capsys.readouterr().out
    assert "determined" in said
    assert "\nnone\n" in said
    assert "<mujoco" in (tmp_path / "rope.xml").read_text()
    EI = names["EI"]
    assert EI.value == pytest.approx(2e-3, rel=0.01)  # type: ignore[attr-defined]
