"""`--nominal`: what another run found that belongs to the rope is taken over."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.adapters.rope_setup import base_setup
from ropefit.adapters.settings import NOMINAL_DIAGNOSIS, DiagnoseSettings
from ropefit.adapters.taken_over import as_found, held_alike, of_rope, over_mass, understood
from ropefit.artifacts import Model, Observations
from ropefit.artifacts.causes import Cause, Size
from ropefit.diagnosis.rules import RULES
from ropefit.fitting import controlled as handing_on
from ropefit.fitting import diagnosed
from ropefit.fitting import posed as problems
from ropefit.fitting.controlled import controlled
from ropefit.fitting.nominal import RIGIDITY_SD, nominal_terms
from ropefit.fitting.posed import KnownRope, posed
from ropefit.models.correlated import Correlated
from ropefit.models.grips import grips
from ropefit.models.priors import DEGREE, PAIR
from ropefit.runs.loading import load
from ropefit.runs.protocol import Context
from ropefit.stages import diagnose
from tests.concealed import rope
from tests.factories import marker_recording
from tests.test_checkpoints import compute
from tests.test_diagnosis_of_motion import driven


def cause(variant: str, names: list[str], values: list[float], sd: list[float]) -> Cause:
    """What a diagnosis says of an effect; its first two values are correlated by a half."""
    correlation = np.eye(len(sd))
    correlation[0, 1] = correlation[1, 0] = 0.5
    return Cause(
        name=variant, kind="physics", variant=variant, frames=np.arange(2), parameters={},
        values=np.array(values), value_names=names, equivalent_to=[], log_evidence=50.0,
        covariance=correlation * np.outer(sd, sd), p_value=0.0, heldout_gain=np.ones(5),
        sentence="",
    )  # fmt: skip


MASS = cause("PointMass", ["mass", "arc_length"], [0.004, 0.6], [0.0005, 0.01])
SECTION = cause(
    "StiffSection", ["log_factor", "centre", "width"], [0.8, 0.4, 0.2], [0.1, 0.01, 0.02]
)
TILT = cause("GravityMisalignment", ["tilt_1", "tilt_2"], [0.05, 0.0], [0.01, 0.01])


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The artifacts of a small run."""
    folder = tmp_path_factory.mktemp("nominal")
    marker_recording(folder / "recording", frames=4)
    for stage in ("preprocess", "identify"):
        compute(folder / "run", stage)
    o, model = load(folder / "run", Observations)[0], load(folder / "run", Model)[0]
    # Four frames of few markers show no stiffness.
    group, balance = next(iter(model.nominal.groups.values())), model.nominal.balance
    assert balance is not None
    weight = group.parameters["EI"].value / balance.bending_length**3
    stiff = {"EI": 1e-3 * weight, "GJ": 7e-4 * weight}
    told = {
        n: p.model_copy(update={"value": stiff.get(n, p.value)})
        for n, p in group.parameters.items()
    }
    changed = {
        "groups": {"all": group.model_copy(update={"parameters": told})},
        "balance": balance.model_copy(update={"bending_length": 0.1}),
    }
    nominal = model.nominal.model_copy(update=changed)
    return [o, model.model_copy(update={"models": {"nominal": nominal}})]


def found_with(model: Model, **causes: Cause) -> Any:
    """A diagnosis with some causes, and an EI a fifth above that identified without them."""
    p = next(iter(model.nominal.groups.values())).parameters["EI"]
    size = Size(value=1.2 * p.value, unit=p.unit, ci95=(1.1 * p.value, 1.3 * p.value))
    return SimpleNamespace(
        verdict="found", causes=causes, known={}, rope={"EI": size}, rms_before=8e-3,
        rms_after=1e-4, noise_white=1e-3, noise_repeated=None,
    )  # fmt: skip


def test_what_belongs_to_the_rope_is_known_as_well_as_it_was_found(identified):
    o, model = identified
    found = found_with(model, mass=MASS, section=SECTION, tilt=TILT)
    setup = rope(80)
    (name, _, mass), (_, _, section) = of_rope(model, found, o, setup)  # not the set-up's tilt
    assert name == "known_mass"
    np.testing.assert_allclose(mass.value(np.zeros(2)), MASS.values)
    assert isinstance(mass, Correlated)
    assert MASS.covariance is not None
    np.testing.assert_allclose(mass.root @ mass.root.T, MASS.covariance, rtol=0.02)
    heavier = mass.apply(setup, np.array([0.004, 0.6]))
    assert float(heavier.mass.sum()) == pytest.approx(0.004)
    nothing = mass.apply(setup, np.array([-0.004, 0.6]))
    assert float(nothing.mass.sum()) == 0.0  # no weight is less than none
    stiffer = section.apply(setup, section.value(np.zeros(3)))
    ratio = stiffer.properties.bend / setup.properties.bend
    assert float(ratio.max()) == pytest.approx(np.exp(0.8))


