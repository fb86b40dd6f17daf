"""The diagnosis on recordings with a concealed effect: found where it is, and as large."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ropefit.adapters.equilibrium_model import calibration_name
from ropefit.artifacts.model import Calibration
from ropefit.diagnosis.acceptance import agreeing
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.confounding import confounded
from ropefit.diagnosis.held_out import firm_rows, heldout_rms, predicted
from ropefit.diagnosis.hypotheses import hypotheses
from ropefit.diagnosis.latent_force import latent_force
from ropefit.diagnosis.noise_measurement import on_edge
from ropefit.diagnosis.proposals import misfit_of
from ropefit.diagnosis.reassessment import reassessed
from ropefit.diagnosis.regions import misfit, regions
from ropefit.diagnosis.rules import RULES, Selection
from ropefit.diagnosis.scan import Projection, Scorer, null_residuals
from ropefit.diagnosis.search import search
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.diagnosis.stretches import most_significant, significant_interval
from ropefit.effects import (
    FreeCurvature,
    FreeKink,
    GravityMisalignment,
    PointMass,
    StiffSection,
    SupportPlane,
)
from ropefit.effects.place import middle_of
from ropefit.errors import WrongUsage
from ropefit.fitting.nominal import calibrated
from ropefit.inference.bins import Data, match
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare
from tests.concealed import BINS, EYE, nominal_fit, recorded, rope, with_effect


def diagnosed(data):
    return search(nominal_fit(data), 0, lambda share, text: None)


def test_a_clean_recording_is_called_none():
    d = diagnosed(recorded(rope(288), seed=3))
    assert d.verdict == "none"
    assert not d.accepted
    before, noise = heldout_rms(d.final)
    assert 0.95 * noise < before < 1.1 * noise
    assert 1e-5 < d.detectable["point_mass"] < 2e-3  # kg


@pytest.mark.parametrize(
    ("effect", "values", "place"),
    [
        (PointMass(), [0.002, 0.37], 0.37),
        (StiffSection(), [0.5, 0.5, 0.2], 0.5),
        (FreeKink(), [0.15, -5.1, 0.42], 0.42),
    ],
)
def test_an_effect_is_found_where_it_is(effect, values, place):
    d = diagnosed(recorded(with_effect(effect, values), seed=1))
    assert d.verdict == "found"
    names = [
        d.accepted[0].candidate.hypothesis.name,
        *(r.hypothesis.name for r in d.accepted[0].equivalent),
    ]
    assert effect.name in names
    candidate = next(
        r
        for r in (d.accepted[0].candidate, *d.accepted[0].equivalent)
        if r.hypothesis.name == effect.name
    )
    found, sd = candidate.values(), candidate.sd()
    where = candidate.term.names.index(effect.place_names[0])
    assert found[where] == pytest.approx(place, abs=0.03)
    assert abs(found[0] - values[0]) < 4 * sd[0] + 0.02 * values[0]
    assert heldout_rms(d.final)[0] < heldout_rms(d.nominal)[0]


def test_a_plane_touched_in_two_neighbouring_frames_is_found():
    """Neither of these frames tells what the other would look like."""
    setup = rope(288)
    lowest = Equilibrium(setup, []).at(np.empty(0)).seen[..., 2].min(axis=1)
    order = np.argsort(lowest)
    assert abs(order[0] - order[1]) == 1
    height = 0.75 * lowest[order[1]] + 0.25 * lowest[order[2]] - float(middle_of(setup)[2])
    d = diagnosed(recorded(with_effect(SupportPlane(), [height, 0.0, 0.0]), seed=5))
    assert d.verdict == "found"
    found = [r for f in d.accepted for r in (f.candidate, *f.equivalent)]
    candidate = next(r for r in found if r.hypothesis.name == "support_plane")
    assert abs(candidate.values()[0] - height) < 0.005
    assert len(d.accepted) == 1


def test_the_scan_starts_at_the_optimum_and_not_at_bounds():
    """Where a search stops short, what it left would pass for an effect that the model has."""
    best = nominal_fit(recorded(rope(288), seed=3))
    at = best.point.u.copy()
    short = replace(best, z=best.z + 0.5 * best.jacobian[:, 0])
    assert np.linalg.norm(short.z) > np.linalg.norm(best.z) + 1
    reached = Projection(short).z
    assert reached == pytest.approx(Projection(best).z, abs=1e-6 * np.linalg.norm(best.z))
    low, _ = best.forward.bounds()
    at[0] = low[0]
    held = Projection(replace(best, point=replace(best.point, u=at)))
    assert not held.jacobian[:, 0].any()
    assert held.jacobian[:, 1].any()


def test_an_error_of_the_set_up_is_named_before_physics():
    d = diagnosed(recorded(with_effect(GravityMisalignment(), [0.03, -0.03]), seed=2))
    assert d.verdict == "found"
    assert d.accepted[0].candidate.hypothesis.effect.kind == "measurement"


@pytest.mark.parametrize(
    ("axes", "seen"), [([0, 2, 1], False), ([2, 1, 0], True), (None, True)], ids=["y", "x", "up"]
)
def test_gravity_stated_along_another_axis_is_found(axes, seen):
    """As of clouds in a camera's axes, y down, taken as z up; no force, no contact is named."""
    nominal = confused_axes(axes, seen)
    d = search(nominal, 0, lambda share, text: None)
    assert d.verdict == "found"
    (one,) = d.accepted
    assert one.candidate.hypothesis.name == "gravity_misalignment"
    down = d.final.point.setup.gravity
    assert float(down @ rope(96, 8).gravity) > 9.81**2 * np.cos(0.02)
    assert d.threshold < 20  # of clean recordings, however far off the nominal model is
    assert d.nominal.z.size > 300  # of some 460 rows: data are not lost where the model is far off
    assert heldout_rms(d.nominal)[0] < 2


