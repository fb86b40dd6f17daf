"""Candidates that are fitted from the rope as another recording tells it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ropefit
from benchmarks.accuracy.wrong_nominal import FREE, Pair, drawn, recorded
from reference_simulators.planar_cable import Cable
from ropefit.adapters.settings import DiagnoseSettings
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.known_rope import from_known_rope
from ropefit.diagnosis.noise_measurement import on_edge
from ropefit.effects import PointMass
from ropefit.fitting.posed import KnownRope, posed
from ropefit.inference.least_squares import Fit, attempted

SEED, NEEDED, THIN = 274, 6.0, 1e-4


def bare(pair: Pair, even: bool) -> Pair:
    """The same without friction and fittings, on a base as told; even: straight and uniform."""
    cable, zero = pair.cable, np.zeros_like(pair.cable.bend)
    bend, rest = (zero + cable.bend.mean(), zero) if even else (cable.bend, cable.rest)
    return replace(pair, cable=Cable(cable.length, cable.mass, bend, rest), bases=pair.told)


def known(pair: Pair, folder: Path) -> list[Fit]:
    """The nominal fits to recordings without and with the weight, known from the first."""
    every = [
        ropefit.preprocess(recorded(pair, weights, folder / f"{k}", 2 * SEED + k)).model_copy(
            update={"diameter": THIN}  # markers on its surface: next to none off the axis
        )
        for k, weights in enumerate(((), (pair.weight,)))
    ]
    rope = KnownRope(ropefit.fit(every[0], free=FREE.split(",")), elsewhere=True)
    out: list[Fit] = []
    for o in every:
        control = out[0] if out else None
        problem = posed(o, rope, DiagnoseSettings(nominal=True), control=control)
        first = problem.fitted()
        edge = on_edge(first)
        out.append(problem.without(edge).fitted() if edge.any() else first)
    return out


@pytest.fixture(scope="module")
def fits(tmp_path_factory):
    return known(bare(drawn(np.random.default_rng(SEED)), even=True), tmp_path_factory.mktemp("a"))


def test_a_weight_is_found_from_the_rope_as_known(fits):
    pair = drawn(np.random.default_rng(SEED))
    (found,) = from_known_rope(fits[1], NEEDED, ("point_mass",))
    truth = np.array([pair.weight[1], pair.weight[0] * pair.cable.length])
    assert found.evidence > 10 * NEEDED
    assert (np.abs(found.values() - truth) < 3 * found.sd()).all()
    assert (found.sd() < 0.1 * truth).all()


def test_fits_from_a_rope_that_gave_way_end_before(tmp_path):
    pair = bare(drawn(np.random.default_rng(SEED)), even=False)
    nominal = known(pair, tmp_path)[1]
    (found,) = from_known_rope(nominal, NEEDED, ("point_mass",))
    usual = fit_candidate(nominal, Hypothesis(PointMass(), NO_PLACE), found.values() / [3, 1])
    assert usual is None or usual.fit.cost > found.fit.cost + 10 * NEEDED
    assert found.fit.left_to_gain < 1.0


def test_nothing_is_proposed_where_the_rope_as_known_explains_as_much(fits):
    assert from_known_rope(fits[0], NEEDED, ("point_mass",)) == []


def test_a_rope_that_is_not_known_is_no_start(fits):
    nominal = fits[1]
    terms = [
        replace(t, prior=np.full(t.size, np.inf)) if t.name == "EI" else t
        for t in nominal.forward.terms
    ]
    forward = nominal.forward.with_terms(terms, nominal.point.solution)
    free = attempted(forward, nominal.problem, nominal.point.u, 2, 1e-5)
    assert free is not None
    assert from_known_rope(free, NEEDED, ("point_mass",)) == []