def test_the_ropes_own_values_are_those_fitted_along_with_what_was_found(identified):
    _, model = identified
    found = found_with(model, mass=MASS)
    was = next(iter(model.nominal.groups.values())).parameters["EI"]
    changed = as_found(model, found)
    now = next(iter(changed.nominal.groups.values())).parameters["EI"]
    assert now.value == pytest.approx(1.2 * was.value)
    assert now.ci95 == pytest.approx((1.1 * was.value, 1.3 * was.value))
    lengths = [m.nominal.balance.bending_length for m in (model, changed) if m.nominal.balance]
    assert now.value / was.value == pytest.approx((lengths[1] / lengths[0]) ** 3)  # same weight
    assert as_found(model, found_with(model)) is model


@pytest.mark.parametrize(
    ("left", "causes", "expected"),
    [
        (2e-3, {"tilt": TILT}, True),
        (4e-3, {"tilt": TILT}, False),  # stands for something else, and the rope was fitted beside
        (4e-3, {"mass": MASS, "section": SECTION}, True),  # all of it is there in any recording
        (4e-3, {"mass": MASS, "tilt": TILT}, False),
        (6.5e-3, {"mass": MASS}, False),  # of the rope, but in the place of something else
    ],
)
def test_what_leaves_much_is_taken_over_if_it_belongs_to_the_rope_and_explains_most(
    identified, left, causes, expected
):
    model, found = identified[1], found_with(identified[1], **causes)
    found.rms_after = left
    assert understood(model, found) is expected


def test_what_was_missed_alike_in_all_poses_is_not_noise(identified):
    """Noise that was measured beside the misfit may be the misfit: neighbouring poses tell less."""
    model, found = identified[1], found_with(identified[1], mass=MASS)
    found.rms_after, found.noise_white = 6.5e-3, 5e-3
    assert understood(model, found)
    found.noise_repeated = 1e-3
    assert not understood(model, found)
    found.noise_repeated = 9e-3  # poses that are far from each other tell nothing
    assert understood(model, found)


def test_rigidities_of_another_recording_are_not_known_exactly(identified):
    """And need not be uniform."""
    o, model = identified
    model = model.model_copy()
    known: dict[tuple[bool, bool], Any] = {}
    for elsewhere in (False, True):
        group = next(iter(model.nominal.groups.values()))
        ei = group.parameters["EI"]
        sure = ei.model_copy(update={"ci95": (0.999 * ei.value, 1.001 * ei.value)})
        changed = group.model_copy(update={"parameters": group.parameters | {"EI": sure}})
        nominal = model.nominal.model_copy(update={"groups": {"all": changed}})
        source = model.model_copy(update={"models": {"nominal": nominal}})
        for uneven in (False, True):
            terms, setup = nominal_terms(o, source, base_setup(o, 24), True, elsewhere, uneven)
            known[elsewhere, uneven] = {term.name: term for term in terms}
    assert known[False, False]["EI"].prior[0] == pytest.approx(0.001 / 1.96, rel=0.01)
    assert known[True, False]["EI"].prior[0] == RIGIDITY_SD
    assert "rigidity" not in known[True, False]
    along = known[True, True]["rigidity"]
    assert along.nuisance
    doubled = along.apply(setup, np.full(along.size, np.log(2.0)))
    np.testing.assert_allclose(doubled.properties.bend, 2 * setup.properties.bend)


