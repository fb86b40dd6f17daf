"""The rope as another recording of it knows it: values and how they hang together."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ropefit
from benchmarks.accuracy.wrong_nominal import FREE, drawn
from benchmarks.accuracy.wrong_nominal import recorded as recorded_pair
from ropefit.adapters.settings import DiagnoseSettings
from ropefit.artifacts import Observations
from ropefit.fitting import handed_on
from ropefit.fitting.handed_on import HANDLING_SD, LOOSER, known_together
from ropefit.fitting.posed import KnownRope, Posed, posed
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models import rest_curve
from ropefit.models.correlated import correlated
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.models.priors import Priors, calibration
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup
from tests.concealed import BINS, recorded
from tests.test_off_axis import held

BENDS = list(rest_curve.VARYING[:3])
SETTINGS = DiagnoseSettings(nominal=True)
EI = 1.6e-3  # as it was told: 0.8 of what it is
KNOWN = np.array([[1.0, 0.3, 0.0], [0.3, 1.0, -0.5], [0.0, -0.5, 1.0]])  # (1/m)²


def cable(segments: int) -> Setup:
    """Its base is held: only so does a rest curve have directions."""
    return held(12, segments)


def own_terms(turned: bool = False) -> list[Term]:
    """A rigidity, known to a half, and three points of a rest curve; turned: the same, searched
    along other axes."""
    setup = cable(72)
    rigid = replace(PARAMETERS["EI"].term(setup, EI), prior=np.array([0.5]))
    bends = [PARAMETERS[name].term(setup, 0.1) for name in BENDS]
    curve = correlated(rest_curve.SHORT, bends, KNOWN, rest_curve.apply(*BENDS))
    if turned:
        axes = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
        curve = replace(curve, root=curve.root @ axes)
    return [rigid, curve]


def fitted(own: list[Term], seed: int) -> Fit:
    data, setup = recorded(cable(144), seed=seed), cable(72)
    forward = Equilibrium(setup, [*own, *calibration(setup, Priors(), False)])
    return fit(forward, FitProblem(data, Noise(), BINS))


@pytest.fixture(scope="module")
def control() -> Fit:
    return fitted(own_terms(), seed=1)


def values_and_covariance(found: Fit, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The values in SI of a fit's first terms, EI as a logarithm, and their covariance."""
    rigid, curve = found.forward.terms[:2]
    first, second = found.forward.split(found.point.u)[:2]
    slope = np.eye(size)
    slope[1:, 1:] = curve.root
    covariance = slope @ found.covariance[:size, :size] @ slope.T
    return np.concatenate([np.log(rigid.value(first)), curve.value(second)]), covariance


@pytest.mark.parametrize("turned", [False, True])
def test_values_and_their_covariance_are_those_of_the_other_recording(control, turned):
    known = known_together(own_terms(turned), control)
    rigid, curve = known
    values, covariance = values_and_covariance(control, 4)
    assert np.log(rigid.start[0]) == pytest.approx(values[0])
    np.testing.assert_allclose(curve.start, values[1:], atol=1e-9)
    slope = np.eye(4)
    slope[1:, 1:] = curve.root
    joint, place = rigid.joint
    assert (curve.joint[0], place, curve.joint[1]) == (joint, 0, 1)
    told = slope @ joint.covariance @ slope.T
    told[0, 0] -= HANDLING_SD**2
    # Looser by what was known there beforehand, which is from the same data.
    loose = np.linalg.inv(covariance)
    loose[0, 0] -= (1 - LOOSER**-2) / 0.5**2
    loose[1:, 1:] -= (1 - LOOSER**-2) * np.linalg.inv(KNOWN)
    np.testing.assert_allclose(told, np.linalg.inv(loose), rtol=1e-6, atol=1e-12)
    prior = Equilibrium(cable(72), known).prior()
    np.testing.assert_allclose(prior.sd, np.sqrt(np.diag(joint.covariance)))


