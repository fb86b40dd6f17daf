"""A rope that its nominal model does not describe: intervals carry what that model misses."""

from dataclasses import replace

import numpy as np

import ropefit
from benchmarks.accuracy.wrong_nominal import (
    ALWAYS,
    FREE,
    drawn,
    judged,
    named_falsely,
    recorded,
    true_effects,
)
from reference_simulators.planar_cable import Cable
from ropefit.adapters.priors import noise_of
from ropefit.adapters.rope_setup import STATIONS, base_setup, data_in_space, segments_of
from ropefit.artifacts import Model, Observations
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.candidates import fit_candidates
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.noise_measurement import on_edge
from ropefit.diagnosis.wander import with_what_is_missed_alike
from ropefit.diagnosis.with_accepted import EVALUATIONS
from ropefit.effects.point_mass import PointMass
from ropefit.fitting import equilibrium
from ropefit.fitting.nominal import (
    nominal_at_rest,
    nominal_terms,
    set_up_errors,
    with_what_is_missed,
)
from ropefit.fitting.settings import IdentifySettings
from ropefit.inference.least_squares import fit
from ropefit.inference.problem import FitProblem
from ropefit.runs.protocol import Context

SEED, SNAPPING = 101, 242


def weighed(o: Observations, source: Model) -> Candidate | None:
    """Return the weight as fitted to a recording of a rope that is known from another."""
    data, setup = data_in_space(o), base_setup(o, segments_of(o))
    noise = with_what_is_missed(noise_of(o, data), source)
    terms, setup = nominal_terms(o, source, setup, True, elsewhere=True, uneven=True)
    problem = FitProblem(data, noise, STATIONS)
    terms += set_up_errors(setup, o, None)
    nominal = nominal_at_rest(setup, terms, problem)
    firm = np.flatnonzero(~on_edge(nominal))  # others are excluded
    setup, problem = setup.frames(firm), problem.frames(firm)
    nominal = nominal_at_rest(setup, terms, problem)
    mass = float((setup.properties.density * setup.properties.length).sum())
    point, length = Hypothesis(PointMass(), NO_PLACE), float(setup.properties.length.sum())
    starts = [
        [(point, np.array([share * mass, place * length]))]
        for place in (0.95, 0.75)
        for share in (0.2, 0.45)
    ]
    found = fit_candidates(nominal, [], starts, [], 0.0)
    if not found:
        return None
    best = found[0]
    problem = problem.under(with_what_is_missed_alike(problem.noise, best.fit, []))
    again = fit(best.fit.forward, problem, best.fit.point.u, EVALUATIONS, tolerance=1e-5)
    return replace(best, fit=again)


def test_a_weight_is_within_an_interval_that_says_something(tmp_path):
    pair = drawn(np.random.default_rng(SEED))
    without, with_weight = (
        ropefit.preprocess(recorded(pair, weights, tmp_path / name, 2 * SEED + k))
        for k, (name, weights) in enumerate((("without", ()), ("with", (pair.weight,))))
    )
    source = ropefit.fit(without, free=FREE.split(","))
    found = weighed(with_weight, source)
    assert found is not None
    truth = np.array([pair.weight[1], pair.weight[0] * pair.cable.length])
    off, fitted = np.abs(found.values() - truth), found.fit
    assert fitted.misses
    assert (off < fitted.quantile * found.sd()).all()
    assert found.sd()[0] < 0.5 * truth[0]  # and says something


def test_a_fit_that_a_frame_about_to_snap_through_holds_is_told(tmp_path):
    pair = drawn(np.random.default_rng(SNAPPING))
    o = ropefit.preprocess(recorded(pair, (), tmp_path / "without", 2 * SNAPPING))
    said: list[str] = []
    settings = IdentifySettings.model_validate({"free": FREE.split(",")})
    equilibrium.compute(o, settings, Context(say=said.append))
    assert len(said) == 1
    assert "ended before its minimum" in said[0]
    assert "held by frames at the edge of stability: 21;" in said[0]


def test_what_is_named_instead_of_the_weight_counts_as_wrong_unless_it_ties():
    def row(verdict: str, *effects: dict) -> dict:
        answer = {"verdict": verdict, "effects": list(effects)}
        return {"mass": 0.2, "place_m": 0.5, "length_m": 0.6, "answer": answer}

    def effect(name: str, *others: str) -> dict:
        mass = {"mass": {"ci95": [0.15, 0.22]}}
        return {
            "name": name, "equivalent_to": list(others), "parameters": mass,
            "arc_length_m": [0.3, 0.49],
        }  # fmt: skip

    own = judged(row("found", effect("lost_out_of_plane"), effect("point_mass", "tether")))
    assert own["first"]
    assert own["mass holds"]
    assert not own["place holds"]
    tied = judged(row("found", effect("weight_error", "point_mass")))
    assert (tied["first"], tied["in the set"], tied["silent"]) == (False, True, False)
    other = judged(row("found", effect("weight_error")))
    assert (other["in the set"], other["silent"]) == (False, False)
    assert judged(row("unknown"))["silent"]


def test_an_effect_that_the_cable_does_not_have_is_named_falsely():
    def named(*effects: tuple[str, ...]) -> list[str]:
        own = [{"name": name, "equivalent_to": list(others)} for name, *others in effects]
        return named_falsely({"alone": {"effects": own}, "true_effects": ["kink", "bending_law"]})

    assert named(("force_field",), ("kink",)) == ["force_field"]
    assert named(("clamped_end", "kink"), ("bending_law", "force_field")) == []
    assert named() == named_falsely({"alone": None, "true_effects": []}) == []


def test_the_true_effects_are_those_of_the_cable():
    pair = drawn(np.random.default_rng(SEED))
    plain = Cable(0.5, 0.2, np.full(40, 1e-3), np.zeros(40))
    assert true_effects(replace(pair, cable=plain)) == ALWAYS
    rubbing = replace(plain, slip=1.0, rub=0.2, weights=((1.0, 0.01),))
    assert "bending_hysteresis" in true_effects(replace(pair, cable=rubbing))
    assert "point_mass" in true_effects(replace(pair, cable=rubbing))
    soft = replace(plain, soft=9.0, bend=np.linspace(1e-3, 2e-3, 40))
    assert {"bending_law", "soft_section"} <= true_effects(replace(pair, cable=soft))