def test_in_motion_what_was_found_of_the_rope_is_known_and_no_effect_of_rest():
    curve = [f"curvature_{axis}_at_{k}" for axis in (1, 2) for k in (0, 25, 50, 75, 100)]
    bent = cause("RestShape", curve, list(np.linspace(1.0, 2.0, 10)), [0.1] * 10)
    law = cause("BendingLaw", ["a", "b"], [0.0, 0.0], [0.1, 0.1])
    o: Any = SimpleNamespace(mass=0.1, length=1.0, gravity=np.array([0, 0, -9.81]))
    group = SimpleNamespace(parameters={"EI": SimpleNamespace(value=1e-3)})
    stepped = SimpleNamespace(bending_length=0.1, mass_known=True)
    nominal = SimpleNamespace(balance=None, stepped=stepped, groups={"all": group})
    model: Any = SimpleNamespace(nominal=nominal)
    found: Any = SimpleNamespace(causes={"bent": bent, "law": law, "tilt": TILT}, known={})
    ((name, _, term),) = of_rope(model, found, o, driven(24))
    assert name == "known_bent"
    setup = driven(24)
    changed = term.apply(setup, term.value(np.zeros(10)))
    added = changed.properties.curvature - setup.properties.curvature
    assert float(added[0, 0]) == pytest.approx(1.0, rel=0.05)
    assert float(added[-1, 1]) == pytest.approx(2.0, rel=0.05)


def test_in_motion_a_rope_of_unknown_mass_keeps_its_rigidity_over_the_mass(identified):
    """Half the gravity told here: the same rope has twice the ratio to what it would weigh."""
    o, model = identified
    there = o.model_copy(update={"mass": None})
    here = there.model_copy(update={"gravity": 0.5 * o.gravity})
    moving = model.nominal.model_copy(update={"stepped": model.nominal.balance})
    stepped = model.model_copy(update={"models": {"nominal": moving}})
    before, after = (
        next(iter(m.nominal.groups.values())).parameters
        for m in (stepped, over_mass(stepped, there, here))
    )
    assert after["EI"].value == pytest.approx(2 * before["EI"].value)
    assert after["length"].value == before["length"].value
    assert over_mass(stepped, there, there.model_copy(update={"mass": 0.1})) is stepped
    assert over_mass(model, there, here) is model  # shapes at rest show the ratio to the weight


@pytest.mark.parametrize("diagnosed", [False, True])
def test_in_motion_the_line_of_a_held_pair_is_known_and_its_roll_is_not(diagnosed):
    def calibration(value: float) -> dict[str, Any]:
        return {f"clamp_0_{axis}": SimpleNamespace(value=value, sd=0.02) for axis in "xyz"}

    stepped = SimpleNamespace(calibration=calibration(0.1))
    model: Any = SimpleNamespace(nominal=SimpleNamespace(stepped=stepped))
    found: Any = SimpleNamespace(calibration=calibration(0.2)) if diagnosed else None
    setup = driven(24)
    pair, other = (held_alike(term, 0, model, found) for term in grips(setup, PAIR)[::2])
    value = 0.2 if diagnosed else 0.1  # as fitted along with what was found
    np.testing.assert_allclose(pair.value(pair.search(pair.start)), [value, value, 0.0])
    sd = np.hypot(0.02, DEGREE)
    np.testing.assert_allclose(pair.prior, [sd, sd, PAIR * DEGREE])
    assert other.prior == pytest.approx(PAIR * DEGREE)  # of the other end, which may be no pair
    (told, *_) = grips(setup, 1.0)  # a clamp whose direction is recorded is held anew
    assert held_alike(told, 0, model, found).start == pytest.approx(0.0)


class Reached(Exception):
    """The nominal fit would begin now."""


def test_a_nominal_run_that_was_not_diagnosed_is_asked_for(identified, monkeypatch):
    o, model = identified

    def fitted(setup, terms, *_):
        raise Reached([term.name for term in terms])

    monkeypatch.setattr(problems, "nominal_at_rest", fitted)
    inputs = {Observations.file_name: o, Model.file_name: model}
    for found, named, asked in ((None, False, 1), (found_with(model, mass=MASS), True, 0)):
        said: list[str] = []
        external = {"nominal": model} | ({NOMINAL_DIAGNOSIS: found} if found else {})
        context = Context(say=said.append, external=external)
        with pytest.raises(Reached) as caught:
            diagnose.diagnosed(inputs, DiagnoseSettings(nominal=True), context, RULES)
        assert ("point_mass" in caught.value.args[0]) is named
        assert len([line for line in said if "run `ropefit diagnose` on it" in line]) == asked