def confused_axes(axes=(0, 2, 1), seen=False) -> Fit:
    """The nominal fit of a rope whose gravity is stated 90 degrees away, or upwards; seen: its ends
    are read off the data."""
    setup = rope(96, 8)
    gravity = -setup.gravity if axes is None else setup.gravity[list(axes)]
    coarse = rope(48, 8)._replace(gravity=gravity)
    terms = [PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0))]
    priors = Priors(end_position=0.005) if seen else Priors()
    errors = calibration(coarse, priors, seen, surface=0.0014 * seen)
    forward = Equilibrium(coarse, [*terms, *errors])
    return fit(forward, FitProblem(recorded(setup), Noise(), BINS))


def test_gravity_is_proposed_from_the_stated_ends():
    """Ends that are read off the data are moved far by a fit that finds no other way."""
    misfit = misfit_of(confused_axes())
    (expected,) = GravityMisalignment().starts(misfit)
    ends = misfit.setup.ends + np.array([0.0, -0.3, 0.3])
    (proposed,) = GravityMisalignment().starts(
        replace(misfit, setup=misfit.setup._replace(ends=ends))
    )
    assert proposed[0] == pytest.approx(expected[0])
    assert np.linalg.norm(proposed[0]) == pytest.approx(np.pi / 2, abs=0.2)


def test_the_null_is_what_noise_gives():
    data = recorded(rope(288), seed=5)
    found = nominal_fit(data)
    project = Projection(found)
    null = null_residuals(found, project, 60, np.random.default_rng(0))
    assert np.std(null) == pytest.approx(1.0, abs=0.05)
    responses = Sensitivities(found)
    hypothesis = next(f for f in hypotheses(found.point.setup) if f.name == "point_mass")
    scorer = Scorer(responses.of(hypothesis), project, hypothesis.scales(found.point.setup))
    factors = scorer.averaged(null)
    # A Bayes factor exceeds x with probability 1/x at most where there is nothing.
    assert (factors > 3).mean() < 0.1
    assert np.median(factors) < 0
    latent = latent_force(found, project)
    assert latent.evidence < np.quantile(latent.null(null), 0.99) + 10


def test_a_left_out_block_is_predicted_not_fitted():
    found = nominal_fit(recorded(rope(288), seed=6))
    assert (predicted(found) ** 2).sum() > (found.z**2).sum()


def test_a_hanging_rope_does_not_pass_for_a_heavier_one():
    found = nominal_fit(recorded(rope(20)))
    responses = Sensitivities(found)
    setup = found.point.setup
    masses = [responses.of(f) for f in hypotheses(setup) if f.name == "point_mass"]
    assert masses
    assert confounded(found, masses) == []


