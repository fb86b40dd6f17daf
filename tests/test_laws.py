"""Laws beyond the catalogue: exact derivatives, found, named, and not where there is none."""

import numpy as np
import pytest

from ropefit.adapters.law_content import times_metre
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.forms import described
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.search import Diagnosis, search
from ropefit.effects import (
    AxialLaw,
    BendingHysteresis,
    BendingLaw,
    DragLaw,
    Effect,
    FollowerForce,
    ForceField,
)
from ropefit.effects.bending_law import STEEPEST
from ropefit.effects.half_space import HalfSpace
from ropefit.effects.wall_field import WallField
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import terms
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup
from tests.concealed import EI, nominal_fit, recorded, rope
from tests.factories import write_manifest

SOFTER = [-0.3, 0.2, -0.1, 0.15, -0.2]


def form(setup: Setup, name: str, value: float) -> Setup:
    """The setup whose bending follows a form."""
    law = BendingLaw().law(setup)
    one = next(f for f in law.forms if name in f.name)
    return one.apply(setup, np.array([value]))


def by_differences(model: Equilibrium) -> None:
    point, step = model.at(model.start()), 1e-4
    found = model.jacobian(point)
    for k in range(model.size):
        h = step * np.eye(model.size)[k]
        wanted = (model.at(h).seen - model.at(-h).seen) / (2 * step)
        assert np.abs(wanted).max() > 1e-7
        assert np.abs(found[k] - wanted).max() < 2e-3 * np.abs(wanted).max()


def law_term(values: list[float]) -> Term:
    effect, n, free = BendingLaw(), len(values), np.full(len(values), np.inf)
    return Term(
        effect.name, effect.names, ("1",) * n, effect.apply, np.array(values), np.ones(n), -free,
        free, free,
    )  # fmt: skip


@pytest.mark.parametrize("hysteresis", [False, True])
def test_derivatives_beside_a_law_are_exact(hysteresis):
    """In the law's own values, in rigidity and length; also where the rope remembers, too."""
    setup = rope(30, 4)
    if hysteresis:
        values = np.array([1e-4, 1.0])
        setup = BendingHysteresis().apply(setup, values)
    by_differences(Equilibrium(setup, [law_term(SOFTER), *terms(setup, ("EI", "length"))]))


def test_a_law_is_the_derivative_of_the_curve_that_is_told():
    setup = BendingLaw().apply(rope(30, 2), np.array(SOFTER))
    assert setup.bending is not None
    law = BendingLaw().law(setup)
    knots = setup.bending.knots
    x = np.sqrt(knots[1:] * knots[:-1])
    slope = (law.curve(setup, 1.001 * x) - law.curve(setup, x)) / (0.001 * x)
    np.testing.assert_allclose(slope, EI * setup.bending.slope[1:-1], rtol=1e-9)
    middle = np.sqrt(32.0)
    np.testing.assert_allclose(law.curve(setup, np.array([middle])), EI * middle, rtol=1e-6)


def test_a_cantilever_of_a_power_law_bends_as_its_moment_says():
    """With a moment at its free end and no weight: one curvature everywhere, in closed form."""
    setup = form(rope(200, 1), "(n-1)", 0.6)
    clamp = setup.clamp.copy()
    clamp[:, 0] = np.array([0.7071067811865476, 0.0, 0.7071067811865476, 0.0])
    ends = setup.ends.copy()
    ends[:, 0], ends[:, 1] = 0.0, np.nan
    size = 1.7 * EI
    moment = np.array([[0.0, 0.0, 0.0], [0.0, size, 0.0]])
    setup = setup._replace(
        clamp=clamp, clamped=(True, False), ends=ends, moment=moment, gravity=0 * setup.gravity
    )
    x = Equilibrium(setup, []).at(np.empty(0)).solution.x
    law = BendingLaw().law(setup)
    np.testing.assert_allclose(law.visited(setup, x), np.median(law.visited(setup, x)), rtol=1e-6)
    bent = float(np.median(law.visited(setup, x)))
    middle = 32**0.5
    np.testing.assert_allclose(bent, middle * (1.7 / middle) ** (1 / 0.6), rtol=0.01)


@pytest.fixture(scope="module")
def softening():
    return searched(form(rope(144), "tanh", 6.0), 3)


