"""The diagnosis on recordings with a concealed effect: found where it is, and as large."""

import numpy as np
import pytest

from ropefit.effects import FreeKink, GravityMisalignment, PointMass, StiffSection
from ropefit.inference.diagnosis.columns import Responses
from ropefit.inference.diagnosis.evidence import Projection, Scorer, null_residuals
from ropefit.inference.diagnosis.families import families
from ropefit.inference.diagnosis.latent import latent_force
from ropefit.inference.diagnosis.regions import regions
from ropefit.inference.diagnosis.search import search
from ropefit.inference.diagnosis.weigh import heldout_rms, predicted
from ropefit.inference.noise import Noise
from tests.concealed import BINS, nominal_fit, recorded, rope, with_effect


def diagnosed(data):
    return search(nominal_fit(data), data, Noise(), BINS, 0, lambda share, text: None)


def test_a_clean_recording_is_called_none():
    d = diagnosed(recorded(rope(288), seed=3))
    assert d.verdict == "none"
    assert not d.found
    before, noise = heldout_rms(d.final)
    assert 0.95 * noise < before < 1.1 * noise
    assert 1e-5 < d.detectable["point_mass"] < 2e-3  # kg


@pytest.mark.parametrize(
    ("effect", "values", "place"),
    [
        (PointMass(), [0.002, 0.37], 0.37),
        (StiffSection(), [0.5, 0.5, 0.2], 0.5),
        (FreeKink(), [0.15, 0.42], 0.42),
    ],
)
def test_an_effect_is_found_where_it_is(effect, values, place):
    d = diagnosed(recorded(with_effect(effect, values), seed=1))
    assert d.verdict == "found"
    names = [d.found[0].rival.family.name, *(r.family.name for r in d.found[0].equivalent)]
    assert effect.name in names
    rival = next(
        r for r in (d.found[0].rival, *d.found[0].equivalent) if r.family.name == effect.name
    )
    found, sd = rival.values(), rival.sd()
    assert found[rival.family.size] == pytest.approx(place, abs=0.03)
    assert abs(found[0] - values[0]) < 4 * sd[0] + 0.02 * values[0]
    assert heldout_rms(d.final)[0] < heldout_rms(d.nominal)[0]


def test_an_error_of_the_set_up_is_named_before_physics():
    d = diagnosed(recorded(with_effect(GravityMisalignment(), [0.03, -0.03]), seed=2))
    assert d.verdict == "found"
    assert d.found[0].rival.family.effect.kind == "measurement"


def test_the_null_is_what_noise_gives():
    data = recorded(rope(288), seed=5)
    found = nominal_fit(data)
    project = Projection(found)
    null = null_residuals(found, project, 60, np.random.default_rng(0))
    assert np.std(null) == pytest.approx(1.0, abs=0.05)
    responses = Responses(found, data, BINS)
    family = next(f for f in families(found.point.setup) if f.name == "point_mass")
    scorer = Scorer(responses.of(family), project, family.scales(found.point.setup))
    factors = scorer.family_factor(null)
    # A Bayes factor exceeds x with probability 1/x at most where there is nothing.
    assert (factors > 3).mean() < 0.1
    assert np.median(factors) < 0
    latent = latent_force(found, project)
    assert latent.evidence < np.quantile(latent.null(null), 0.99) + 10


def test_a_left_out_block_is_predicted_not_fitted():
    found = nominal_fit(recorded(rope(288), seed=6))
    assert (predicted(found) ** 2).sum() > (found.z**2).sum()


def test_the_mismatch_is_located():
    data = recorded(with_effect(PointMass(), [0.004, 0.37]), seed=4)
    found = regions(nominal_fit(data), BINS)
    assert found
    assert any(low <= 0.37 <= high for low, high in (r.arc for r in found))
