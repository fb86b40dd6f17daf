"""The motion that would tell two candidates apart, where a rope does not follow all of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from ropefit.diagnosis.next_motion import motions, next_motion
from tests.concealed import rope

NODES = 31


class Rope:
    """A model whose rope is `off` [m] from a line, further in each later motion; in the last it
    does not settle in one pose."""

    instantaneous = True

    def __init__(self, off: float, lost: int | None) -> None:
        self.base, self.terms, self.off, self.lost, self.tried = rope(NODES - 1), [], off, lost, 0

    def of_setup(self, setup, states, terms):
        return self

    def at(self, u):
        self.tried += 1
        seen = np.full((5, NODES, 3), self.off * self.tried)
        if self.tried == self.lost:
            seen[3] = np.nan
        return SimpleNamespace(seen=seen)


def candidate(off: float, lost: int | None = None):
    return SimpleNamespace(
        fit=SimpleNamespace(forward=Rope(off, lost), point=SimpleNamespace(u=np.zeros(0)))
    )


def test_a_motion_that_a_rope_does_not_follow_is_not_proposed():
    names = list(motions(rope(NODES - 1)))
    name, apart, shapes = next_motion(candidate(0.0), candidate(0.001))  # type: ignore[arg-type]
    assert name == names[-1]
    assert apart == pytest.approx(0.001 * len(names) * 3**0.5)
    lost = candidate(0.001, lost=len(names))
    name, apart, shapes = next_motion(candidate(0.0), lost)  # type: ignore[arg-type]
    assert name == names[-2]
    assert apart == pytest.approx(0.001 * (len(names) - 1) * 3**0.5)
    assert shapes is not None
    assert shapes.shape == (2, 5, NODES, 3)
    assert np.isfinite(shapes).all()
