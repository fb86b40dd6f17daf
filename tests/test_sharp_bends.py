"""Sharp bends of the rest shape: errors of the set-up that only the last fit has."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.diagnosis.last_fit import with_finer
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.models.priors import EIGHTHS, SHARP_BEND, sharp_bends
from tests.test_least_squares import BINS, SD, markers
from tests.test_off_axis import held

BEND = 0.15  # rad


def bent(shares: np.ndarray) -> np.ndarray:
    """Return the values of the term with a bend about the second direction in some eighths."""
    return np.concatenate([np.zeros(len(EIGHTHS)), shares])


def test_bends_turn_the_rest_shape_where_they_are():
    setup = held()
    (term,) = sharp_bends(setup)
    assert term.nuisance
    np.testing.assert_allclose(term.prior, SHARP_BEND)
    values = np.linspace(-0.3, 0.2, term.size)
    added = term.apply(setup, values).kinks - setup.kinks
    np.testing.assert_allclose(added.sum(axis=0), [*values.reshape(2, -1).sum(1), 0.0])
    np.testing.assert_allclose(setup.arc @ added[:, 0], 0.6 * EIGHTHS @ values[: len(EIGHTHS)])


def test_a_rope_that_spins_has_none():
    setup = held()
    assert sharp_bends(setup._replace(clamped=(False, False))) == []


@pytest.fixture(scope="module")
def misled():
    """Return a rope of known rigidity with one sharp bend, as fitted without."""
    setup = held(frames=8)
    (term,) = sharp_bends(setup)
    bends = bent(BEND * (np.arange(len(EIGHTHS)) == 2))
    data = markers(term.apply(setup, bends), count=9, seed=3)
    problem = FitProblem(data, Noise(marker=SD), BINS)
    return fit(Equilibrium(setup, [PARAMETERS["EI"].term(setup)]), problem), term


def test_the_last_fit_finds_what_misled_it(misled):
    found, term = misled
    again = with_finer(found, [term])
    assert found.scale > 3
    assert again.scale == pytest.approx(1.0, abs=0.1)
    first, last = (abs(np.exp(f.point.u[0]) - 1) for f in (found, again))
    assert last < 0.3 * first
    assert last < 3 * again.sd()[0]
    share = again.point.u[1:].reshape(2, -1)[1] * SHARP_BEND / BEND
    assert share[2] == pytest.approx(1.0, abs=0.5)


def test_without_further_errors_the_fit_stays(misled):
    found, _ = misled
    assert with_finer(found, []) is found
