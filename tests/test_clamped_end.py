"""A clamp taken as a pin: found and told whether it yields or is rigid."""

from dataclasses import replace

import numpy as np
import pytest

from ropefit.adapters.diagnosis_content import sizes_of
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis, hypotheses
from ropefit.diagnosis.rules import RULES, Rules, Selection
from ropefit.diagnosis.scan import Projection, Scorer
from ropefit.diagnosis.search import search
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.effects import ClampedEnd
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration
from tests.concealed import BINS, nominal_fit, recorded, rope, with_effect

DIRECTION = np.array([0.86, 0.14, -0.49])
WAY = DIRECTION / np.linalg.norm(DIRECTION)


@pytest.mark.parametrize("end", [0, 1])
def test_the_scan_sees_what_a_soft_clamp_does(end):
    setup, effect, way = rope(72, 4), ClampedEnd(end), DIRECTION / np.linalg.norm(DIRECTION)
    point, soft = Equilibrium(setup, []).at(np.empty(0)), 1e-7
    x = point.solution.x
    parts = point.by_loads(1, lambda index: effect.unit_loads(setup, x[index], way))
    scanned = soft * np.concatenate([moved for _, moved in parts], axis=1)[0]
    changed = effect.apply(setup, np.array([soft, *way]))
    moved = Equilibrium(changed, [], point.solution).at(np.empty(0)).seen - point.seen
    assert np.abs(moved).max() > 1e-7
    # The clamp bends the rope half a segment away from where the load does.
    np.testing.assert_allclose(scanned, moved, atol=0.05 * np.abs(moved).max())


def compared(data):
    """The nominal fit to the data that all further fits have in common, with their white noise."""
    nominal = nominal_fit(data)
    problem = FitProblem(data.settled(nominal.point.seen), Noise(), BINS)
    white = problem.match(nominal.point.seen).scatter[0]
    problem = problem.under(Noise(white=(float(white[0]), float(white[1]))))
    return fit(nominal.forward, problem, nominal.point.u)


@pytest.mark.parametrize("stiffness", [0.004, 0.02, 1e6])
def test_soft_and_rigid_clamps_are_found(stiffness):
    nominal = compared(recorded(with_effect(ClampedEnd(1), [stiffness, *DIRECTION]), 101))
    setup = nominal.point.setup
    hypothesis = next(h for h in hypotheses(setup, ("clamped_end",)) if h.effect.end == 1)
    responses = Sensitivities(nominal)
    scorer = Scorer(responses.of(hypothesis), Projection(nominal), hypothesis.scales(setup))
    score = scorer(Projection(nominal).z)
    assert score.log_factor > 20
    starts = [np.concatenate(start) for start in score.starts()]
    fits = [fit_candidate(nominal, hypothesis, start) for start in starts]
    fitted = max((f for f in fits if f is not None), key=lambda f: f.evidence)
    refused = []
    assert Selection().acceptable([fitted], RULES.least_evidence, nominal, refused) is fitted
    sizes = sizes_of(fitted, fitted.values(), fitted.sd())
    low, high = sizes["stiffness"].ci95
    assert 0.9 * low < stiffness < 1.1 * high
    soft, stiff = sizes["compliance"].ci95
    assert soft <= 1 / high
    assert stiff == pytest.approx(1 / low, rel=1e-6)
    found = [sizes[f"direction_{axis}"] for axis in "xyz"]
    assert [one.value for one in found] == pytest.approx(WAY, abs=0.02)
    assert all(one.ci95[1] - one.ci95[0] < 0.1 for one in found)
    if stiffness == 1e6:  # at least so stiff, and not known any better
        assert 0.005 < low < 0.5
        assert high > 1e3


