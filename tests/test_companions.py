"""A rough table: the plane and its friction, each of which explains nothing without the other."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.diagnosis import beginning, candidates, first_noise
from ropefit.diagnosis import companions as companions_module
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.companions import Companions, accepted_companions, companions
from ropefit.diagnosis.fits import Fits
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.limits import Limits
from ropefit.diagnosis.proposals import proposals
from ropefit.diagnosis.rules import RULES
from ropefit.diagnosis.verdicts import one_more
from ropefit.effects import BendingHysteresis, ContactFriction, PointMass, SupportPlane
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from tests.concealed import BINS, EI, recorded
from tests.test_friction import ROUGH, lifted, rough

NAMES = ("support_plane", "contact_friction")


def without_table(mu: float) -> Fit:
    """The fit of a rope that hangs freely to one that is dragged over a table."""
    bend = PARAMETERS["EI"].within(Range(EI, EI / 100, 100 * EI))
    data = recorded(rough(lifted(), mu), seed=2)
    alone = Equilibrium(lifted()._replace(potentials=()), [bend])
    problem = FitProblem(data, Noise(), BINS).settled(alone.at(np.zeros(1)).seen)
    return fit(alone, problem, evaluations=10)


@pytest.fixture(scope="module")
def nominal() -> Fit:
    return without_table(ROUGH)


@pytest.fixture(scope="module")
def both(nominal: Fit) -> Companions:
    found = companions(nominal, proposals(nominal, slow=True, names=NAMES), NAMES)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("apart", "walks"), [(4 * [0.001], 4), (4 * [1.0], 1), ([0.001, 0.001, 1.0, 1.0], 3)]
)
def test_more_friction_is_not_tried_where_less_drags_the_rope_far(
    nominal: Fit, monkeypatch, apart, walks
):
    plane, drag = Hypothesis(SupportPlane(), NO_PLACE), Hypothesis(ContactFriction(), NO_PLACE)
    starts, tried = [(plane, np.array([-0.2, 0, 0])), (drag, np.array([0.3]))], []

    def walked(model, u):
        tried.append(float(model.terms[-1].start[0]))
        return replace(nominal.point, seen=nominal.point.seen + apart[len(tried) - 1])

    monkeypatch.setattr(beginning, "settled", walked)
    assert (settled_start(nominal, starts) is None) == (walks == 1)
    assert len(tried) == walks
    assert tried == sorted(tried)


def test_a_plane_and_its_friction_are_fitted_at_once(nominal: Fit, both: Companions):
    assert [h.name for h in both.hypotheses] == list(NAMES)
    dropped = nominal.problem.data.mask.any(1) & ~both.smaller.problem.data.mask.any(1)
    assert np.flatnonzero(dropped).tolist() == [0, 1, 2]  # their past is not known
    plane, drag = both.fit.forward.terms[-2:]
    values = both.fit.forward.split(both.fit.point.u)[-2:]
    assert drag.value(values[1])[0] == pytest.approx(ROUGH, abs=0.05)
    assert plane.value(values[0])[1:] == pytest.approx([0, 0], abs=0.02)


def test_each_of_the_two_passes_every_gate_beside_the_other(both: Companions):
    pair = accepted_companions(both.smaller, both, RULES.least_evidence)
    assert pair is not None
    (plane, before), (drag, _) = pair[0]
    assert before is both.smaller
    assert plane.hypothesis.name == "support_plane"
    assert drag.values()[0] == pytest.approx(ROUGH, abs=0.05)
    assert accepted_companions(both.smaller, both, 1e9) is None


def test_a_plane_stays_where_it_is_while_coefficients_are_tried(both: Companions):
    height = float(both.fit.forward.terms[-2].start[0])
    starts = [
        (Hypothesis(SupportPlane(), NO_PLACE), np.array([height, 0.0, 0.0])),
        (Hypothesis(ContactFriction(), NO_PLACE), np.array([0.3])),
    ]
    begun = settled_start(both.smaller, starts)
    assert begun is not None
    assert begun.terms[0].start[0] == pytest.approx(height)
    assert begun.misfit < float(both.smaller.z @ both.smaller.z)


def test_noise_is_measured_beside_both(nominal: Fit, monkeypatch: pytest.MonkeyPatch):
    rules = replace(RULES, effects=(*NAMES, "point_mass"))
    found = first_noise.first_noise(nominal, rules)
    assert found.together is not None
    monkeypatch.setattr(first_noise, "companions", lambda *_: None)
    alone = first_noise.first_noise(nominal, rules)
    assert found.noise.correlated < 0.5 * alone.noise.correlated


@pytest.mark.parametrize(("height", "tried"), [(0.0, True), (-0.15, False)])
def test_friction_is_tried_at_once_only_with_a_body_that_data_lie_on(
    nominal: Fit, height: float, tried: bool
):
    """A plane under all data, as a rope that sags too deep has it proposed, is none."""
    ((hypothesis, start),), *_ = proposals(nominal, slow=True, names=NAMES)
    lower = start + height * np.array([1.0, 0.0, 0.0])
    found = list(companions_module._pairs(nominal, [[(hypothesis, lower)]], NAMES))
    assert bool(found) == tried


def test_where_a_smooth_plane_explains_all_nothing_else_is_tried(monkeypatch: pytest.MonkeyPatch):
    def never(*_: Any) -> None:
        raise AssertionError("the plane explains everything")

    monkeypatch.setattr(first_noise, "companions", never)
    smooth = without_table(0.0)
    found = first_noise.first_noise(smooth, replace(RULES, effects=(*NAMES, "point_mass")))
    assert [c.hypothesis.name for c in found.candidates] == ["support_plane"]


def test_a_fit_of_friction_ends_where_steps_gain_nothing(both: Companions):
    again = fit(both.fit.forward, both.smaller.problem, both.fit.point.u, 20, tolerance=1e-6)
    assert again.converged
    assert again.evaluations <= 8


def test_a_scan_of_a_rope_that_rubs_is_only_made_where_it_decides(nominal: Fit, both: Companions):
    """Friction is followed approximately: what it leaves is no sign of a third effect."""

    class Costly:
        latent = SimpleNamespace(evidence=100.0)
        current = both.fit

        @property
        def scores(self) -> None:
            raise AssertionError("minutes")

    pair = accepted_companions(both.smaller, both, RULES.least_evidence)
    assert pair is not None
    named = [Accepted(c, [], c.evidence, 0.0) for c, _ in pair[0]]
    scan: Any = Costly()
    limits = Limits(6.0, 20.0, {}, {})
    assert not one_more(both.smaller, named, scan, limits)
    scan.latent = SimpleNamespace(evidence=10.0)
    assert not one_more(both.smaller, [], scan, limits)
    scan = SimpleNamespace(
        latent=SimpleNamespace(evidence=100.0), current=nominal,
        scores=[SimpleNamespace(log_factor=30.0)],
    )  # fmt: skip
    assert one_more(both.smaller, [], scan, limits)


@pytest.mark.parametrize(("touching", "shown"), [(True, 0.9), (True, 0.4), (False, 0.9)])
def test_what_remembers_is_fitted_last_on_a_rope_that_touches(
    monkeypatch: pytest.MonkeyPatch, touching: bool, shown: float
):
    """Unless no place of the scan explains most of the misfit."""
    order: list[str] = []
    kinds = (BendingHysteresis, PointMass, SupportPlane)
    starts = [[(Hypothesis(kind(), NO_PLACE), np.zeros(1))] for kind in kinds]
    monkeypatch.setattr(candidates, "leading", lambda *_: (starts[:2], []))
    monkeypatch.setattr(Fits, "add", lambda _, choices: order.append(choices[0][0].name))
    setup = SimpleNamespace(potentials=(None,) if touching else (), remembers=False)
    current: Any = SimpleNamespace(point=SimpleNamespace(setup=setup), z=np.full(100, 3.0))
    scan: list[Any] = [SimpleNamespace(score=shown * 800)]
    candidates.fit_candidates(current, scan, [], starts[2:], 6.0)
    memory, mass, slow = (choices[0][0].name for choices in starts)
    last = touching and shown > 0.5
    assert order == ([mass, slow, memory] if last else [memory, mass, slow])


def test_two_are_tried_at_once_only_where_one_leaves_more_than_noise():
    assert not first_noise._far_off(SimpleNamespace(z=np.full(100, 1.2)))  # type: ignore[arg-type]
    assert first_noise._far_off(SimpleNamespace(z=np.full(100, 1.5)))  # type: ignore[arg-type]
