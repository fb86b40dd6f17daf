"""Candidates whose fits were stopped for want of prospect: fitted to the end where they count."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis import candidates
from ropefit.diagnosis import fits as fits_module
from ropefit.diagnosis.accepted import close_cost
from ropefit.diagnosis.candidate import Candidate, fit_candidate
from ropefit.diagnosis.candidates import completed, fit_candidates, promised, unfinished
from ropefit.diagnosis.fits import Fits
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.scan import Projection, Scorer
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.effects import (
    DistributedLoad,
    ForceField,
    GravityMisalignment,
    MassSection,
    Obstacle,
    PointMass,
    SoftSection,
    StiffSection,
    SupportPlane,
    Tether,
)
from ropefit.inference.noise import Noise
from ropefit.inference.objective import LEFT
from ropefit.models.prior import Prior
from ropefit.models.terms import Term
from tests.concealed import nominal_fit, recorded, with_effect


def test_stopped_fits_change_no_answer():
    nominal = nominal_fit(recorded(with_effect(PointMass(), [0.0006, 0.37], 144), seed=7), 72)
    sensitivities, project = Sensitivities(nominal), Projection(nominal)
    setup, scores = nominal.point.setup, []
    for effect in (PointMass(), SoftSection(), StiffSection()):
        one = sensitivities.of(Hypothesis(effect, effect.scan_places(setup)))
        scores.append(Scorer(one, project, one.hypothesis.scales(setup))(project.z))
    reported: list[tuple[float, str]] = []
    found = fit_candidates(nominal, scores, [], [], 6.0, progress=lambda *it: reported.append(it))
    shares = [share for share, _ in reported]  # which effect is fitted, and how far that is
    assert shares == sorted(set(shares))
    assert shares[0] == 0
    assert shares[-1] < 1
    assert {"fit of point mass", "fit of stiff section"} <= {text for _, text in reported}
    assert found[0].hypothesis.name == "point_mass"
    whole = fit_candidate(nominal, found[0].hypothesis, found[0].values())
    assert whole is not None
    assert found[0].evidence == pytest.approx(whole.evidence, rel=0.01)
    stopped = [c for c in found if c.fit.stopped]
    assert stopped
    assert not found[0].fit.stopped
    ended = completed(nominal, found, 6.0, lambda _: None)
    assert not any(c.fit.stopped for c in ended)
    assert [c.evidence for c in ended] == sorted((c.evidence for c in ended), reverse=True)
    for candidate in ended[1:]:  # what was not expected of them, they do not have
        assert candidate.evidence < 0.5 * found[0].evidence
    assert np.isfinite([c.evidence for c in found]).all()


def test_a_fit_that_ended_before_its_minimum_goes_on():
    nominal = nominal_fit(recorded(with_effect(PointMass(), [0.0006, 0.37], 144), seed=7), 72)
    start = np.array([0.0002, 0.3])
    early = fit_candidate(nominal, Hypothesis(PointMass(), NO_PLACE), start, evaluations=2)
    assert early is not None
    assert not early.fit.stopped
    assert unfinished(early)
    (ended,) = completed(nominal, [early], -np.inf, lambda _: None)
    assert not unfinished(ended)
    assert ended.fit.left_to_gain < LEFT < early.fit.left_to_gain
    assert ended.evidence > early.evidence + 1
    assert completed(nominal, [ended], 6.0, lambda _: None) == [ended]


def test_what_cannot_come_near_to_what_is_acceptable_is_not_fitted_to_the_end():
    nominal = nominal_fit(recorded(with_effect(PointMass(), [0.0006, 0.37], 144), seed=7), 72)
    start = np.array([0.0002, 0.3])
    early = fit_candidate(nominal, Hypothesis(PointMass(), NO_PLACE), start, evaluations=12)
    assert early is not None
    assert unfinished(early)
    most = promised(nominal, early)
    assert most > early.evidence + 0.5 * early.fit.left_to_gain
    for behind, further in ((4.0, True), (6.0, False)):  # nats: what is told as not ruled out
        best = replace(early, evidence=most + behind)
        (now,) = completed(nominal, [early], 6.0, lambda _, best=best: best)
        assert (now is not early) is further
    (now,) = completed(nominal, [early], most + 1.0, lambda _: None)
    assert now is early


class Given(Candidate):
    """A candidate of given sizes, whose covariance has a direction without variance."""

    rounding = 0.0

    def usual_sizes(self) -> np.ndarray:
        return np.array([3.0, 4.0, 5.0])

    def covariance(self, by_noise: bool = False) -> np.ndarray:
        turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
        return turn @ np.diag([self.rounding, 0.5, 2.0]) @ turn.T


@pytest.mark.parametrize("rounding", [-1e-14, 1e-14])
def test_what_nothing_determines_is_not_counted(rounding):
    """Rounding leaves a variance of either sign where there is none."""
    problem = SimpleNamespace(noise=Noise())
    size, fit = SimpleNamespace(size=3), SimpleNamespace(student=1.96, problem=problem)
    one = Given(size, None, fit, 0.0, np.zeros(0))  # type: ignore[arg-type]
    exact = one.significance()
    one.rounding = rounding
    assert exact > 1.0
    assert one.significance() == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(
    ("wanted", "beyond"), [(0.9, False), (1.15, False), (1.25, True), (-0.15, False), (-0.25, True)]
)
def test_what_the_data_want_beyond_a_bound(wanted: float, beyond: bool):
    """A share of which the data tell 0.1 (one sigma), beside a parameter of the rope's."""
    term = Term(
        "lost", ("share",), ("1",), lambda setup, _: setup, np.zeros(1), np.full(1, 0.5),
        np.zeros(1), np.ones(1), np.full(1, np.inf),
    )  # fmt: skip
    held = np.clip(wanted, 0.0, 1.0)
    jacobian = np.array([[2.0, 0.0], [3.0, 0.0], [0.0, 0.5 / 0.1]])  # searched in halves
    fit = SimpleNamespace(
        jacobian=jacobian, z=jacobian @ [0.0, (wanted - held) / 0.5], spread=1.0,
        prior=Prior(np.array([np.inf, np.inf])),
        point=SimpleNamespace(u=np.array([7.0, held / 0.5])),
        forward=SimpleNamespace(terms=[None, term], split=lambda u: [u[:1], u[1:]]),
    )  # fmt: skip
    one = Candidate(None, term, fit, 0.0, np.zeros(0))  # type: ignore[arg-type]
    assert one.wants_beyond_bounds() == beyond