def test_the_mismatch_is_located():
    data = recorded(with_effect(PointMass(), [0.004, 0.37]), seed=4)
    found = regions(nominal_fit(data), BINS)
    assert found
    assert any(low <= 0.37 <= high for low, high in (r.arc for r in found))


def test_the_mismatch_of_markers_is_located():
    """More of them than stations of a cloud, and in no order."""
    nodes = np.random.default_rng(1).permutation(np.arange(6, 282, 4))
    seen = Equilibrium(with_effect(PointMass(), [0.01, 0.37]), []).at(np.empty(0)).seen[:, nodes]
    share = np.tile(nodes / 288, (len(seen), 1))
    data = Data(seen, share, np.ones(share.shape, bool), True, np.array(EYE))
    setup = rope(144)
    found = fit(Equilibrium(setup, []), FitProblem(data, Noise(marker=1e-3), BINS))
    assert misfit(found, BINS).shape == (len(seen), BINS, 3)
    low, high = regions(found, BINS)[0].arc
    assert low <= 0.37 <= high
    assert np.nanmax(np.abs(misfit(found, BINS))) == pytest.approx(
        np.abs(found.stations.residual).max(), rel=0.3
    )


def about_to_fall_over(frames: int, above: float) -> tuple[Setup, Data]:
    """A rope that is held upright in its first frame, and hangs at some angles in the others; a
    little stiffer than one that falls over."""
    length, density, gravity = 0.5, 0.06, 9.81
    # Held upright at its lower end, a rope falls over where weight L³ / EI passes 7.837.
    bend = above * density * gravity * length**3 / 7.837  # Greenhill
    made = uniform(length=length, segments=60, bend=bend, density=density)
    ends = np.zeros((frames, 2, 3))
    ends[:, 1] = np.nan
    clamp = np.full((frames, 2, 4), np.nan)
    half = 0.5 * np.concatenate([[0.0], np.pi - np.radians(20.0 * np.arange(frames - 1))])
    clamp[:, 0] = np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], axis=1)
    setup = bare(made, np.array([0.0, 0.0, -gravity]), ends, clamp, np.array(EYE))
    seen = Equilibrium(setup, []).at(np.empty(0)).seen
    share = np.tile(np.linspace(0, 1, seen.shape[1]), (frames, 1))
    return setup, Data(seen, share, np.ones(share.shape, bool), True, np.array(EYE))


def test_a_rope_about_to_fall_over_is_on_the_edge():
    setup, data = about_to_fall_over(2, 1.02)
    found = fit(Equilibrium(setup, []), FitProblem(data, Noise(marker=1e-3), BINS))
    assert on_edge(found).tolist() == [True, False]


def test_frames_at_the_edge_of_stability_are_not_predicted():
    """To first order they would be missed by more than the rope is long."""
    setup, data = about_to_fall_over(6, 1.0002)
    noisy = data.points + np.random.default_rng(0).normal(0, 1e-3, data.points.shape)
    problem = FitProblem(replace(data, points=noisy), Noise(marker=1e-3), BINS)
    bend = float(setup.properties.bend.mean())
    term = PARAMETERS["EI"].term(setup, bend)
    tilts = [t for t in calibration(setup, Priors(), False) if t.name.startswith("gravity")]
    forward = Equilibrium(setup, [term, *tilts])
    found = fit(forward, problem)
    assert on_edge(found).tolist() == [True] + [False] * 5
    firm = firm_rows(found)
    edge = found.stations.frame == 0
    assert (firm == np.repeat(~edge, 3)).all()
    out = predicted(found)
    assert (out[~firm] == 0).all()
    # The others as from a fit without that frame, to first order.
    rest = np.arange(1, 6)
    alone = fit(
        Equilibrium(setup.frames(rest), forward.terms), problem.frames(rest), found.point.u, 1
    )
    np.testing.assert_allclose(found.z[firm], alone.z, atol=1e-6)
    assert heldout_rms(found, False, firm)[0] < 3e-3
    assert np.abs(out).max() < 10.0


