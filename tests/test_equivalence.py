"""Which candidate of a tie is named first, and what is at its bound."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ropefit.diagnosis import acceptance, accepted
from ropefit.diagnosis.acceptance import at_most, refusal, ruled_out
from ropefit.diagnosis.equivalence import also_possible, equivalents, ordered, within_reach
from ropefit.diagnosis.limits import Limits
from ropefit.effects import (
    BendingHysteresis,
    BendingLaw,
    ClampedEnd,
    EndOffset,
    FollowerForce,
    ForceField,
    HalfSpace,
    Inertia,
    IntrinsicCurvature,
    Kink,
    LostOutOfPlane,
    MassSection,
    Obstacle,
    PointForce,
    PointMass,
    StiffSection,
    SupportPlane,
    Tether,
    TimeLag,
    WallField,
)
from ropefit.models.prior import Prior
from tests.concealed import rope


def candidate(
    effect: Any, evidence: float, gained: float, unlikely: float = 0.0, beyond: bool = False,
    arc_length: float = 0.5, likelihood: float | None = None, misfit: bool = False,
) -> Any:  # fmt: skip
    """gained [nats] by held-out data; unlikely: sd that an error of the set-up is off zero;
    arc_length [m]: where on a rope of 1 m an effect at a point is; likelihood [nats]: its
    logarithm; None: as the evidence; misfit: whether noise is what was missed elsewhere."""
    explained = evidence if likelihood is None else likelihood
    one_metre = SimpleNamespace(properties=SimpleNamespace(length=np.full(4, 0.25)))
    return SimpleNamespace(
        values=lambda: np.where(np.array(effect.names) == "arc_length", arc_length, 0.0),
        hypothesis=SimpleNamespace(effect=effect),
        plausible=lambda: True,
        evidence=evidence,
        wants_beyond_bounds=lambda: beyond,
        gains=np.full(5, gained / 5),
        sd=lambda: np.full(len(effect.names), 0.01),
        term=SimpleNamespace(
            prior=np.full(len(effect.names), np.inf), names=effect.names,
            scale=np.full(len(effect.names), 0.02),
        ),
        fit=SimpleNamespace(
            prior=Prior(np.array([1.0, np.inf])),
            point=SimpleNamespace(u=np.array([unlikely, 9.0])),
            spread=1.0, forward=SimpleNamespace(base=one_metre), cost=-2 * explained,
            problem=SimpleNamespace(noise=SimpleNamespace(misfit=misfit)),
        ),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("mass", "error", "first"),
    [
        ((20.0, 25.0), (20.5, 24.0), "lost_out_of_plane"),  # nothing tells them apart
        ((20.0, 30.0), (20.5, 24.0), "point_mass"),  # held-out data do
        ((28.0, 34.0), (20.5, 24.0), "point_mass"),  # evidence does, too
        ((17.0, 30.0), (20.5, 24.0), "lost_out_of_plane"),  # no tie
        ((20.0, 30.0, 3.0), (20.5, 24.0), "lost_out_of_plane"),  # beside an unlikely set-up
        ((20.0, 24.0), (20.5, 30.0), "lost_out_of_plane"),
    ],
)
def test_a_measurement_error_is_first_unless_held_out_data_tell(mass, error, first):
    one, other = candidate(PointMass(), *mass), candidate(LostOutOfPlane(), *error)
    for best, same in ((one, [other]), (other, [one])):
        named, others = ordered(best, same)
        assert named.hypothesis.effect.name == first
        assert len(others) == 1
        assert others[0] is not named


@pytest.mark.parametrize(
    ("evidence", "first"), [(20.5, "point_mass"), (22.9, "point_mass"), (23.1, "lost_out_of_plane")]
)
def test_what_wants_more_than_is_possible_is_not_first_of_a_tie(evidence, first):
    mass, error = (
        candidate(PointMass(), 20.0, 24.0),
        candidate(LostOutOfPlane(), evidence, 24.0, beyond=True),
    )
    named, others = ordered(error, [mass])
    assert named.hypothesis.effect.name == first
    assert len(others) == 1


@pytest.mark.parametrize(
    ("arc_length", "end", "first"),
    [
        (0.98, 1, "clamped_end"),
        (0.02, 0, "clamped_end"),
        (0.98, 0, "point_force"),  # of the other end
        (0.95, 1, "point_force"),  # that is far enough to be told from it
    ],
)
def test_an_effect_of_an_end_is_named_before_a_force_next_to_it(arc_length, end, first):
    force = candidate(PointForce(), 20.5, 24.0, arc_length=arc_length)
    for clamp in (candidate(ClampedEnd(end), 18.0, 24.0), candidate(EndOffset(end), 18.0, 24.0)):
        named, others = ordered(force, [clamp])
        wanted = first if clamp.hypothesis.effect.kind == "physics" else "end_offset"
        assert named.hypothesis.effect.name == wanted
        assert len(others) == 1


@pytest.mark.parametrize(("behind", "first"), [(2.9, "point_mass"), (3.1, "mass_section")])
def test_a_special_case_is_named_unless_the_additional_values_are_worth_more(behind, first):
    section, mass = candidate(MassSection(), 23.0, 24.0), candidate(PointMass(), 23.0 - behind, 24)
    assert ordered(section, [mass])[0].hypothesis.effect.name == first


@pytest.mark.parametrize(("behind", "first"), [(2.9, "tether"), (3.1, "follower_force")])
def test_a_force_that_stands_for_much_else_is_named_last(behind, first):
    force, tether = candidate(FollowerForce(), 23.0, 24.0), candidate(Tether(), 23.0 - behind, 24)
    assert len(force.term.names) < len(tether.term.names)
    assert ordered(force, [tether])[0].hypothesis.effect.name == first


@pytest.mark.parametrize(
    ("special", "general", "less", "first"),
    [
        (Kink(), IntrinsicCurvature(), 1.4, "kink"),
        (Kink(), IntrinsicCurvature(), 1.6, "intrinsic_curvature"),
        (PointMass(), MassSection(), 1.4, "point_mass"),
        (PointMass(), IntrinsicCurvature(), 1.4, "intrinsic_curvature"),  # is none of it
    ],
)
def test_a_special_case_that_is_as_likely_is_named_whatever_the_priors(
    special, general, less, first
):
    wide = candidate(general, 40.0, 24.0, likelihood=60.0)
    narrow = candidate(special, 36.0, 24.0, likelihood=60.0 - less)
    assert ordered(wide, [narrow])[0].hypothesis.effect.name == first


def test_what_explains_nothing_any_more_is_not_named_for_its_few_values():
    lost, bar = candidate(SupportPlane(), 0.0, 0.0), candidate(Obstacle(), 610.0, 24.0)
    assert ordered(lost, [bar])[0].hypothesis.effect.name == "obstacle"


@pytest.mark.parametrize(
    ("slope", "first"), [(0.0, "support_plane"), (0.07, "support_plane"), (-0.1, "obstacle")]
)
def test_a_steep_plane_is_named_after_a_bar_that_explains_as_much(slope, first):
    plane, bar = candidate(SupportPlane(), 40.0, 24.0), candidate(Obstacle(), 39.0, 24.0)
    plane.values = lambda: np.array([-0.3, 0.0, slope])  # slopes to 0.02; usual ones up to 0.06
    for best, same in ((plane, [bar]), (bar, [plane])):
        assert ordered(best, same)[0].hypothesis.effect.name == first


@pytest.mark.parametrize(("ahead", "first"), [(2.9, "support_plane"), (3.1, "obstacle")])
def test_a_bar_has_more_values_than_a_plane_although_all_are_held_near_its_start(ahead, first):
    plane, bar = candidate(SupportPlane(), 40.0, 24.0), candidate(Obstacle(), 40.0 + ahead, 24.0)
    bar.term.prior = np.full(5, 0.1)
    assert ordered(bar, [plane])[0].hypothesis.effect.name == first
    kink = candidate(Kink(), 40.0, 24.0)  # its width is held: three of its four values count
    kink.term.prior = np.array([np.inf, np.inf, 0.7, np.inf])
    assert ordered(bar, [kink])[0].hypothesis.effect.name == ("kink" if ahead < 3 else "obstacle")


@pytest.mark.parametrize(
    ("behind", "share", "less", "tied"),
    [
        (2.9, 0.5, 9.0, True),
        (9.0, 0.99, 9.0, True),
        (9.0, 0.95, 1.0, True),  # of a weak effect two percent are less than chance
        (9.0, 0.95, 2.0, False),
        (10.5, 0.99, 0.0, False),
    ],
)
def test_what_is_as_likely_is_tied_however_weak(behind, share, less, tied):
    assert within_reach(behind, share, less) == tied


@pytest.mark.parametrize(
    ("effect", "significance", "plausible", "tied"),
    [
        (MassSection(), 0.5, True, True),  # of it the mass is a special case: both or none are zero
        (MassSection(), 0.5, False, False),
        (StiffSection(), 0.5, True, False),  # without any size it explains as much
        (StiffSection(), 1.5, True, True),
    ],
)
def test_what_may_be_zero_is_tied_if_it_contains_the_best(effect, significance, plausible, tied):
    mass, other = candidate(PointMass(), 8.3, 12.0), candidate(effect, 8.9, 12.0)
    mass.fit.cost, other.fit.cost = 2012.0, 2010.0
    mass.hypothesis.name, other.hypothesis.name = "point_mass", effect.name
    other.significance, other.plausible = lambda: significance, lambda: plausible
    assert (equivalents(mass, [mass, other], 2045.0) == [other]) == tied


@pytest.mark.parametrize(
    ("effect", "evidence", "gained", "cost", "tied"),
    [
        (Tether(), 2.3, 45.0, 2600.3, True),  # only the priors of its values count against it
        (Tether(), 2.3, 24.0, 2600.3, False),
        (Tether(), 2.3, 45.0, 2640.3, False),  # it makes the data less likely
        (Tether(), -1.0, 45.0, 2600.3, False),  # less likely than nothing at all
        (ForceField(), 2.3, 45.0, 2600.3, False),  # of stretches, not of frames
        (LostOutOfPlane(), 2.3, 45.0, 2600.3, False),  # no physics: it would be named first
    ],
)
def test_what_predicts_held_out_data_better_ties(effect, evidence, gained, cost, tied):
    hysteresis = candidate(BendingHysteresis(), 13.0, 22.0)
    other = candidate(effect, evidence, gained)
    hysteresis.fit.cost, other.fit.cost = 2632.7, cost
    hysteresis.hypothesis.name, other.hypothesis.name = "bending_hysteresis", effect.name
    other.significance, other.plausible = lambda: 7.5, lambda: True
    assert (equivalents(hysteresis, [hysteresis, other], 2660.3) == [other]) == tied


@pytest.mark.parametrize(("cost", "tied"), [(2327.0, True), (2370.0, False)])
def test_candidates_of_a_tie_are_compared_by_one_estimate_of_what_is_missed(cost, tied):
    """Of a rope far from its nominal model, the fourth digit of what a fit misses is many nats."""
    before, spread = 191_600.0, 1.0004
    turned = candidate(LostOutOfPlane(), 0.5 * (before - 2327.0) - 12.0, 0.0)
    turned.fit.cost, turned.hypothesis.name = 2327.0, "lost_out_of_plane"
    loaded = candidate(PointForce(), 0.5 * (before - cost) / spread - 18.0, 0.0)
    loaded.fit.cost, loaded.fit.spread, loaded.hypothesis.name = cost, spread, "point_force"
    loaded.significance, loaded.plausible = lambda: 60.0, lambda: True
    assert turned.evidence - loaded.evidence > 40
    assert (equivalents(turned, [turned, loaded], before) == [loaded]) == tied


@pytest.mark.parametrize(
    ("behind", "misfit", "told"),
    [(4.9, False, True), (5.1, False, False), (9.9, True, True), (10.1, True, False)],
)
def test_what_cannot_be_ruled_out_is_told(behind, misfit, told, monkeypatch):
    """Sooner where noise is what the rope missed in another recording."""
    clamp = candidate(ClampedEnd(0), 30.0, 24.0, misfit=misfit)
    mass = candidate(PointMass(), 30.0 - behind, 24.0, misfit=misfit)
    for one in (clamp, mass):
        one.hypothesis.name, one.significance = one.hypothesis.effect.name, lambda: 5.0
    assert (also_possible(clamp, [clamp, mass], 0.0) == [mass]) == told
    assert equivalents(clamp, [clamp, mass], 0.0) == []
    for name in ("as_usual", "with_general_cases", "with_special_cases"):
        monkeypatch.setattr(
            accepted, name, lambda best, *others, n=name: _unchanged(n, best, others)
        )
    without: Any = SimpleNamespace(cost=0.0)
    for out in (False, True):
        monkeypatch.setattr(accepted, "ruled_out", lambda one, fit, out=out: out)
        found = accepted.accept(clamp, [clamp, mass], without, 20)
        assert found.candidate is clamp
        assert found.equivalent == ([mass] if told and not out else [])


@pytest.mark.parametrize(
    ("effect", "ahead", "told"),
    [
        (Tether(), 3.8, False),  # three more values: 3.91 nats at 95 %
        (Tether(), 4.0, True),
        (PointForce(), 3.1, True),  # two more: 3.00
        (PointForce(), 2.9, False),
        (ClampedEnd(0), 9.0, False),  # contains no weight
    ],
)
def test_what_contains_the_named_effect_is_told_if_it_is_significantly_likelier(
    effect, ahead, told
):
    """However far behind by its evidence, which is then by how broad the priors are."""
    mass = candidate(PointMass(), 10.0, 24.0)
    general = candidate(effect, -2.0, 24.0, likelihood=10.0 + ahead)
    for one in (mass, general):
        one.hypothesis.name, one.significance = one.hypothesis.effect.name, lambda: 5.0
    assert also_possible(mass, [mass, general], 0.0) == ([general] if told else [])
    general.significance = lambda: 0.5
    assert also_possible(mass, [mass, general], 0.0) == []


def test_how_well_its_size_is_known_refuses_a_candidate_but_does_not_rule_it_out(monkeypatch):
    mass, without = candidate(PointMass(), 57.0, 24.0), cast(Any, None)
    for missing in ("", "not_possible", "_not_supported"):
        for name in ("not_possible", "_not_supported"):
            why = "why" if name == missing else ""
            monkeypatch.setattr(acceptance, name, lambda one, fit, why=why: why)
        for significance in (1.2, 5.0):
            mass.significance = lambda s=significance: s
            assert bool(refusal(mass, without)) == (significance < 1.96 or bool(missing))
            assert ruled_out(mass, without) == bool(missing)


def _unchanged(name: str, first: Any, others: tuple[Any, ...]) -> Any:
    return others[0] if name == "with_special_cases" else first


def test_gains_of_frames_and_of_stretches_are_not_compared():
    bar, error = candidate(Obstacle(), 20.0, 60.0), candidate(LostOutOfPlane(), 20.5, 24.0)
    assert bar.hypothesis.effect.held_out != error.hypothesis.effect.held_out
    assert ordered(error, [bar])[0] is error


def test_a_law_is_at_its_bound_of_either_sign_but_may_be_a_plateau():
    setup = rope(40)
    for effect, number, low_counts in [
        (ForceField(), 2, False), (WallField(), 3, True), (HalfSpace(), 3, True),
        (BendingLaw(), 0, False),
    ]:  # fmt: skip
        low, high = (bound[number] for bound in effect.bounds(setup))
        inside = np.array([q.size(setup) for q in effect.quantities])
        for value, wanted in [(high, True), (0.995 * high, True), (0.5 * high, False),
                              (low, low_counts), (0.5 * low, False)]:  # fmt: skip
            values = inside.copy()
            values[number] = value
            one: Any = SimpleNamespace(
                hypothesis=SimpleNamespace(effect=effect), values=values.copy,
                fit=SimpleNamespace(point=SimpleNamespace(setup=setup)),
            )  # fmt: skip
            assert at_most(one) == wanted, (effect.name, value)


def test_an_edge_that_is_sharper_than_data_show_is_at_no_bound():
    setup, effect = rope(40), HalfSpace()
    high = effect.bounds(setup)[1]
    for values, wanted in [([0.01, 0.0, 0.0, 0.1, high[4]], False),
                           ([0.01, 0.0, 0.0, high[3], high[4]], True)]:  # fmt: skip
        one: Any = SimpleNamespace(
            hypothesis=SimpleNamespace(effect=effect), values=lambda v=values: np.array(v),
            fit=SimpleNamespace(point=SimpleNamespace(setup=setup)),
        )  # fmt: skip
        assert at_most(one) == wanted


def test_what_would_be_refused_is_not_named_first_in_a_tie(monkeypatch):
    mass, error = candidate(PointMass(), 20.0, 24.0), candidate(LostOutOfPlane(), 20.5, 24.0)
    monkeypatch.setattr(accepted, "with_special_cases", lambda best, others, without: others)
    monkeypatch.setattr(accepted, "equivalents", lambda best, others, cost: [error])
    monkeypatch.setattr(accepted, "also_possible", lambda first, others, cost: [])
    without: Any = SimpleNamespace(cost=100.0)
    for why, first in [("", error), ("held-out frames do not support it", mass)]:
        monkeypatch.setattr(accepted, "refusal", lambda one, fit, why=why: why)
        found = accepted.accept(mass, [mass, error], without, 20)
        assert found.candidate is first
        assert len(found.equivalent) == 1


def test_a_special_case_is_named_as_what_contains_it_was_accepted(monkeypatch):
    pull, mass = candidate(PointForce(), 20.0, 24.0), candidate(PointMass(), 20.5, 24.0)
    monkeypatch.setattr(accepted, "with_special_cases", lambda best, others, without: others)
    monkeypatch.setattr(accepted, "equivalents", lambda best, others, cost: [mass])
    monkeypatch.setattr(accepted, "also_possible", lambda first, others, cost: [])
    monkeypatch.setattr(accepted, "refusal", lambda one, fit: "held-out frames do not support it")
    without: Any = SimpleNamespace(cost=100.0)
    assert accepted.accept(pull, [pull, mass], without, 20).candidate is mass


def test_beside_what_is_not_exact_a_further_effect_needs_more_than_its_error():
    limits = Limits(6.0, 6.0, {}, {})
    accepted: list[Any] = [
        SimpleNamespace(candidate=candidate(effect, 0.0, 0.0), evidence=evidence, equivalent=[])
        for effect, evidence in ((Inertia(), 600.0), (TimeLag(), 300.0), (PointMass(), 900.0))
    ]
    assert limits.needed([]) == 6.0
    assert limits.needed(accepted[2:]) == 6.0  # exact
    assert limits.needed(accepted[:1]) == pytest.approx(60.0)
    assert limits.needed(accepted[:2]) == pytest.approx(90.0)


@pytest.mark.parametrize(("evidence", "needed"), [(18.0, 6.0), (22.5, 8.5)])
def test_a_further_effect_needs_more_where_one_of_a_tie_may_leave_nothing(evidence, needed):
    mass: Any = SimpleNamespace(
        candidate=candidate(PointMass(), 20.0, 0.0), evidence=20.0,
        equivalent=[candidate(MassSection(), evidence, 0.0)],
    )  # fmt: skip
    assert Limits(6.0, 6.0, {}, {}).needed([mass]) == needed
