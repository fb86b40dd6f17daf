"""All stages of a recording of pictures without depth: control compares in the pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ropefit.api import runs
from ropefit.artifacts import write
from ropefit.losses.names import IN_PICTURES, OWN
from ropefit.runs.protocol import Context
from tests.report_runs import observations


@pytest.mark.parametrize("loss", OWN)
@pytest.mark.parametrize("depth", [True, False])
def test_the_loss_that_can_be_evaluated(tmp_path: Path, monkeypatch, loss: str, depth: bool):
    from ropefit.adapters.scene import check_loss

    o = observations(depth_measured=depth)
    write(tmp_path / o.file_name, o)
    asked: list[dict[str, Any]] = []
    said: list[str] = []
    monkeypatch.setattr(runs, "control", lambda run, given, *_, **__: asked.append(given))
    runs.control_by(tmp_path, loss, Context(say=said.append))
    (given,) = asked
    check_loss(o, given["loss"])
    changed = not depth and loss in IN_PICTURES
    assert (given["loss"] != loss) == changed == bool(said)