@pytest.mark.parametrize(
    ("gains", "supported"),
    [
        ([-0.5, -0.8, 4.1, 124.9, 207.4], True),  # a plane touched in the last frames
        ([5.0, 4.0, 6.0, 3.0, 5.0], True),
        ([60.0, -0.2, 0.1, -0.3, 0.0], False),  # one block's own
        ([7.0, 5.1, -1.9, 6.2, -2.8], True),  # barely visible
        ([60.0, 20.0, -22.0, -8.0, 0.0], False),
        ([2.0, 2.0, 0.0, 0.0, -9.0], False),
    ],
)
def test_held_out_blocks_support_an_effect(gains, supported):
    assert agreeing(np.array(gains)) is supported


@pytest.mark.parametrize(
    ("gains", "supported"),
    [
        ([-0.9, -0.3, -0.2, 0.9, 4.8], True),
        ([0.6, 0.7, 0.0, 0.1, -0.1], False),  # too little together
        ([-0.9, -0.3, -0.2, 0.4, 5.8], False),  # one block's own
        ([-0.9, -0.9, -0.2, 0.9, 4.8], False),
    ],
)
def test_blocks_of_few_independent_samples_gain_less_each(gains, supported):
    assert agreeing(np.array(gains), alike=True) is supported
    assert not agreeing(np.array(gains))


def test_a_softer_rope_passes_for_a_heavier_tip():
    length, frames = 0.6, 5
    made = uniform(length=length, segments=60, bend=0.02, density=0.05)
    ends = np.zeros((frames, 2, 3))
    ends[:, 1] = np.nan
    clamp = np.full((frames, 2, 4), np.nan)
    for t, tilt in enumerate(np.radians([70, 80, 90, 100, 110])):  # of the tangent to the vertical
        half = np.array([np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0])
        clamp[t, 0] = half
    down = np.array([0.0, 0.0, -9.81])
    setup = bare(made, down, ends, clamp, np.array(EYE))
    seen = Equilibrium(setup, []).at(np.empty(0)).seen
    share = np.tile(np.linspace(0, 1, seen.shape[1]), (frames, 1))
    data = Data(seen, share, np.ones(share.shape, bool), True, np.array(EYE))
    term = PARAMETERS["EI"].within(Range(0.02, 1e-5, 10.0))
    found = fit(Equilibrium(setup, [term]), FitProblem(data, Noise(marker=1e-4), BINS))
    responses = Sensitivities(found)
    said = confounded(found, [responses.of(f) for f in hypotheses(setup) if f.name == "point_mass"])
    assert len(said) == 1
    assert "--nominal" in said[0]


def test_another_runs_calibration_is_taken_with_its_own_uncertainty():
    errors = calibration(rope(20), Priors(), False)
    known = {
        calibration_name(t, axis): Calibration(unit="", prior=1.0, value=0.001, sd=1e-5)
        for t in errors
        for axis in t.names
    }
    model = SimpleNamespace(nominal=SimpleNamespace(balance=SimpleNamespace(calibration=known)))
    for before, after in zip(errors, calibrated(errors, model), strict=True):
        if before.name.startswith("end_"):
            assert after is before
        else:
            assert (after.start == 0.001).all()
            assert (after.prior < before.prior).all()
            np.testing.assert_allclose(after.value(np.zeros(after.size)), 0.001)
    with pytest.raises(WrongUsage, match="--calibration"):
        calibrated(errors, SimpleNamespace(nominal=SimpleNamespace(balance=None)))


def test_a_model_that_was_stuck_begins_anew():
    """What a further effect gains by moving the others is no evidence for it."""
    data = recorded(rope(288), seed=3)
    best = nominal_fit(data)
    data = data.settled(best.point.seen)
    white = match(data, best.point.seen, BINS).scatter[0]
    noise = Noise(white=(float(white[0]), float(white[1])))
    best = fit(best.forward, FitProblem(data, noise, BINS), best.point.u)
    stuck = best.point.u.copy()
    stuck[0] += 1.0  # the logarithm of EI
    stuck = fit(best.forward, FitProblem(data, noise, BINS), stuck, 1)
    assert stuck.cost > best.cost + 100
    wild = SimpleNamespace(fit=best, evidence=0.5 * (stuck.cost - best.cost))
    share = RULES.restart_share
    again = Selection().restarted(stuck, wild, share)  # type: ignore[arg-type]
    assert again is not None
    assert again.cost == pytest.approx(best.cost, abs=0.5)
    assert Selection().restarted(best, wild, share) is None  # type: ignore[arg-type]


