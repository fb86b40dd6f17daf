"""Hypotheses that the first order ranks low where much is missed: compared on few frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis import few_frames
from ropefit.diagnosis import fits as fits_module
from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.candidate import fit_candidate, gain_of
from ropefit.diagnosis.candidates import fit_candidates
from ropefit.diagnosis.fits import Fits
from ropefit.diagnosis.full_scan import Scan, sensitivities
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.leaders import MOST_LEADERS
from ropefit.diagnosis.mixed_pairs import two_instead
from ropefit.diagnosis.rules import RULES
from ropefit.effects import IntrinsicCurvature, PointMass, StiffSection
from tests.concealed import recorded, rope
from tests.test_calm import fitted

CURVED = (0.0, 3.0, 0.55, 0.7)
STIFF, MASS = (2.0, 0.3, 0.3), (0.01, 0.7)
NAMES = ("stiff_section", "point_mass", "mass_section", "soft_section")


def concealed(*effects, seed=31):
    """The nominal fit to a rope with these effects."""
    setup = rope(144)
    for effect, values in effects:
        setup = effect.apply(setup, np.array(values))
    return fitted(recorded(setup, seed=seed))


@pytest.fixture(scope="module")
def curved():
    """A rope that rests strongly curved over most of its length, and its scan."""
    nominal = concealed((IntrinsicCurvature(), CURVED))
    return nominal, Scan(nominal, lambda: sensitivities(nominal, [])).scores


def test_a_stretch_is_as_wide_as_it_is(curved):
    """The first order prefers a narrow one at an edge, from where no fit finds the other edge."""
    nominal, scores = curved
    of = next(s for s in scores if s.hypothesis.name == "intrinsic_curvature")
    assert of.hypothesis.places[of.best][1] < 0.5 * CURVED[3]
    first = fit_candidates(nominal, scores, [], [], 6.0)[0]
    assert first.hypothesis.name == "intrinsic_curvature"
    assert first.values() == pytest.approx(CURVED[1:], rel=0.02)


@pytest.mark.parametrize(("share", "fitted_"), [(0.6, True), (0.4, False)])
def test_beyond_the_leaders(curved, share, fitted_):
    """What ranks high is fitted where those before it leave much; what does not is not."""
    nominal, scores = curved
    high = scores[0].log_factor
    of = {s.hypothesis.name: s for s in scores}
    names = ("point_mass", "mass_section", "kink", "soft_section", "stiff_section", "tether")
    leaders = [replace(of[name], log_factor=high) for name in names]
    assert len(leaders) == MOST_LEADERS
    last = replace(of["intrinsic_curvature"], log_factor=share * high)
    found = fit_candidates(nominal, [*leaders, last], [], [], 6.0)
    assert ("intrinsic_curvature" in {c.hypothesis.name for c in found}) is fitted_


def test_two_strong_effects_where_each_alone_leaves_most():
    nominal = concealed((StiffSection(), STIFF), (PointMass(), MASS), seed=77)
    scores = Scan(nominal, lambda: sensitivities(nominal, [], NAMES)).scores
    singles = fit_candidates(nominal, scores, [], [], 6.0)
    assert singles[0].evidence < 100  # what each leaves is no noise
    _, accepted = two_instead(nominal, [], 6.0, replace(RULES, effects=NAMES), singles)
    values = {a.candidate.hypothesis.name: a.candidate.values() for a in accepted}
    assert set(values) == {"stiff_section", "point_mass"}
    assert values["stiff_section"] == pytest.approx(STIFF, rel=0.03)
    assert values["point_mass"] == pytest.approx(MASS, rel=0.03)


@pytest.mark.parametrize(("true", "kept"), [(MASS, True), ((0.0, 0.7), False)])
def test_what_explains_noise_of_few_frames_is_not_fitted_to_all(true, kept, monkeypatch):
    nominal, begun = concealed((PointMass(), true), seed=5), []

    def hopeful(current, *start, **more):
        """Few frames do not show that a fit is without prospect."""
        begun.append(current)
        found = fit_candidate(current, *start, **more)
        return found and replace(found, fit=replace(found.fit, stopped=False))

    monkeypatch.setattr(fits_module, "fit_candidate", hopeful)
    monkeypatch.setattr(few_frames, "FEW_FRAMES", 4)
    fits = Fits(nominal, 6.0)
    fits.add_kinds([[(Hypothesis(PointMass(), NO_PLACE), np.array([0.8 * MASS[0], 0.68]))]])
    assert begun[0] is not nominal
    assert bool(fits.best_of) is kept
    if kept:
        (found,) = fits.best_of.values()
        assert found.values() == pytest.approx(MASS, rel=0.03)


def test_what_is_far_behind_on_few_frames_is_not_fitted_to_all(monkeypatch):
    """A weight beside a law that explains far more, though not all."""
    nominal, begun = concealed((PointMass(), MASS), seed=5), []
    hypothesis = Hypothesis(PointMass(), NO_PLACE)
    small = fit_candidate(nominal, hypothesis, np.array([0.5 * MASS[0], 0.68]), evaluations=2)
    assert small is not None
    assert gain_of(small) > 10

    def behind(current, *start, **more):
        begun.append(current)
        return replace(small, fit=replace(small.fit, stopped=False))

    monkeypatch.setattr(fits_module, "fit_candidate", behind)
    monkeypatch.setattr(few_frames, "FEW_FRAMES", 4)
    for lead, whole in ((1000.0, 0), (1.0, 1)):
        fits = Fits(nominal, 6.0)
        fits.best_of[("law", 0)] = replace(small, evidence=lead * gain_of(small))
        begun.clear()
        fits.add_kinds([[(hypothesis, small.values())]])
        assert sum(one is nominal for one in begun) == whole


def test_a_start_makes_the_misfit_smaller_where_it_can():
    """The sizes of the first order may be many times too large: then a fraction of them is."""
    nominal = concealed((PointMass(), MASS), seed=5)
    hypothesis = Hypothesis(PointMass(), NO_PLACE)
    mass = {}
    for multiple in (1.0, 2.4, 12.0):
        begun = settled_start(nominal, [(hypothesis, np.array([multiple * MASS[0], MASS[1]]))])
        assert begun is not None
        mass[multiple] = begun.terms[0].start[0] / MASS[0]
    assert mass[1.0] == pytest.approx(1.0)
    assert mass[2.4] == pytest.approx(0.96)
    assert mass[12.0] == pytest.approx(1.8)
