"""A rest curve as parameters: what it does to the rope, and that identify finds it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ropefit.adapters.frames import calmest
from ropefit.diagnosis.accepted import accept
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.effects import IntrinsicCurvature, RestShape
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models import rest_curve
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.quaternion import director, multiply
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Motion, bare
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve
from tests.concealed import BINS, recorded

LENGTH, EI, MASS, CURVATURE = 0.6, 0.1, 0.6, 1.5
DOWN = np.array([0.0, 0.0, -9.81])


def setup_of(curvature: float = 0.0, segments: int = 40, frames: int = 9):
    """A cantilever at several angles."""
    p = uniform(
        length=LENGTH, segments=segments, bend=EI, density=MASS / LENGTH,
        curvature=(0.0, curvature, 0.0),
    )  # fmt: skip
    ends = np.full((frames, 2, 3), np.nan)
    clamp = np.full((frames, 2, 4), np.nan)
    ends[:, 0] = 0.0
    angle = np.linspace(-1.2, 1.2, frames)
    way = np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], -1)
    level = quaternion_along(np.array([0.0, 0, -1]))
    # All turned about one axis across, so that the clamp holds the same side of the rope.
    turn = np.stack([np.cos(angle / 2), 0 * angle, -np.sin(angle / 2), 0 * angle], -1)
    clamp[:, 0] = multiply(turn, level)
    np.testing.assert_allclose(director(clamp[:, 0]), way, atol=1e-12)
    return bare(p, DOWN, ends, clamp, np.array([0.0, -2.0, 0.0]))


def test_places_add_up_to_a_uniform_curvature():
    one = np.ones(1)
    varied = setup_of()
    for name in rest_curve.VARYING[: len(rest_curve.QUARTERS)]:
        varied = rest_curve.apply(name)(varied, CURVATURE * one)
    same = rest_curve.apply("curvature_1")(setup_of(), CURVATURE * one)
    np.testing.assert_allclose(varied.properties.curvature, same.properties.curvature, atol=1e-12)
    at = rest_curve.apply("curvature_2_at_50")(setup_of(), one).properties.curvature[:, 1]
    assert float(at.max()) == pytest.approx(1, abs=0.06)
    assert np.abs(at[:10]).max() == np.abs(at[30:]).max() == 0
    assert rest_curve.spelled_out(["EI", "rest_curve"]) == ["EI", *rest_curve.VARYING]


def test_a_uniform_curvature_is_named_before_a_curve_that_varies():
    """Both explain it; the one with fewer values is named, whichever is fitted better by chance.
    The uniform one begins with all of the rope."""
    truth = [0.2, 0.1]
    values = np.array([*truth, LENGTH / 2, 1.2 * LENGTH])
    data = recorded(IntrinsicCurvature().apply(setup_of(segments=240), values), seed=134, sd=0.003)
    bend = PARAMETERS["EI"].within(Range(EI, EI / 100, EI * 100))
    start = fit(Equilibrium(setup_of(segments=120), [bend]), FitProblem(data, Noise(), BINS))
    problem = FitProblem(data.settled(start.point.seen), Noise(), BINS)
    nominal = fit(start.forward, problem, start.point.u)
    uniform, varying = (
        fit_candidate(nominal, Hypothesis(effect, NO_PLACE), np.array(begin))
        for effect, begin in (
            (IntrinsicCurvature(), [0.1, 0.1, LENGTH / 2, 1.15 * LENGTH]),
            (RestShape(), np.repeat([0.1, 0.1], len(rest_curve.QUARTERS))),
        )
    )
    assert uniform is not None
    assert varying is not None
    assert max(uniform.fit.cost, varying.fit.cost) < 0.01 * nominal.cost
    best, *others = sorted([uniform, varying], key=lambda c: -c.evidence)
    named = accept(best, [best, *others], nominal, 20)
    assert named.candidate is uniform
    np.testing.assert_allclose(uniform.values()[:2], truth, rtol=0.1)


def test_identify_finds_a_rest_curvature(ropefit, tmp_path):
    setup = setup_of(CURVATURE, segments=240)
    found = solve(setup.rod(), Conditions(setup.ends, setup.clamp))
    assert found.converged.all()
    markers = found.x[:, [60, 120, 180, 240]]
    markers = markers + 2e-4 * np.random.default_rng(0).normal(size=markers.shape)
    arc = LENGTH * np.array([0.25, 0.5, 0.75, 1.0])
    np.savez(tmp_path / "markers.npz", positions=markers, time=np.arange(9.0), arc_length=arc)
    rows = [
        ",".join(map(repr, [k, float(k), 0, 0.0, 0.0, 0.0, *setup.clamp[k, 0].tolist()]))
        for k in range(9)
    ]
    (tmp_path / "ends.csv").write_text(
        "frame,time,end,x,y,z,qw,qx,qy,qz\n" + "\n".join(rows) + "\n"
    )
    (tmp_path / "recording.toml").write_text(
        'format = "ropefit-recording/1"\nname = "curved"\ngravity = [0, 0, -9.81]\n'
        f"[rope]\nlength = {LENGTH}\nmass = {MASS}\n"
        '[ends]\nfile = "ends.csv"\n[markers]\nfile = "markers.npz"\n'
    )
    ropefit("preprocess", tmp_path, "--run", "run")
    told = ropefit.json("identify", "--run", "run", "--free", "EI,curvature_1,curvature_2")
    p = told["groups"]["group_0"]["parameters"]
    assert p["EI"]["value"] == pytest.approx(EI, rel=0.03)
    assert p["curvature_2"]["value"] == pytest.approx(CURVATURE, abs=0.05)
    assert p["curvature_1"]["value"] == pytest.approx(0, abs=0.05)
    assert p["curvature_2"]["verdict"] == "determined"
    low, high = p["curvature_2"]["ci95"]
    assert low < CURVATURE < high
    kept = ropefit.json("identify", "--run", "run", "--from", "run", "--free", "EI")
    assert kept["rms_fit_m"] < 2e-3
    wrong = ropefit(
        "identify", "--run", "run", "--search", "grid", "--free", "EI,rest_curve", code=2
    )
    assert "grid fits EI" in wrong.stderr

    # Without the mass the fit is of ratios to the weight; a curvature is none of them.
    recording = tmp_path / "recording.toml"
    recording.write_text(recording.read_text().replace(f"mass = {MASS}\n", ""))
    ropefit("preprocess", tmp_path, "--run", "unweighed")
    told = ropefit.json("identify", "--run", "unweighed", "--free", "EI,curvature_1,curvature_2")
    p = told["groups"]["group_0"]["parameters"]
    out = ["--run", "unweighed", "--to", "json", "--out", "rope.json", "--mass", str(MASS)]
    ropefit("export", *out)
    exported = json.loads((tmp_path / "rope.json").read_text())
    assert np.allclose(np.array(exported["rest_curvature"])[:, 1], p["curvature_2"]["value"])
    assert np.mean(exported["EI"]) == pytest.approx(EI, rel=0.03)


def test_a_model_at_rest_is_fitted_to_the_calmest_frames():
    setup = setup_of(frames=40)
    frames = np.arange(40)
    np.testing.assert_array_equal(calmest(frames, setup, 5), frames)  # nothing moves
    size = np.linspace(0, 3, 40)
    size[7] = 0.0
    acceleration = np.broadcast_to(size[:, None, None], (40, 41, 3))
    moving = setup._replace(motion=Motion(acceleration, acceleration))
    np.testing.assert_array_equal(calmest(frames, moving, 4), [0, 1, 2, 7])
    np.testing.assert_array_equal(calmest(frames[10:], moving, 3), [10, 11, 12])