@pytest.mark.parametrize(("behind", "sufficient"), [(1.0, True), (10.0, False)])
def test_an_error_of_the_set_up_within_reach_makes_slow_fits_needless(
    behind, sufficient, monkeypatch
):
    """A load is ahead of a tilt of gravity, by less than a tie, and leaves some frames worse."""
    monkeypatch.setattr(fits_module, "uneven", lambda fitted: True)

    def one(effect, evidence):
        still = SimpleNamespace(setup=SimpleNamespace(motion=None))
        fitted = SimpleNamespace(z=np.full(100, 1.5), point=still)
        return SimpleNamespace(
            hypothesis=Hypothesis(effect, NO_PLACE), fit=fitted, evidence=evidence
        )

    fits = Fits(SimpleNamespace(z=np.full(100, 1000.0)), 6.0)  # type: ignore[arg-type]
    assert not fits.sufficient()
    for candidate in one(DistributedLoad(), 500.0), one(GravityMisalignment(), 500.0 - behind):
        fits.best_of[candidate.hypothesis.key] = candidate  # type: ignore[assignment]
    assert fits.sufficient() is sufficient


@pytest.mark.parametrize(("behind", "kept"), [(1.0, 1), (10.0, 0)])
def test_of_a_tie_of_one_hypothesis_the_significant_one_is_kept(behind, kept, monkeypatch):
    """That one part of a rope weighs less is as good as that another part weighs more."""
    monkeypatch.setattr(fits_module, "on_right_branches", lambda fitted: fitted)
    hypothesis, fits = Hypothesis(MassSection(), NO_PLACE), Fits(SimpleNamespace(), 6.0)  # type: ignore[arg-type]

    def one(evidence, significance):
        return SimpleNamespace(
            hypothesis=hypothesis, fit=None, evidence=evidence, significance=lambda: significance
        )

    every = [one(100.0, 0.5), one(100.0 - behind, 8.0), one(50.0, 9.0)]
    for k in np.random.default_rng(3).permutation(3):
        fits._keep(every[k])  # type: ignore[arg-type]
    assert fits.best() is every[0]
    assert fits.found() == [every[kept]]


