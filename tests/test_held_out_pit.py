"""The probability integral transform of held-out residuals is uniform where models are honest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from ropefit.diagnosis.held_out import held_out_pit


def fitted(repeats: float, sd: float, count: int = 20_000) -> Any:
    """A fit whose residuals scatter as whitened ones of which `repeats` are one sample do."""
    rng = np.random.default_rng(4)
    known = rng.uniform(0, 0.02, count)  # variance of what a fit to the others predicts
    residual = sd * rng.standard_normal(count) * np.sqrt(1 / repeats + known)
    noise = SimpleNamespace(repeats=repeats)
    return SimpleNamespace(
        held_out={False: (residual, 1 + known)}, problem=SimpleNamespace(noise=noise)
    )


@pytest.mark.parametrize("repeats", [1.0, 2.5, 100.0])
def test_uniform_where_honest(repeats: float) -> None:
    found = held_out_pit(fitted(repeats, 1.0), False)
    assert len(found) == round(20_000 / repeats)
    assert kstest(found, "uniform").pvalue > 0.01
    for sd in (0.5, 2.0):
        assert kstest(held_out_pit(fitted(repeats, sd), False), "uniform").pvalue < 0.01
