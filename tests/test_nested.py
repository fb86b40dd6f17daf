"""Nested hypotheses: every edge of the lattice, and that the special case is named."""

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.accepted import Accepted, accept
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import NARROWEST, NO_PLACE, Hypothesis
from ropefit.diagnosis.nested import is_special_case, with_general_cases
from ropefit.diagnosis.reassessment import reassessed
from ropefit.diagnosis.rules import Selection
from ropefit.effects import (
    CATALOGUE,
    DistributedLoad,
    FreeCurvature,
    FreeKink,
    IntrinsicCurvature,
    Kink,
    MassSection,
    PointForce,
    PointMass,
    StiffSection,
    SupportPlane,
    Tether,
)
from ropefit.effects.place import middle_of
from ropefit.effects.wall_field import WallField
from ropefit.models.equilibrium import Equilibrium
from tests.concealed import recorded, rope, with_effect
from tests.test_clamped_end import compared
from tests.test_effects import held

# Of every edge: values of the special case (SI), and where a fit of the general one begins.
EDGES = [(kind, case) for kind in CATALOGUE for case in kind.special_cases]
GENERAL = {
    Tether: [0.05, 0.0, 0.0, -0.03, 0.4],
    PointForce: [0.03, 0.004, 0.0, 0.4],
    MassSection: [0.003, 0.4, 0.08],
    IntrinsicCurvature: [2.0, 1.0, 0.4, 0.08],
    FreeCurvature: [3.0, 0.4, 0.08],
    WallField: [0.03, 0.0, -0.01, 0.5, 0.1],
}
# Of the general effect, without what the special case lacks; in the middle of a segment, which a
# section of no width fills.
WITHOUT = {
    Tether: [0.0, 0.004, -0.003, -0.02, 0.4010416666666667],
    PointForce: [0.02, 0.0, 0.0, 0.4010416666666667],
    MassSection: [0.002, 0.4010416666666667, 1e-4],
    IntrinsicCurvature: [30.0, -15.0, 0.4010416666666667, 0.006],
    FreeCurvature: [30.0, 0.4010416666666667, 0.006],
    WallField: [0.03, 0.004, 0.0, 0.0, 0.0],
}
SPECIAL = {
    PointMass: [0.003, 0.4],
    FreeKink: [0.25, -5.1, 0.4],
    PointForce: [0.02, 0.015, 0.0, 0.4],
    DistributedLoad: [0.03, 0.004, 0.0],
}


def array(values):
    return np.asarray(values, dtype=float)


@pytest.mark.parametrize(("kind", "case"), EDGES)
def test_the_special_case_has_the_same_shapes(kind, case):
    general, special = kind(), case.effect()
    setup = next(s for s in (rope(480, 3), held(rope(480, 3))) if general.applies(s))
    assert special.applies(setup)
    assert set(case.vanishing) <= set(general.names)
    assert len(special.names) <= len(general.names)
    values = np.array(WITHOUT[kind])
    same = case.values(setup, values)
    assert same is not None
    shapes = [
        Equilibrium(effect.apply(setup, array(v)), []).at(np.empty(0)).seen
        for effect, v in ((general, values), (special, same))
    ]
    moved = np.abs(shapes[0] - Equilibrium(setup, []).at(np.empty(0)).seen).max()
    assert moved > 1e-4
    assert np.abs(shapes[0] - shapes[1]).max() < 0.02 * moved


