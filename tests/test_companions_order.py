"""Which beginning of two effects at once is fitted, and which next where that leads nowhere."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis import companions as module

SMALLER = SimpleNamespace(z=np.ones(100))


def found(
    monkeypatch: pytest.MonkeyPatch, misfits: list[float], leading: set[float]
) -> tuple[Any, list[float]]:
    """Return what companions are found where beginnings of these misfits are proposed, of which
    some lead to a fit, and the misfits of those that were fitted, in order."""
    tried: list[float] = []

    def fitted(smaller: Any, begun: Any) -> Any:
        tried.append(begun.misfit)
        return begun if begun.misfit in leading else None

    starts = [[(f"hypothesis {m}", np.zeros(1))] for m in misfits]
    monkeypatch.setattr(module, "_pairs", lambda *_: iter(starts))
    monkeypatch.setattr(module, "_with_known_beginning", lambda current, _: SMALLER)
    by_start = {id(s): m for s, m in zip(starts, misfits, strict=True)}
    monkeypatch.setattr(
        module, "settled_start", lambda _, s: SimpleNamespace(misfit=by_start[id(s)])
    )
    monkeypatch.setattr(module, "_fitted", fitted)
    return module.companions(SMALLER, []), tried  # type: ignore[arg-type]


def test_the_next_beginning_is_fitted_where_the_best_leads_nowhere(monkeypatch):
    both, tried = found(monkeypatch, [60.0, 30.0, 40.0], {40.0})
    assert tried == [30.0, 40.0]
    assert both.hypotheses == ["hypothesis 40.0"]


def test_what_begins_worse_than_nothing_is_not_fitted(monkeypatch):
    both, tried = found(monkeypatch, [120.0, 90.0], {120.0})
    assert (both, tried) == (None, [90.0])


def test_no_further_beginning_is_looked_at_where_one_explains_nearly_all(monkeypatch):
    both, tried = found(monkeypatch, [50.0, 10.0, 5.0], {50.0, 10.0, 5.0})
    assert tried == [10.0]
    assert both.hypotheses == ["hypothesis 10.0"]
