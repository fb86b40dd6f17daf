"""No effect beyond what matter allows."""

import numpy as np
import pytest

from ropefit.adapters.diagnosis_content import sizes_of
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.effects import CATALOGUE, MassSection, PointForce, StiffSection
from ropefit.inference.least_squares import attempted
from tests.concealed import recorded, rope, with_effect
from tests.test_clamped_end import compared
from tests.test_effects import PLACES, setup_for


def density(fit):
    return fit.point.setup.properties.density


@pytest.fixture(scope="module")
def lifted():
    """A rope of 60 g that something lifts with the weight of 8 g."""
    return compared(recorded(with_effect(PointForce(), [-0.08, 0.0, 0.0, 0.4]), seed=107))


def test_a_section_is_not_lighter_than_nothing(lifted):
    start = np.array([-0.003, 0.4, 0.1])
    found = fit_candidate(lifted, Hypothesis(MassSection(), NO_PLACE), start)
    assert found is not None
    assert found.fit.cost < lifted.cost  # it would be lighter still, were that possible
    assert float(density(found.fit).min()) > 0
    mass, _, width = found.values()
    assert mass > -0.06 * width
    assert sizes_of(found, found.values(), found.sd())["mass"].ci95[0] >= -0.06


def test_nor_are_two_of_them_together(lifted):
    hypothesis, setup = Hypothesis(MassSection(), NO_PLACE), lifted.forward.base
    starts = np.array([[-0.001, 0.39, 0.1], [-0.001, 0.42, 0.1]])
    terms = [hypothesis.term(setup, start) for start in starts]
    forward = lifted.forward.with_terms([*lifted.forward.terms, *terms])
    begin = np.concatenate([lifted.point.u, np.zeros(6)])
    both = attempted(forward, lifted.problem, begin, 25, tolerance=1e-5)
    assert both is not None
    assert both.cost < 0.5 * lifted.cost
    assert float(density(both).min()) > 0


def test_a_fit_does_not_begin_with_an_impossible_rope(lifted):
    start = np.array([-0.02, 0.4, 0.1])
    term = Hypothesis(MassSection(), NO_PLACE).term(lifted.forward.base, start)
    forward = lifted.forward.with_terms([*lifted.forward.terms, term])
    begin = np.concatenate([lifted.point.u, np.zeros(3)])
    assert attempted(forward, lifted.problem, begin, 3, tolerance=1e-5) is None


@pytest.mark.parametrize("kind", CATALOGUE)
def test_every_effect_at_its_bounds_is_possible(kind):
    """By its own bounds, where its size has any."""
    effect = kind(1)
    setup = setup_for(effect)
    if setup is None:
        pytest.skip("occurs at end 0 only")
    usual = np.array([q.size(setup) for q in effect.quantities])
    for limit in effect.bounds(setup):
        sizes = np.where(np.isfinite(limit), limit, 10 * usual)
        place = [0.5, 1.2] if effect.locus == "interval" else PLACES.get(effect.locus, [])
        values = np.array([*(0.999 * sizes), *place])
        assert effect.apply(setup, values).possible


def test_what_is_not_possible():
    setup = rope(20)
    p = setup.properties
    assert setup.possible
    for name in ("length", "bend", "twist", "density"):
        spoilt = getattr(p, name).copy()
        spoilt[7] = 0.0
        assert not setup._replace(properties=p._replace(**{name: spoilt})).possible
    assert not setup._replace(stretch=setup.stretch - 1e-3).possible
    stiff = StiffSection().apply(setup, np.array([7.0, 0.4, 0.1]))
    assert stiff.possible