@pytest.mark.parametrize(("kind", "case"), EDGES)
def test_the_special_case_is_named(kind, case):
    """Of a recording of it, from a fit of the general one alone; and the tie is told."""
    if case.effect is Kink:
        pytest.skip("of a clamped rope: the free kink stands for it")
    truth = SPECIAL[case.effect]
    nominal = compared(recorded(with_effect(case.effect(), truth), seed=103))
    begin = np.array(GENERAL[kind])
    general = fit_candidate(nominal, Hypothesis(kind(), NO_PLACE), begin)
    assert general is not None
    named = accept(general, [general], nominal, 20)
    assert type(named.candidate.hypothesis.effect) is case.effect
    assert kind.name in [c.hypothesis.name for c in named.equivalent]
    found, sd = named.candidate.values(), named.candidate.sd()
    assert np.abs(found - truth)[0] < 4 * sd[0] + 0.02 * abs(truth[0])


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        (Tether(), [0.6, 0.1, -0.1, 0.15, 0.4]),
        (PointForce(), [0.02, 0.02, 0.01, 0.4]),
        (MassSection(), [0.01, 0.4, 0.3]),
        (FreeCurvature(), [3.0, 0.4, 0.4]),
    ],
)
def test_the_general_effect_stays_where_it_is_needed(effect, values):
    nominal = compared(recorded(with_effect(effect, values), seed=104))
    hypothesis = Hypothesis(effect, NO_PLACE)
    general = fit_candidate(nominal, hypothesis, np.array(values))
    assert general is not None
    named = accept(general, [general], nominal, 20)
    assert named.candidate is general


@pytest.mark.parametrize("edge", [edge for edge in EDGES if edge[1].general])
def test_the_general_effect_at_a_special_case_does_the_same(edge):
    kind, case = edge
    setup, values = rope(96, 3), np.array(SPECIAL[case.effect])
    general = case.general(setup, values)
    shapes = [
        Equilibrium(effect.apply(setup, v), []).at(np.empty(0)).seen
        for effect, v in ((kind(), general), (case.effect(), values))
    ]
    np.testing.assert_allclose(*shapes, atol=1e-9)
    np.testing.assert_allclose(case.values(setup, general), values, atol=1e-12)


def test_a_general_effect_that_ran_away_is_fitted_from_its_special_case():
    """A tether next to an end may pull far too much; one that pulls as a weight does is as likely
    as the weight, and so it is told."""
    setup = rope(144)
    nominal = compared(recorded(PointMass().apply(setup, np.array([0.002, 0.4])), seed=3))
    weight = fit_candidate(nominal, Hypothesis(PointMass(), NO_PLACE), array([0.002, 0.4]))
    tether = fit_candidate(nominal, Hypothesis(Tether(), NO_PLACE), array(GENERAL[Tether]))
    section = fit_candidate(nominal, Hypothesis(MassSection(), NO_PLACE), array([0.002, 0.4, 0.1]))
    assert weight
    assert tether
    assert section
    plausible = [weight, tether, section]
    assert all(any(c is p for p in plausible) for c in with_general_cases(plausible, nominal))
    away = replace(tether, evidence=weight.evidence + 20)
    away.plausible = lambda: False  # type: ignore[method-assign]
    found = with_general_cases([away, weight, section], nominal)
    assert weight in found
    assert section in found
    (again,) = (c for c in found if c.hypothesis.name == "tether")
    assert again.plausible()
    assert again.fit.cost < weight.fit.cost + 0.1
    assert again.values()[-1] == pytest.approx(0.4, abs=0.02)
    # Not from what is no special case of it, nor where that is not plausible.
    assert away in with_general_cases([away, section], nominal)
    weight.plausible = lambda: False  # type: ignore[method-assign]
    assert away in with_general_cases([away, weight], nominal)


def test_edges_lead_on():
    assert is_special_case(PointMass(), Tether())
    assert not is_special_case(Tether(), PointMass())
    assert not is_special_case(Tether(), Tether())
    assert not is_special_case(Kink(), MassSection())
    lighter = MassSection.special_cases[0].values(rope(20), np.array([-0.002, 0.4, NARROWEST]))
    assert lighter is None
    lifting = PointForce.special_cases[0].values(rope(20), np.array([-0.02, 0.0, 0.0, 0.4]))
    assert lifting is None


