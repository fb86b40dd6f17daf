"""identify --law: a curve is fitted when asked for, later stages use it, and limits are told."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.diagnosis.forms import described
from ropefit.effects import BendingLaw
from ropefit.errors import BadInput
from ropefit.fitting.free_law import with_law
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from tests.concealed import BINS, EI, nominal_fit, recorded, rope
from tests.conftest import SAMPLES, Command
from tests.test_laws import form


@pytest.fixture(scope="module")
def stiffening():
    return with_law(nominal_fit(recorded(form(rope(144), "(n-1)", 1.5), 7), 48), BendingLaw())


def test_the_curve_is_that_of_the_rope(stiffening):
    found = described(stiffening, stiffening.fit)
    assert found is not None
    assert found.named
    assert "(n-1)" in found.forms[0].form.name
    low, high = found.forms[0].intervals[1]
    assert low < 1.5 < high
    assert high - low < 0.15
    assert stiffening.evidence > 20


def test_a_rope_that_is_bent_alike_everywhere_shows_one_value_of_the_curve():
    setup = rope(48, 4)
    clamp, ends = setup.clamp.copy(), setup.ends.copy()
    clamp[:, 0] = np.array([0.7071067811865476, 0.0, 0.7071067811865476, 0.0])
    ends[:, 0], ends[:, 1] = 0.0, np.nan
    moment = np.array([[0.0, 0.0, 0.0], [0.0, 1e-3, 0.0]])
    arc = setup._replace(
        clamp=clamp, clamped=(True, False), ends=ends, moment=moment, gravity=0 * setup.gravity
    )
    forward = Equilibrium(arc, [PARAMETERS["EI"].within(Range(EI, 1e-4 * EI, 1e4 * EI))])
    found = fit(forward, FitProblem(recorded(arc, 7), Noise(), BINS))
    with pytest.raises(BadInput, match="curvature is about the same everywhere"):
        with_law(found, BendingLaw())


def test_a_model_with_a_law_is_used_by_later_stages(ropefit: Command, tmp_path):
    run = tmp_path / "run"
    ropefit("preprocess", SAMPLES / "cloud", "--run", run)
    (law,) = ropefit.json("identify", "--law", "bending", "--run", run)["laws"]
    assert law["name"] == "bending_law"
    curve = law["law"]["curve"]
    assert np.all(np.diff(curve["y"]) > 0)
    low, high = law["parameters"]["exponent"]["ci95"]
    assert low < 0 < high
    again = ropefit.json("identify", "--law", "bending", "--run", run)
    assert again["computed"] is False
    assert len(ropefit.json("control", "--run", run)["position_m"]) > 0


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (("--solver", "thomas"), "--law is fitted by --solver equilibrium"),
        (("--groups", "tension"), "leave out --groups"),
        (("--search", "grid"), "--search least-squares"),
    ],
)
def test_what_has_no_law_is_refused(ropefit: Command, tmp_path, more, why):
    told = ropefit("identify", "--law", "bending", "--run", tmp_path, *more, code=2)
    assert why in told.stderr


def test_an_unknown_law_is_refused(ropefit: Command, tmp_path):
    ropefit("preprocess", SAMPLES / "cloud", "--run", tmp_path / "run")
    told = ropefit("identify", "--law", "axial", "--run", tmp_path / "run", code=2)
    assert "--law axial: unknown; one of bending" in told.stderr
