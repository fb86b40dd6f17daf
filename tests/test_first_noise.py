"""What laws of place do to the first measurement of the noise: only what noise does not explain."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis import first_noise
from ropefit.diagnosis.rules import RULES
from ropefit.effects import ForceField, SupportPlane
from tests.concealed import nominal_fit, recorded, rope

FRAMES = 24
FEW = replace(RULES, effects=("force_field", "point_mass", "distributed_load"))
FIELD = np.array([0.3, 1.5, 2.0, 0.1, 0.2, -0.35])


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, Any]]:
    """Return what is measured: how many moves beside the nominal model, and the noise then."""
    every, measure = [], first_noise.measured_noise

    def noted(fitted: Any, known: Any, moves: Any) -> Any:
        found = measure(fitted, known, moves)
        every.append((len(moves), found[0]))
        return found

    monkeypatch.setattr(first_noise, "measured_noise", noted)
    return every


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_of_the_ends_is_no_force_in_space(measured: list[tuple[int, Any]], seed: int):
    setup, rng = rope(48, FRAMES), np.random.default_rng(seed)
    shaken = setup._replace(ends=setup.ends + rng.normal(0, 2e-4, setup.ends.shape))
    nominal = nominal_fit(recorded(shaken, seed=seed, points=120), 24)
    noise = first_noise.first_noise(nominal, FEW)[0]
    (none, first), (some, _) = measured
    assert none == 0
    assert some > 0  # laws of place, not fitted, gain by that noise
    assert noise is first
    assert noise.ends is not None
    assert noise.ends.sd[0] == pytest.approx(2e-4, rel=0.3)


def test_a_force_in_space_is_no_noise(measured: list[tuple[int, Any]]):
    data = recorded(ForceField().apply(rope(48, FRAMES), FIELD), seed=11, points=120)
    noise = first_noise.first_noise(nominal_fit(data, 24), FEW)[0]
    (_, alone), (some, beside) = measured
    assert some > 0
    assert noise is beside
    assert noise.correlated < 0.5 * alone.correlated


@pytest.mark.parametrize("evidence", [0.0, 1e6])
def test_what_acts_on_the_whole_rope_is_not_fitted_anew_for_the_noise(
    monkeypatch: pytest.MonkeyPatch, evidence: float
):
    """Where it does not explain everything, contact is fitted, too; it goes on from its end, or is
    without prospect."""
    plane = SupportPlane().apply(rope(48, FRAMES), np.array([-0.3, 0.0, 0.0]))
    nominal = nominal_fit(recorded(plane, seed=3, points=120), 24)
    values, given = np.array([0.2, 0.004, 0.5]), []

    def leader(_: Any, scan: Any, __: Any) -> Any:
        first = scan.scores[0].hypothesis
        return SimpleNamespace(hypothesis=first, values=lambda: values, evidence=evidence)

    def noted(_: Any, scan: Any, quick: Any, *__: Any, **___: Any) -> list[Any]:
        given.append(([score.hypothesis.name for score in scan], quick))
        return []

    monkeypatch.setattr(first_noise, "_of_whole_rope", leader)
    monkeypatch.setattr(first_noise, "_by_whole_rope", lambda *_: None)
    monkeypatch.setattr(first_noise, "fit_candidates", noted)
    names = ("under_converged", "bending_law", "support_plane")
    first_noise.first_noise(nominal, replace(RULES, effects=names, most_effects=1))
    [(scanned, quick)] = given
    assert "under_converged" not in scanned
    assert [(start[0].name, start[1]) for [start] in quick] == (
        [("under_converged", values)] if evidence else []
    )