def searched(fine: Setup, seed: int) -> Diagnosis:
    rules = Rules(effects=("bending_law", "point_mass", "soft_section", "intrinsic_curvature"))
    return search(nominal_fit(recorded(fine, seed=seed), 48), 0, lambda *_: None, rules)


def test_a_law_is_found_and_its_form_named(softening):
    (one,) = softening.accepted
    assert one.candidate.hypothesis.name == "bending_law"
    found = described(one.candidate, softening.final)
    assert found is not None
    assert found.named
    (best,) = found.forms
    assert "tanh" in best.form.name
    told = {
        c.name: (c.value, *ends) for c, ends in zip(best.constants, best.intervals, strict=True)
    }
    value, low, high = told["k0"]
    assert low < value < high
    assert 5.7 < value < 6.3
    truth = EI * 32**0.5 / np.tanh(32**0.5 / 6) * np.tanh(found.x / 6)
    inside = (found.x > found.visited[0]) & (found.x < found.visited[1])
    assert np.abs(found.y[inside] / truth[inside] - 1).max() < 0.05
    assert ((found.low <= truth * 1.01) & (truth * 0.99 <= found.high))[inside].all()


@pytest.mark.parametrize(("name", "value", "sd"), [("(n-1)", 0.4, 0.002), ("tanh", 15.0, 0.004)])
def test_what_looks_like_a_solver_that_stopped_early_is_a_law(name, value, sd):
    """Of a power law the free curve must follow the small curvatures; of a late levelling one
    block of frames shows the highest, without which a first-order fit goes anywhere."""
    rules = Rules(effects=("bending_law", "under_converged", "mass_section"))
    data = recorded(form(rope(144, 18), name, value), seed=3, sd=sd)
    result = search(nominal_fit(data, 48), 0, lambda *_: None, rules)
    assert [one.candidate.hypothesis.name for one in result.accepted] == ["bending_law"]
    assert result.final.scale < 1.05
    assert result.accepted[0].candidate.gains.min() > 0


def test_a_value_at_curvatures_that_no_frame_has_may_be_anything():
    """Of a stiff rope, which is nowhere bent by 8 over its length."""
    stiff = rope(48, 8, bend=2e-2)
    nominal = nominal_fit(recorded(stiff, seed=3), 24)
    found = fit_candidate(nominal, Hypothesis(BendingLaw(), NO_PLACE), np.zeros(5))
    assert found is not None
    low, high = (ends[-1] for ends in found.interval(1.96))
    assert (low, high) == (pytest.approx(-3.0), pytest.approx(STEEPEST))
    low, high = (ends[0] for ends in found.interval(1.96))
    assert -0.3 < low < 0 < high < 0.3


def test_a_linear_rope_is_no_law_and_how_far_from_it_could_be_is_told():
    result = searched(rope(144), 5)
    assert result.verdict == "none"
    assert 0.005 < result.detectable["bending_law"] < 0.3


FIELD = [0.3, 1.5, 2.0, 0.1, 0.2, -0.35]


def test_a_force_field_is_the_gradient_of_its_energy():
    setup = ForceField().apply(rope(30, 2), np.array(FIELD))
    (field,) = setup.potentials
    assert field.derivatives is not None
    x = np.random.default_rng(3).normal(size=(50, 3))
    slope, rows = field.derivatives(x)
    for a in range(3):
        step = 1e-5 * np.eye(3)[a]
        rise = (field.energy(x + step) - field.energy(x - step)) / 2e-5
        bend = (field.derivatives(x + step)[0] - field.derivatives(x - step)[0]) / 2e-5
        np.testing.assert_allclose(slope[:, a], rise, rtol=1e-5, atol=1e-8)
        np.testing.assert_allclose(rows[:, a], bend, rtol=1e-5, atol=1e-6)


def test_derivatives_beside_a_force_field_are_exact():
    setup, effect = rope(30, 4), ForceField()
    free = np.full(len(FIELD), np.inf)
    term = Term(
        effect.name, effect.names, ("1",) * len(FIELD), effect.apply, np.array(FIELD),
        np.ones(len(FIELD)), -free, free, free,
    )  # fmt: skip
    by_differences(Equilibrium(setup, [term, *terms(setup, ("EI", "length"))]))