@pytest.mark.parametrize(("cost", "elsewhere"), [(90.0, True), (110.0, False)])
def test_contact_is_begun_elsewhere_only_where_it_makes_a_difference(cost, elsewhere, monkeypatch):
    """And its fit is continued only with prospect of that cost."""
    tried, asked = [], []
    setup = SimpleNamespace(potentials=(), remembers=False)
    current = SimpleNamespace(
        point=SimpleNamespace(setup=setup), z=np.full(100, 2.0), cost=400.0, spread=4.0
    )
    plane = Hypothesis(SupportPlane(), NO_PLACE)

    def fitted(_, hypothesis, start, lowest, *args, **kwargs):
        asked.append(lowest)
        return SimpleNamespace(
            hypothesis=hypothesis,
            evidence=1.0,
            fit=SimpleNamespace(cost=cost),
            values=lambda: start,
        )

    monkeypatch.setattr(fits_module, "fit_candidate", fitted)
    monkeypatch.setattr(fits_module, "on_right_branches", lambda found: found)
    monkeypatch.setattr(fits_module, "cost_for", lambda smaller, evidence: 100.0)
    monkeypatch.setattr(candidates, "distorted", lambda found: False)
    monkeypatch.setattr(Fits, "sufficient", lambda self: False)
    monkeypatch.setattr(Fits, "_needed", lambda self, _: np.inf)
    monkeypatch.setattr(Fits, "found", lambda self: list(self.best_of.values()))
    monkeypatch.setattr(Fits, "_elsewhere", lambda self, one: tried.append(one))
    slow = [[(plane, np.array([-0.3, 0.0, 0.0]))]]
    fit_candidates(current, [], [], slow, 6.0, for_noise=True)  # type: ignore[arg-type]
    assert asked == [100.0]
    assert bool(tried) == elsewhere


@pytest.mark.parametrize(
    ("remembers", "left", "fitted"), [(False, 1.0, 1), (True, 1.0, 0), (True, 1.5, 1)]
)
def test_beside_memory_fields_are_fitted_only_to_more_than_noise(
    remembers, left, fitted, monkeypatch
):
    setup = SimpleNamespace(potentials=(), remembers=remembers)
    current: Any = SimpleNamespace(point=SimpleNamespace(setup=setup), z=np.full(100, left))
    tried = []
    monkeypatch.setattr(Fits, "add_kinds", lambda self, starts: tried.append(starts))
    monkeypatch.setattr(Fits, "sufficient", lambda self: False)
    field = Hypothesis(ForceField(), NO_PLACE)
    fit_candidates(current, [], [], [[(field, np.zeros(5))]], 6.0)
    assert len(tried) == fitted


@pytest.mark.parametrize(
    ("spread", "for_noise", "tolerance"),
    [(0.8, False, 1e-5), (4.0, False, 4e-5), (500.0, False, 1e-4), (4.0, True, 1e-3)],
)
def test_fits_end_the_sooner_the_more_the_smaller_model_misses(
    spread, for_noise, tolerance, monkeypatch
):
    current: Any = SimpleNamespace(z=np.ones(9), cost=9.0, spread=spread)
    asked = []
    monkeypatch.setattr(
        fits_module, "fit_candidate", lambda *_, tolerance, **__: asked.append(tolerance)
    )
    Fits(current, 6.0, for_noise=for_noise).add([(Hypothesis(Tether(), NO_PLACE), np.zeros(5))])
    assert asked == pytest.approx([tolerance])


@pytest.mark.parametrize(
    ("before", "after", "spread", "close"),
    [
        (1000.0, 960.0, 1.0, 980.0),  # half of what it explains
        (9000.0, 1000.0, 0.9, 1060.0),  # thirty nats behind it
        (9000.0, 1000.0, 3.0, 1180.0),
    ],
)
def test_what_may_be_as_good_beside_other_effects(before, after, spread, close):
    without, fitted = (SimpleNamespace(cost=c, spread=spread) for c in (before, after))
    assert close_cost(without, fitted) == close  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("best", "left", "for_noise", "enough"),
    [
        (SupportPlane(), 1.0, False, True),
        (SupportPlane(), 1.5, False, False),  # a plane that leaves more than noise
        (SupportPlane(), 1.5, True, True),  # but next to nothing of what was there
        (PointMass(), 1.0, False, False),  # no body: a plane may explain as much
    ],
)
def test_one_body_that_explains_all_is_enough(best, left, for_noise, enough, monkeypatch):
    """Then a body that explains much less is not begun elsewhere."""
    monkeypatch.setattr(fits_module, "uneven", lambda fitted: False)

    def one(effect, variance, evidence):
        fitted = SimpleNamespace(z=np.full(1000, variance**0.5))
        return SimpleNamespace(
            hypothesis=Hypothesis(effect, NO_PLACE), fit=fitted, evidence=evidence
        )

    current = SimpleNamespace(z=np.full(1000, 30.0))
    fits = Fits(current, 6.0, for_noise=for_noise)  # type: ignore[arg-type]
    assert not fits.enough()
    bars = [one(Obstacle(), 500.0, evidence) for evidence in (900.0, 400.0)]
    for candidate in one(best, left, 1000.0), bars[0]:
        fits.best_of[candidate.hypothesis.key] = candidate  # type: ignore[assignment]
    assert fits.enough() == enough
    assert [fits.far_behind(bar) for bar in bars] == [False, enough]  # type: ignore[arg-type]
