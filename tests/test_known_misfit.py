"""What a rope is missed by in the recording that it is known from is noise, and more is not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis import verdicts
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import Candidate, fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.unexplained import may_lack_more
from ropefit.diagnosis.verdicts import verdict_of
from ropefit.effects import Effect, FollowerForce, WallField, WeightError
from ropefit.effects.bending_law import BendingLaw
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import Work
from tests.concealed import nominal_fit, recorded, rope

MISFIT = Noise(marker=0.01, sensor=1e-4, repeats=20)


def verdict(spread: float, noise: Noise = MISFIT, samples: int = 800) -> str:
    """What is said of a rope at rest of which nothing was accepted, missed by so many times the
    variance."""
    final: Any = SimpleNamespace(
        z=np.zeros(samples), spread=spread, problem=SimpleNamespace(noise=noise, work=Work()),
        forward=SimpleNamespace(instantaneous=True),
    )  # fmt: skip
    latent: Any = SimpleNamespace(evidence=0.0, threshold=10.0)
    return verdict_of(final, final, [], latent, False, [])


@pytest.mark.parametrize(("spread", "said"), [(1.0, "none"), (1.9, "none"), (4.0, "unknown")])
def test_a_rope_missed_by_more_than_elsewhere_is_unknown(spread, said):
    assert verdict(spread) == said


@pytest.mark.parametrize(
    ("square", "noise", "left"),
    [(1.0, MISFIT, False), (1.9, MISFIT, False), (2.1, MISFIT, True), (1.3, Noise(), True)],
)
def test_what_is_missed_elsewhere_is_not_left(square, noise, left):
    """The mean square of the residual is in units of the noise."""
    problem = SimpleNamespace(noise=noise)
    fitted: Any = SimpleNamespace(z=np.full(800, square**0.5), problem=problem)
    assert may_lack_more(fitted) is left


def test_few_independent_samples_scatter_by_more():
    assert (verdict(2.5), verdict(2.5, samples=100)) == ("unknown", "none")


def test_noise_that_is_larger_than_told_is_no_sign_of_a_cause():
    """Where the rope is not known from another recording, what is left is measured as noise."""
    assert verdict(4.0, Noise(marker=1e-4, sensor=1e-4)) == "none"


@pytest.mark.parametrize(
    ("effect", "missed", "said"),
    [(WallField, 4.0, "unknown"), (WallField, 2.0, "found"), (FollowerForce, 4.0, "unknown"),
     (WeightError, 4.0, "found")],
)  # fmt: skip
def test_a_force_that_can_stand_for_much_else_must_leave_little(effect, missed, said, monkeypatch):
    monkeypatch.setattr(verdicts, "heldout_rms", lambda *_: (1e-3 * missed, 1e-3))
    monkeypatch.setattr(verdicts, "not_possible", lambda *_: "")
    assert beside(effect(), []) == said


def test_what_ends_where_it_is_not_possible_is_not_said_to_be_found(monkeypatch):
    """It was accepted with other values, from which the last fit went on."""
    monkeypatch.setattr(verdicts, "not_possible", lambda *_: "")
    assert beside(BendingLaw(), []) == "found"
    monkeypatch.setattr(verdicts, "not_possible", lambda one, final: f"at a bound in {one.fit.z}")
    refused: list[str] = []
    assert beside(BendingLaw(), refused) == "unknown"
    assert refused == ["bending_law: at a bound in [1. 1.]"]


def beside(effect: Effect, refused: list[str]) -> str:
    """What is said of a rope at rest of which an effect leaves only noise."""
    found: Any = None  # what it was before the last fit
    own = Candidate(Hypothesis(effect, NO_PLACE), found, found, 50.0, np.zeros(0))
    was: Any = SimpleNamespace(z=np.full(2, 20.0))
    final: Any = SimpleNamespace(
        z=np.ones(2), spread=1.0, problem=SimpleNamespace(noise=Noise(), work=Work()),
        forward=SimpleNamespace(instantaneous=True, terms=[]),
    )  # fmt: skip
    latent: Any = SimpleNamespace(evidence=0.0, threshold=10.0)
    return verdict_of(was, final, [Accepted(own, [], 50.0, 0.0)], latent, False, refused)


def test_a_rope_eight_times_as_heavy_as_stated_is_a_plausible_error_of_its_weight():
    heavy = rope(288)
    heavy = heavy._replace(gravity=8 * heavy.gravity)
    nominal = nominal_fit(recorded(heavy, seed=2))
    # Shapes at rest show the ratio to the rigidity only, which is known here.
    known = nominal.forward.with_terms([t for t in nominal.forward.terms if t.name != "EI"])
    smaller = fit(known, nominal.problem)
    found = fit_candidate(smaller, Hypothesis(WeightError(), NO_PLACE), np.array([5.0]))
    assert found is not None
    assert found.plausible()
    assert 1 + found.values()[0] == pytest.approx(8.0 * 3e-4 / 5e-4, rel=0.05)
