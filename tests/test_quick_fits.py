"""Whether frames are left alike, by the scatter of what is left of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis.quick_fits import alike


def left(scatter: float, worst: float) -> Any:
    """A fit of 20 frames of 200 values, with mean squares that scatter, one of them `worst`."""
    frame = np.repeat(np.arange(20), 100)
    size = 1 + scatter * np.sin(np.arange(20.0))
    size[7] = worst
    z = np.sqrt(size[frame])[:, None] * np.ones((2000, 2))
    residual = np.zeros((2000, 2))
    stations = SimpleNamespace(frame=frame, residual=residual)
    return SimpleNamespace(
        stations=stations, z=z.ravel(), point=SimpleNamespace(seen=np.zeros((20, 5, 3)))
    )


@pytest.mark.parametrize(
    ("scatter", "worst", "same"), [(0.0, 1.2, True), (0.0, 3.0, False), (0.6, 3.0, True),
                                   (0.6, 30.0, False)]
)  # fmt: skip
def test_a_frame_stands_out_by_the_scatter_of_the_others(scatter, worst, same):
    assert alike(left(scatter, worst)) is same


def test_frames_that_are_not_known_do_not_stand_out():
    lost = np.arange(20) == 7
    assert alike(left(0.0, 30.0), lost)
    assert not alike(left(0.0, 30.0), ~lost & (np.arange(20) < 3))