@pytest.fixture(scope="module")
def repelled():
    """A force that falls by e in 8 cm, from a point below the rope."""
    values = np.array([0.25, 0.0, 12.5, 0.35, 0.1, -0.25])
    rules = Rules(effects=("force_field", "bending_law", "point_mass", "intrinsic_curvature"))
    data = recorded(ForceField().apply(rope(72, 8), values), seed=11, points=120)
    return search(nominal_fit(data, 36), 0, lambda *_: None, rules)


def test_a_force_field_is_found_with_its_place_and_form(repelled):
    (one,) = repelled.accepted
    assert one.candidate.hypothesis.name == "force_field"
    found = described(one.candidate, repelled.final)
    assert found is not None
    best = found.forms[0]
    assert "e^(-r/lambda)" in best.form.name
    ends = dict(zip((c.name for c in best.constants), best.intervals, strict=True))
    low, high = ends["lambda"]
    assert low < 0.08 < high
    values, sd = one.candidate.values()[3:], one.candidate.sd()[3:]
    assert (np.abs(values - [0.35, 0.1, -0.25]) < 4 * sd).all()
    truth = 0.25 * np.exp((0.1 - found.x) / 0.08)
    inside = (found.x > found.visited[0]) & (found.x < found.visited[1])
    assert ((found.low <= truth * 1.01) & (truth * 0.99 <= found.high))[inside].all()


def test_units_times_metre():
    assert times_metre("N m^2", -3) == "N/m"
    assert times_metre("N m^2", -1) == "N m"
    assert times_metre("m^3", -1) == "m^2"
    assert times_metre("", -1) == "1/m"
    assert times_metre("", 0) == "1"
    assert times_metre("N m^2", -0.4) == "N m^1.6"


def test_the_command_line_tells_the_law_and_draws_it(ropefit, tmp_path):
    """Markers on a softening rope: the object of --json has form, constants and curve."""
    fine = form(rope(144, 10), "tanh", 6.0)
    x = Equilibrium(fine, []).at(np.empty(0)).seen[:, ::6]
    x = x + np.random.default_rng(3).normal(0, 5e-4, x.shape)
    folder = tmp_path / "softening"
    folder.mkdir()
    write_manifest(folder, '[markers]\nfile = "markers.npz"', "length = 1.0\nmass = 0.06")
    np.savez(folder / "markers.npz", positions=x, time=np.arange(10.0))
    rows = [f"{t},{t},{end},{p[0]},{p[1]},{p[2]}" for t, pair in enumerate(fine.ends.tolist())
            for end, p in enumerate(pair)]  # fmt: skip
    (folder / "ends.csv").write_text("\n".join(["frame,time,end,x,y,z", *rows]) + "\n")
    ropefit("preprocess", folder, "--run", "run")
    ropefit("identify", "--run", "run")
    answer = ropefit.json("diagnose", "--run", "run")
    (effect,) = answer["effects"]
    assert effect["name"] == "bending_law"
    law = effect["law"]
    assert any("tanh" in name for name in law["forms"])
    curve = law["curve"]
    assert curve["unit_x"] == "1/m"
    assert curve["unit_y"] == "N m"
    y, low, high = (np.array(curve[name]) for name in ("y", "low", "high"))
    assert (low <= y * 1.001).all()
    assert (y <= high * 1.001).all()
    middle = 32**0.5
    truth = EI * middle / np.tanh(middle / 6) * np.tanh(np.array(curve["x"]) / 6)
    least, most = curve["visited"]
    inside = (np.array(curve["x"]) > least) & (np.array(curve["x"]) < most)
    assert np.abs(y[inside] / truth[inside] - 1).max() < 0.1
    assert "softens" in effect["description"]
    ropefit("report", "--run", "run")
    page = (tmp_path / "run" / "report.html").read_text()
    assert "The law" in page
    assert "bending moment (N m)" in page


@pytest.mark.parametrize(
    "kind", [BendingLaw, AxialLaw, DragLaw, ForceField, WallField, HalfSpace, FollowerForce]
)
def test_what_no_target_expresses_is_told(kind: type[Effect]):
    effect = kind()
    values = dict.fromkeys(effect.names, 0.1)
    told = effect.exported(values, rope(20, 2), 11, ())
    assert told.note.startswith(f"{effect.name}: ")
    assert told.beside == ()
    assert not told.in_rope