def test_two_heavier_sections_are_two_weights():
    """Each becomes a weight beside the other."""
    setup = rope(288)
    for mass in ([0.004, 0.3], [0.003, 0.65]):
        setup = PointMass().apply(setup, array(mass))
    nominal = compared(recorded(setup, seed=108))
    section = Hypothesis(MassSection(), NO_PLACE)
    first = fit_candidate(nominal, section, np.array([0.004, 0.3, 0.1]))
    assert first is not None
    second = fit_candidate(first.fit, section, np.array([0.003, 0.65, 0.1]))
    assert second is not None
    sections = [Accepted(one, [], one.evidence, 0.0) for one in (first, second)]
    _, named = reassessed(second.fit, sections, 6.0, 20)
    assert [one.candidate.hypothesis.name for one in named] == ["point_mass", "point_mass"]
    assert all("mass_section" in [c.hypothesis.name for c in one.equivalent] for one in named)
    found = [one.candidate.values() for one in named]
    np.testing.assert_allclose(np.array(found), [[0.004, 0.3], [0.003, 0.65]], rtol=0.1)


@pytest.mark.parametrize(("centre", "width"), [(0.2, 0.4), (0.8, 0.4)])
def test_a_lighter_section_at_an_end_is_a_heavier_rest(centre, width):
    setup, values = rope(288), np.array([-0.006, centre, width])
    weight = float((setup.properties.density * setup.properties.length).sum())
    heavier = MassSection().more_usual(setup, values)
    assert heavier is not None
    assert heavier[1:] == pytest.approx([0.3 if centre > 0.5 else 0.7, 0.6])
    p = setup.properties
    stiffer = 1 / (1 - 0.006 / width / weight)  # rope of 1 m
    scaled = setup._replace(properties=p._replace(bend=stiffer * p.bend))
    shapes = [
        Equilibrium(MassSection().apply(s, array(v)), []).at(np.empty(0)).seen
        for s, v in ((setup, values), (scaled, heavier))
    ]
    np.testing.assert_allclose(shapes[0], shapes[1], atol=1e-5)
    for other in ([0.006, centre, width], [-0.006, 0.5, 0.4], [-0.006, 0.5, 1.1]):
        assert MassSection().more_usual(setup, np.array(other)) is None


def test_of_both_the_heavier_section_is_named():
    nominal = compared(recorded(with_effect(MassSection(), [0.01, 0.75, 0.5]), seed=109))
    lighter = fit_candidate(
        nominal, Hypothesis(MassSection(), NO_PLACE), np.array([-0.008, 0.25, 0.5])
    )
    assert lighter is not None
    assert lighter.values()[0] < 0
    named = accept(lighter, [lighter], nominal, 20).candidate
    found, sd = named.values(), named.sd()
    assert np.abs(found - [0.01, 0.75, 0.5])[0] < 4 * sd[0]
    assert found[1] - found[2] / 2 == pytest.approx(0.5, abs=0.03)


def test_a_uniform_rope_has_no_section():
    """What the whole rope has is its own rigidity and weight, which every fit allows for."""
    nominal = compared(recorded(rope(288), seed=105))
    for effect, start in (
        (StiffSection(), [0.3, 0.5, 1.1]),
        (MassSection(), [0.006, 0.5, 1.1]),
        (FreeCurvature(), [0.3, 0.5, 1.1]),
    ):
        found = fit_candidate(nominal, Hypothesis(effect, NO_PLACE), np.array(start))
        assert found is None or Selection().acceptable([found], 6.0, nominal, []) is None


def test_a_level_plane_has_no_slope():
    """Beside one that has."""
    setup = rope(288)
    lowest = np.sort(Equilibrium(setup, []).at(np.empty(0)).seen[..., 2].min(axis=1))
    height = lowest[3] - float(middle_of(setup)[2])
    hypothesis = Hypothesis(SupportPlane(), NO_PLACE)
    for slope in (0.0, 0.12):
        truth = [height, slope, 0.0]
        nominal = compared(recorded(with_effect(SupportPlane(), truth), seed=106))
        found = fit_candidate(nominal, hypothesis, np.array([height, 0.0, 0.0]))
        assert found is not None
        assert found.evidence > 20
        assert found.values() == pytest.approx(truth, abs=0.01)
        significant = np.abs(found.values()[1]) > 6 * found.sd()[1]
        assert significant == bool(slope)
