"""The planar cable against closed forms."""

import numpy as np
import pytest

from reference_simulators.planar_cable import GRAVITY, Cable, poses

LEVEL = np.array([0.0])
TIP = np.array([1.0])


def cable(bend: float, pieces: int = 40, **more) -> Cable:
    return Cable(1.0, 0.1, np.full(pieces, bend), np.zeros(pieces), **more)


def test_a_stiff_level_cable_sinks_as_a_beam_does():
    weights = ((1.0, 0.02),)
    low = poses(cable(20.0, weights=weights), LEVEL, TIP)[0, 0, 1]
    beam = GRAVITY * (0.1 / 8 + 0.02 / 3) / 20.0
    assert -low == pytest.approx(beam, rel=2e-3)


def test_a_hanging_cable_shows_its_rest_shape():
    rest = np.zeros(40)
    rest[20] = 0.2  # half way, of a cable that is too stiff for its weight
    x = poses(Cable(1.0, 1e-6, np.full(40, 1.0), rest), np.array([-np.pi / 2]), TIP)[0, 0]
    np.testing.assert_allclose(x, [0.5 * np.sin(0.2), -0.5 - 0.5 * np.cos(0.2)], atol=1e-4)


def test_a_cable_that_rubs_comes_back_to_another_shape():
    there_and_back = np.array([-np.pi / 2, 0.0, -np.pi / 2])
    plain, rubbing = cable(0.1), cable(0.1, rub=0.5, slip=0.3)
    first, _, last = poses(plain, there_and_back, TIP)[:, 0]
    np.testing.assert_allclose(first, last, atol=1e-9)
    first, _, last = poses(rubbing, there_and_back, TIP)[:, 0]
    assert 0.01 < last[0] - first[0] < 0.3 or 0.01 < first[0] - last[0] < 0.3
    softer = poses(cable(0.1, soft=2.0), LEVEL, TIP)[0, 0, 1]
    assert softer < poses(plain, LEVEL, TIP)[0, 0, 1] - 0.01
