"""What was computed once is not computed again: evaluations, fits of contact, evidence."""

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis import fits as fits_module
from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.candidate import columns_of, compared, fit_candidate, occam_factor
from ropefit.diagnosis.candidates import fit_candidates
from ropefit.diagnosis.contact_beside import by_contact
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.reassessment import without_effects
from ropefit.effects import Obstacle, PointMass, ScaleError, StiffSection, SupportPlane
from ropefit.effects.place import middle_of
from ropefit.inference import noise as noise_module
from ropefit.inference.noise import likeliest
from ropefit.inference.objective import Objective
from ropefit.models.equilibrium import Equilibrium
from tests.concealed import bar_under, nominal_fit, recorded, rope, with_effect

EVERY_SD = 99  # more than any kind of noise has


def test_a_fit_keeps_its_best_evaluation(monkeypatch):
    nominal = nominal_fit(recorded(rope(72), seed=1), 72)
    best = nominal.point.u
    objective = Objective(nominal.forward, nominal.problem, best)
    asked: list[np.ndarray] = []
    at = Equilibrium.at

    def counted(self, u, start=None):
        asked.append(u.copy())
        return at(self, u, start)

    monkeypatch.setattr(Equilibrium, "at", counted)
    objective.rows(best)
    slopes = objective.jacobian(best)
    objective.rows(best + 0.05)
    many = len(asked)
    assert objective.jacobian(best) is slopes
    assert len(asked) == many
    last = objective.forward.last
    assert last is objective.at(best)[0].solution  # where the model goes on from


def touched():
    """A fit without the plane that the rope lies on in a few frames, and hangs above."""
    free = rope(288)
    lowest = np.sort(Equilibrium(free, []).at(np.empty(0)).seen[..., 2].min(axis=1))
    height = lowest[2] - float(middle_of(free)[2])
    return nominal_fit(recorded(SupportPlane().apply(free, np.array([height, 0, 0])), seed=8))


def test_contact_that_is_known_is_fitted_no_more_and_stops_what_is_far_behind(monkeypatch):
    nominal = touched()
    found = by_contact(nominal, 6.0, ("support_plane",))
    assert found.explains
    assert found.on(nominal) == found.candidates
    assert found.on(replace(nominal)) == []
    fitted: list[str] = []
    fit_one = fits_module.fit_candidate

    def noted(smaller, hypothesis, *arguments, **named):
        fitted.append(hypothesis.name)
        return fit_one(smaller, hypothesis, *arguments, **named)

    monkeypatch.setattr(fits_module, "fit_candidate", noted)
    plane = [(c.hypothesis, c.values()) for c in found.candidates]
    stiff = [(Hypothesis(StiffSection(), NO_PLACE), np.array([0.5, 0.5, 0.2]))]
    best, *others = fit_candidates(
        nominal, [], [stiff], [plane], 6.0, ("support_plane", "stiff_section"),
        known=found.candidates,
    )  # fmt: skip
    assert best is found.candidates[0]
    assert "support_plane" not in fitted
    assert all(one.fit.stopped for one in others)


def test_a_frame_that_does_not_settle_at_once_is_tried_anew_only_where_that_is_asked_for():
    free = rope(288)
    nominal = nominal_fit(recorded(free, seed=6))
    deep = bar_under(free) + 0.03 * np.eye(5)[2]
    starts = [(Hypothesis(Obstacle(), NO_PLACE), deep)]
    assert settled_start(nominal, starts) is not None
    assert settled_start(nominal, starts, at_once=True) is None


def test_evidence_of_an_effect_does_not_depend_on_the_order_of_the_terms():
    setup = with_effect(PointMass(), [0.002, 0.37])
    nominal = nominal_fit(recorded(ScaleError().apply(setup, np.array([0.03])), seed=4))
    first = fit_candidate(nominal, Hypothesis(PointMass(), NO_PLACE), np.array([0.002, 0.37]))
    assert first is not None
    second = fit_candidate(first.fit, Hypothesis(ScaleError(), NO_PLACE), np.array([0.03]))
    assert second is not None
    both, term = second.fit, first.term
    mine = columns_of(both, term)
    rest = np.setdiff1d(np.arange(both.forward.size), mine)
    parts = both.forward.split(both.point.u)
    kept = [k for k, one in enumerate(both.forward.terms) if one is not term]
    np.testing.assert_array_equal(both.point.u[rest], np.concatenate([parts[k] for k in kept]))
    without = without_effects(both, first)
    assert without is not None
    held = compared(first.hypothesis, term, without, both)
    np.testing.assert_allclose(held.values(), [0.002, 0.37], rtol=0.1)
    again = fit_candidate(without, first.hypothesis, held.values())
    assert again is not None
    assert held.evidence == pytest.approx(again.evidence, rel=0.02)
    assert occam_factor(both, term) == pytest.approx(occam_factor(again.fit, again.term), rel=0.02)


@pytest.mark.parametrize("correlated", [False, True])
def test_noise_past_its_minimum_is_not_asked_for(monkeypatch, correlated):
    nominal = nominal_fit(recorded(rope(72), seed=2), 72)
    s = nominal.stations
    if correlated:
        rng = np.random.default_rng(3)
        alike = np.repeat(rng.normal(0, 0.002, int(s.frame.max()) + 1)[s.frame][:, None], 2, 1)
        s = replace(s, residual=s.residual + alike)
    quick, cost = likeliest(s, nominal.problem.noise)
    monkeypatch.setattr(noise_module, "PAST", EVERY_SD)
    whole, least = likeliest(s, nominal.problem.noise)
    assert (quick.correlated, quick.length) == (whole.correlated, whole.length)
    assert cost == least
    assert bool(quick.correlated) == correlated