def test_two_recordings_tell_as_much_as_both_together(control, monkeypatch):
    """One after the other, where handling changes nothing."""
    monkeypatch.setattr(handed_on, "HANDLING_SD", 0.0)
    alone = fitted(own_terms(), seed=2)
    after = fitted(known_together(own_terms(), control), seed=2)
    (a, ca), (b, cb), (both, cboth) = (
        values_and_covariance(one, 4) for one in (control, alone, after)
    )
    before = np.zeros((4, 4))
    before[0, 0], before[1:, 1:] = 0.5**-2, np.linalg.inv(KNOWN)
    mean = np.concatenate([[np.log(EI)], np.full(3, 0.1)])
    first = np.linalg.inv(ca) - (1 - LOOSER**-2) * before
    second = np.linalg.inv(cb)
    wanted = np.linalg.solve(first + second - before, first @ a + second @ b - before @ mean)
    sd = np.sqrt(np.diag(np.linalg.inv(first + second - before)))
    np.testing.assert_allclose(np.sqrt(np.diag(cboth)), sd, rtol=0.1)
    assert (np.abs(both - wanted) < 0.6 * sd).all()  # points are matched to another shape
    assert (sd < 0.9 * np.sqrt(np.diag(ca))).all()


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> tuple[Observations, KnownRope, Posed, Fit]:
    """A cable with a weight; the cable as it is known without, as a problem, and its fit."""
    folder, pair = tmp_path_factory.mktemp("pair"), drawn(np.random.default_rng(101))
    without, with_weight = (
        ropefit.preprocess(recorded_pair(pair, weights, folder / name, 202 + k))
        for k, (name, weights) in enumerate((("without", ()), ("with", (pair.weight,))))
    )
    rope = KnownRope(ropefit.fit(without, free=FREE.split(",")), elsewhere=True)
    there = posed(without, rope, SETTINGS)
    return with_weight, rope, there, there.fitted()


def joined(problem: Posed) -> set[str]:
    return {term.name for term in problem.terms if term.joint is not None}


def test_the_rope_and_its_markers_are_handed_on_and_what_holds_it_is_not(pair):
    o, rope, there, control = pair
    here = posed(o, rope, SETTINGS, control=control)
    assert joined(here) == {"EI", rest_curve.SHORT, "rigidity", "off_axis"}
    assert [t.name for t in here.terms] == [t.name for t in there.terms]
    assert joined(there) == set()


def test_what_is_known_elsewhere_misleads_by_what_its_model_misses(pair):
    """Also where that is little more than noise; by noise alone intervals are narrower."""
    o, rope, _, control = pair
    found = posed(o, rope, SETTINGS, control=control).fitted()
    assert found.known_elsewhere
    assert not control.known_elsewhere
    sensor = found.problem.noise.marker / 1.2
    known = replace(found.problem, noise=replace(found.problem.noise, sensor=sensor))
    little = replace(found, problem=known, z=found.z / found.scale, spread=1.0)
    assert not little.misses
    ratio = little.sd() / np.sqrt(np.diag(little.by_noise))
    assert ratio.max() > 1.5
    nothing = replace(little, problem=replace(known, noise=replace(known.noise, sensor=1.0)))
    assert nothing.sd() == pytest.approx(np.sqrt(np.diag(nothing.by_noise)), rel=1e-6)
    assert (nothing.sd() <= little.sd() + 1e-12).all()


def test_the_noise_of_the_other_recording_is_no_more_than_neighbouring_poses_repeat(pair):
    """What is measured beside a wrong nominal model is in part what that misses."""
    o, rope, _, _ = pair
    told: Any = SimpleNamespace(noise_white=2.4e-3, noise_repeated=1.1e-3, known={}, causes={})
    there = replace(rope, found=told)
    assert posed(o, there, SETTINGS).problem.noise.sensor == pytest.approx(1.1e-3 / 3**0.5)
    told.noise_repeated = None
    own = posed(o, replace(rope, found=None), SETTINGS).problem.noise.sensor
    wanted = min(2.4e-3 / 3**0.5, own)
    assert posed(o, there, SETTINGS).problem.noise.sensor == pytest.approx(wanted)


def test_offsets_of_markers_elsewhere_on_the_rope_are_their_own(pair):
    o, rope, _, control = pair
    moved = o.model_copy(update={"point_arc": 0.9 * o.point_arc})
    here = posed(moved, rope, SETTINGS, control=control)
    assert joined(here) == {"EI", rest_curve.SHORT, "rigidity"}
    assert "off_axis" in {term.name for term in here.terms}


def test_a_term_that_the_other_recording_has_not_stays_as_it_is(control):
    setup = cable(72)
    other = PARAMETERS["length"].term(setup)
    rigid, length = known_together([own_terms()[0], other], control)
    assert length is other
    assert rigid.joint is not None
    assert known_together([other], control) == [other]