def test_a_search_ends_after_the_evaluations_that_are_asked_for(identified, monkeypatch):
    o, model = identified
    one = SimpleNamespace(used=np.arange(4))

    def search(nominal, seed, progress, rules):
        raise Reached(rules.most_evaluations)

    monkeypatch.setattr(diagnosed, "posed", lambda *_: SimpleNamespace(firm=lambda: (one, None)))
    monkeypatch.setattr(diagnosed, "_unstable", lambda *_: [])
    monkeypatch.setattr(diagnosed.engine, "search", search)
    inputs = {Observations.file_name: o, Model.file_name: model}
    for settings, most in ((DiagnoseSettings(), 1200), (DiagnoseSettings(evaluations=40), 40)):
        with pytest.raises(Reached) as caught:
            diagnose.diagnosed(inputs, settings, Context(), RULES)
        assert caught.value.args == (most,)


@pytest.mark.parametrize(
    ("missed", "causes", "handed_on"),
    [(1.2e-4, {"tilt": TILT}, True), (2e-4, {"tilt": TILT}, False), (2e-4, {"mass": MASS}, True)],
)
def test_a_rope_is_handed_on_if_it_explains_its_own_recording(
    identified,
    monkeypatch,
    missed,
    causes,
    handed_on,
):
    """Of 0.1 mm that are left with all that was found."""
    o, model = identified
    residual = np.full((50, 3), missed / 3**0.5)
    fits = {True: SimpleNamespace(stations=SimpleNamespace(residual=residual)), False: "again"}
    monkeypatch.setattr(
        handing_on, "_control", lambda there, rope, settings: fits[rope.found is not None]
    )
    said: list[str] = []
    external = {"nominal": "as identified", "nominal_observations": o}
    context = Context(say=said.append, external=external)
    known = KnownRope(model, found_with(model, **causes), elsewhere=True)
    rope, control = controlled(known, o, SimpleNamespace(), context)  # type: ignore
    assert (rope is known) is (handed_on and "mass" in causes)
    if handed_on:  # without what is not of the rope, more is missed
        assert rope.found is known.found
        assert rope.model.nominal.rms_fit == max(
            model.nominal.rms_fit, missed * (rope is not known)
        )
    assert control is fits[handed_on]
    assert len(said) == (not handed_on)
    if not handed_on:
        assert (rope.model, rope.found) == ("as identified", None)
        assert "taken as identified there" in said[0]


@pytest.mark.parametrize("diagnosed", [False, True])
@pytest.mark.parametrize(("missed", "counts"), [(0.012, 0.012), (0.08, 0.072)])
def test_frames_at_the_edge_of_stability_are_no_misfit(
    identified, monkeypatch, diagnosed, missed, counts
):
    """Nor is what another fit would miss besides."""
    o, model = identified
    nominal = model.nominal.model_copy(update={"rms_fit": 0.072})  # of all frames
    model = model.model_copy(update={"models": {"nominal": nominal}})
    residual = np.full((50, 3), missed / 3**0.5)
    firm = SimpleNamespace(stations=SimpleNamespace(residual=residual))
    monkeypatch.setattr(handing_on, "_control", lambda *_: firm)
    known = KnownRope(model, found_with(model) if diagnosed else None, elsewhere=True)
    context = Context(external={"nominal": model, "nominal_observations": o})
    rope, control = controlled(known, o, SimpleNamespace(), context)  # type: ignore
    assert rope.model.nominal.rms_fit == pytest.approx(counts)
    assert (rope.found, control) == (known.found, firm)


def test_without_the_nominal_recording_there_is_no_control(identified):
    o, model = identified
    known = KnownRope(model, elsewhere=True)
    assert isinstance(o, Observations)
    assert controlled(known, o, SimpleNamespace(), Context(external={})) == (known, None)  # type: ignore
    same = KnownRope(model)
    context = Context(external={"nominal_observations": o})
    assert controlled(same, o, SimpleNamespace(), context) == (same, None)  # type: ignore


def test_a_misfit_counts_as_noise_only_in_another_recording(identified):
    """In its own it is what is to be explained."""
    o, model = identified
    nominal = model.nominal.model_copy(update={"rms_fit": 0.03})
    rope = KnownRope(model.model_copy(update={"models": {"nominal": nominal}}))
    own, other = (
        posed(o, replace(rope, elsewhere=elsewhere), DiagnoseSettings(nominal=True)).problem.noise
        for elsewhere in (False, True)
    )
    assert own.marker == pytest.approx(float(np.median(o.noise)))
    assert other.marker == pytest.approx(0.03 / 3**0.5)
    assert other.misfit