def test_the_length_of_a_direction_changes_nothing(monkeypatch):
    """Neither the evidence nor an interval, also where what the model misses widens these."""
    nominal = compared(recorded(with_effect(ClampedEnd(1), [0.02, *DIRECTION]), 101))
    setup = nominal.point.setup
    hypothesis = next(h for h in hypotheses(setup, ("clamped_end",)) if h.effect.end == 1)
    starts = [np.array([0.02, *(k * WAY)]) for k in (1.0, 1e4)]
    unit, long = (fit_candidate(nominal, hypothesis, start) for start in starts)
    assert long.evidence == pytest.approx(unit.evidence, abs=0.05)
    np.testing.assert_allclose(long.values(), unit.values(), rtol=1e-2, atol=1e-3)
    np.testing.assert_allclose(long.sd(), unit.sd(), rtol=0.02)
    found, far, many = unit.fit, unit.fit.point.u.copy(), 1e5
    assert np.linalg.norm(unit.term.value(far[-4:])[1:]) == pytest.approx(1.0)
    far[-3:] = unit.term.search(many * unit.term.value(far[-4:]))[1:]
    jacobian = found.jacobian.copy()
    jacobian[:, -3:] /= many
    same = replace(found, point=replace(found.point, u=far), jacobian=jacobian)
    for misses in (False, True):
        monkeypatch.setattr(type(found), "misses", property(lambda _, m=misses: m))
        one, other = (replace(unit, fit=replace(f)) for f in (found, same))
        assert np.isfinite(one.sd()).all()
        assert (one.sd() > 0).all()
        np.testing.assert_allclose(other.sd(), one.sd(), rtol=1e-6)


def test_an_infinite_stiffness_is_a_finite_search():
    hypothesis = next(iter(hypotheses(rope(20), ("clamped_end",))))
    term = hypothesis.term(rope(20), np.array([0.01, *DIRECTION]))
    for stiffness in (0.0, 1e-3, 0.01, 5.0, 1e6):
        value = np.array([stiffness, *DIRECTION])
        u = term.search(value)
        assert np.abs(u).max() < 2
        assert term.value(u) == pytest.approx(value, rel=1e-6)
        if stiffness < 10:
            step = np.array([1e-6, 0, 0, 0])
            slope = (term.value(u + step) - term.value(u - step)) / 2e-6
            assert slope[0] == pytest.approx(term.slope(u)[0], rel=1e-3)
    _, high = Equilibrium(rope(20), [term]).bounds()
    assert np.isfinite(high[0])
    assert np.isfinite(term.value(np.array([high[0], 0, 0, 0]))).all()


@pytest.mark.parametrize("tilted", [False, True])
def test_ends_that_are_seen_are_no_clamps(tilted):
    """Where the ends lie as a picture shows them, off by some points' noise in every frame and by
    a piece that is hidden in all of them, a clamp is not accepted; a real one still is."""
    setup = rope(288)
    real = with_effect(ClampedEnd(1), [0.02, *DIRECTION]) if tilted else setup
    data = recorded(real, 107, sd=0.002)
    rng = np.random.default_rng(107)
    off = 0.004 * rng.normal(size=(1, 2, 3)) + 0.002 * rng.normal(size=(12, 2, 3))
    coarse = rope(144, bend=3e-4)
    coarse = coarse._replace(ends=coarse.ends + off)
    terms = [PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0)), PARAMETERS["length"].term(coarse)]
    nuisances = calibration(coarse, Priors(end_position=0.005), True)
    nominal = fit(Equilibrium(coarse, [*terms, *nuisances]), FitProblem(data, Noise(), BINS))
    found = search(nominal, 0, lambda share, text: None, Rules(effects=("clamped_end",)))
    named = [one.candidate.hypothesis.name for one in found.accepted]
    assert named == (["clamped_end"] if tilted else [])


def test_a_direction_of_any_length_is_a_start():
    """Only the stiffness saturates: a component of minus its usual size is no infinite value."""
    setup, effect = rope(20), ClampedEnd(1)
    usual = np.array([q.size(setup) for q in effect.quantities])
    start = np.array([2.0, -1.0, 1.0, -1.0]) * usual
    term = Hypothesis(effect, NO_PLACE).term(setup, start)
    np.testing.assert_allclose(term.value(np.zeros(4)), start)
    np.testing.assert_allclose(term.search(start), 0, atol=1e-12)
