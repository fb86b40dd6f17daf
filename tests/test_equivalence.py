"""Which candidate of a tie is named first."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis.equivalence import ordered
from ropefit.effects import LostOutOfPlane, Obstacle, PointMass


def candidate(effect: Any, evidence: float, gained: float, unlikely: float = 0.0) -> Any:
    """gained [nats] by held-out data; unlikely: sd that an error of the set-up is off zero."""
    return SimpleNamespace(
        hypothesis=SimpleNamespace(effect=effect),
        evidence=evidence,
        gains=np.full(5, gained / 5),
        term=SimpleNamespace(prior=np.full(len(effect.names), np.inf)),
        fit=SimpleNamespace(
            prior=np.array([1.0, np.inf]), point=SimpleNamespace(u=np.array([unlikely, 9.0])),
            spread=1.0,
        ),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("mass", "error", "first"),
    [
        ((20.0, 25.0), (20.5, 24.0), "lost_out_of_plane"),  # nothing tells them apart
        ((20.0, 30.0), (20.5, 24.0), "point_mass"),  # held-out data do
        ((28.0, 34.0), (20.5, 24.0), "point_mass"),  # evidence does, too
        ((17.0, 30.0), (20.5, 24.0), "lost_out_of_plane"),  # no tie
        ((20.0, 30.0, 3.0), (20.5, 24.0), "lost_out_of_plane"),  # beside an unlikely set-up
        ((20.0, 24.0), (20.5, 30.0), "lost_out_of_plane"),
    ],
)
def test_a_measurement_error_is_first_unless_held_out_data_tell(mass, error, first):
    one, other = candidate(PointMass(), *mass), candidate(LostOutOfPlane(), *error)
    for best, same in ((one, [other]), (other, [one])):
        named, others = ordered(best, same)
        assert named.hypothesis.effect.name == first
        assert len(others) == 1
        assert others[0] is not named


def test_gains_of_frames_and_of_stretches_are_not_compared():
    bar, error = candidate(Obstacle(), 20.0, 60.0), candidate(LostOutOfPlane(), 20.5, 24.0)
    assert bar.hypothesis.effect.held_out != error.hypothesis.effect.held_out
    assert ordered(error, [bar])[0] is error