def test_the_stretch_is_read_from_sizes_along_the_rope():
    rng = np.random.default_rng(2)
    sd = np.full((10, 2), 0.2)
    values = 0.2 * rng.normal(size=sd.shape)
    values[3:7] += [1.0, -0.5]
    first, last, sizes = most_significant(values, 1 / sd**2)
    assert (first, last) == (3, 7)
    assert sizes == pytest.approx([1.0, -0.5], abs=0.3)


def test_a_wide_stretch_is_fitted_from_its_profile():
    """A scan of narrower stretches leads into a part of it."""
    data = recorded(with_effect(FreeCurvature(), [2.5, 0.45, 0.6]), seed=4)
    nominal = nominal_fit(data)
    hypothesis = next(f for f in hypotheses(nominal.point.setup) if f.name == "intrinsic_curvature")
    start = significant_interval(nominal, hypothesis)
    assert start is not None
    assert start[-2:] == pytest.approx([0.45, 0.6], abs=0.11)


def test_effects_are_weighed_again_beside_a_later_one():
    """One that stood for two gives way to what is right; one with nothing to explain goes."""
    effects = [(StiffSection(), [0.5, 0.6, 0.2]), (PointMass(), [0.003, 0.25])]
    setup = rope(288)
    for effect, values in effects:
        setup = effect.apply(setup, np.array(values))
    data = recorded(setup, seed=5)
    nominal = nominal_fit(data)
    data = data.settled(nominal.point.seen)
    white = match(data, nominal.point.seen, BINS).scatter[0]
    noise = Noise(white=(float(white[0]), float(white[1])))
    nominal = fit(nominal.forward, FitProblem(data, noise, BINS), nominal.point.u)
    known = {f.name: f for f in hypotheses(nominal.point.setup)}

    def on(smaller, name, values):
        return fit_candidate(smaller, known[name], np.array(values))

    stiff = on(nominal, "stiff_section", [0.5, 0.6, 0.2])
    other = on(nominal, "intrinsic_curvature", [0.3, 0.6, 0.2])
    mass = on(other.fit, "point_mass", [0.003, 0.25])
    same_in_another_order(replace(other, fit=mass.fit))
    named = [
        Accepted(other, [], other.evidence, 0.0, [stiff]),
        Accepted(mass, [], mass.evidence, 0.0),
    ]
    fitted, kept = reassessed(mass.fit, named, 5.0, 20)
    assert [one.candidate.hypothesis.name for one in kept] == ["stiff_section", "point_mass"]
    assert fitted.cost < mass.fit.cost - 10
    assert kept[1].candidate.values()[0] == pytest.approx(0.003, rel=0.2)

    idle = on(stiff.fit, "kink", [0.01, -5.1, 0.8])
    mass = on(idle.fit, "point_mass", [0.003, 0.25])
    named = [Accepted(one, [], one.evidence, 0.0) for one in (stiff, idle, mass)]
    fitted, kept = reassessed(mass.fit, named, 5.0, 20)
    assert [one.candidate.hypothesis.name for one in kept] == ["stiff_section", "point_mass"]
    assert fitted.cost == pytest.approx(mass.fit.cost, abs=10)


def same_in_another_order(candidate):
    """Its size and error do not depend on whether another effect was added after it."""
    forward, u = candidate.fit.forward, candidate.fit.point.u
    parts = list(zip(forward.terms, forward.split(u), strict=True))
    parts.sort(key=lambda part: part[0] is candidate.term)
    terms = [term for term, _ in parts]
    moved = Equilibrium(forward.base, terms, candidate.fit.point.solution)
    # Both to their minimum, however flat the valley is that the candidate was left in.
    candidate = replace(candidate, fit=fit(forward, candidate.fit.problem, u, 20))
    again = fit(moved, candidate.fit.problem, np.concatenate([part for _, part in parts]), 20)
    assert terms[-1] is not forward.terms[-1]
    assert candidate.magnitude() == pytest.approx(
        replace(candidate, fit=again).magnitude(), rel=0.01
    )
