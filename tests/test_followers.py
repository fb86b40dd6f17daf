"""Forces that turn with the rope: the state, its exact derivatives, and found where concealed."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ropefit.adapters.law_content import constant_law
from ropefit.artifacts.causes import Size
from ropefit.diagnosis.hypotheses import effects_of
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.search import search
from ropefit.effects import BendingHysteresis, FollowerForce, PointForce
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models import equilibrium
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.equilibrium_rope import EquilibriumRope
from ropefit.models.parameters import PARAMETERS, Range, terms
from ropefit.models.priors import Priors, calibration
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.followers import in_space, loads, rotated
from tests.concealed import BINS, recorded, rope
from tests.test_laws import by_differences

VALUES = [0.02, -0.03, 0.01, 0.43]


def clamped(segments: int, frames: int = 6) -> Setup:
    """The rope with clamps that hold it level at both ends."""
    setup = rope(segments, frames)
    level = np.array([0.7071067811865476, 0.0, -0.7071067811865476, 0.0])
    return setup._replace(clamp=np.tile(level, (frames, 2, 1)), clamped=(True, True))


def pushed(segments: int, frames: int = 6) -> Setup:
    return FollowerForce().apply(clamped(segments, frames), np.array(VALUES))


def test_the_force_is_that_of_the_rope_in_the_state_that_it_makes():
    setup = pushed(40)
    s = Equilibrium(setup, []).at(np.empty(0)).solution
    assert s.converged.all()
    added = s.rod.load - setup.rod().load
    np.testing.assert_allclose(added, loads(setup.followers, s.q, 41), atol=1e-11)
    np.testing.assert_allclose(
        np.linalg.norm(added.sum(1), axis=1), np.linalg.norm(VALUES[:3]), rtol=0.01
    )
    turned = in_space(setup.followers, s.q)
    assert np.abs(turned - turned[0]).max() > 0.1 * np.abs(turned).max()


def test_a_frame_beyond_its_fold_is_given_up_and_the_others_settle(monkeypatch):
    """Beyond the most force that an equilibrium carries, whole steps lead round and round."""
    settled = 0

    def counted(*given):
        nonlocal settled
        settled += 1
        return under_dead_loads(*given)

    under_dead_loads = equilibrium._under_dead_loads
    monkeypatch.setattr(equilibrium, "_under_dead_loads", counted)
    effect, setup = FollowerForce(), clamped(40)
    at = np.array([0.2, 0.0, 0.0, 0.43])
    s = Equilibrium(effect.apply(setup, at), []).at(np.empty(0)).solution
    assert 4 <= s.converged.sum() < len(s.q)
    assert settled < 16
    few = s.converged
    added = s.rod.load - setup.rod().load
    wanted = loads(s.followers, s.q, 41)
    np.testing.assert_allclose(added[few], wanted[few], atol=1e-6 * at[0])


def test_a_step_of_a_fit_ends_where_one_frame_is_lost():
    """A fit takes no step to where a frame does not settle, however the others do."""
    effect, free = FollowerForce(), np.full(4, np.inf)
    term = Term(
        effect.name, effect.names, ("1",) * 4, effect.apply, np.array([0.05, 0.0, 0.0, 0.43]),
        np.ones(4), -free, free, free,
    )  # fmt: skip
    further = np.array([0.15, 0.0, 0.0, 0.0])
    fitted = Equilibrium(clamped(40), [term])
    assert 4 <= fitted.at(further).converged.sum() < 6  # where a fit begins, they count
    assert fitted.at(np.zeros(4)).converged.all()
    assert not fitted.at(further).converged.any()


def test_frames_rotate_as_quaternions_do():
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        rotated(np.array([half, 0.0, 0.0, half]), np.array([1.0, 2.0, 3.0])), [-2.0, 1.0, 3.0],
        atol=1e-12,
    )  # fmt: skip


def test_derivatives_beside_a_follower_are_exact():
    setup, effect = clamped(30), FollowerForce()
    free = np.full(4, np.inf)
    term = Term(
        effect.name, effect.names, ("1",) * 4, effect.apply, np.array(VALUES),
        np.array([0.01, 0.01, 0.01, 0.05]), -free, free, free,
    )  # fmt: skip
    by_differences(Equilibrium(setup, [term, *terms(setup, ("EI", "length"))]))


def test_gradients_of_a_rope_with_a_follower_equal_differences():
    setup = pushed(24, 2)
    model = EquilibriumRope(setup, 1, 0, recorded=setup.ends)
    values = torch.tensor([[5e-4, 3e-4, np.inf, 1.0]], dtype=torch.float64).expand(2, 4)
    target = torch.randn(2, 25, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def loss(bend: torch.Tensor) -> torch.Tensor:
        mine = torch.cat([bend.expand(2, 1), values[:, 1:]], 1)
        return (model.settle(mine).x * target).sum()

    bend = torch.tensor([[5e-4]], dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(loss(bend), bend)
    step = 1e-7
    with torch.no_grad():
        wanted = (loss(bend + step) - loss(bend - step)) / (2 * step)
    assert float(gradient) == pytest.approx(float(wanted), rel=1e-4)


def test_a_rope_that_remembers_has_no_follower_and_the_other_way_round():
    names = {e.name for e in effects_of(pushed(20))}
    assert "bending_hysteresis" not in names
    values = np.array([1e-4, 1.0])
    assert not FollowerForce().applies(BendingHysteresis().apply(clamped(20), values))
    assert not FollowerForce().applies(rope(20))


def test_a_follower_is_told_from_a_steady_force():
    rules = Rules(effects=("follower_force", "point_force", "tether", "point_mass"))
    found = search(nominal_clamped(recorded(pushed(96, 12), 4)), 0, lambda *_: None, rules)
    (one,) = found.accepted
    assert one.candidate.hypothesis.name == "follower_force"
    assert PointForce.name not in {c.hypothesis.name for c in one.equivalent}
    values, sd = one.candidate.values(), one.candidate.sd()
    assert (np.abs(values - VALUES) < 4 * sd + [1e-3, 1e-3, 1e-3, 0.01]).all()


def test_its_law_is_a_constant_and_says_why_it_has_no_curve():
    size = Size(value=0.2, unit="N", ci95=(0.1, 0.3))
    sizes: dict[str, Size] = dict.fromkeys(
        ("force", "across_1", "across_2", "along", "arc_length"), size
    )
    law = constant_law(FollowerForce(), sizes)
    assert law is not None
    assert law.curve is None
    assert "no variable" in law.no_curve
    assert "F0" in law.form
    assert law.parameters.keys() == {"force", "across_1", "across_2", "along"}
    assert constant_law(PointForce(), sizes) is None


def nominal_clamped(data):
    """EI and all calibration errors of a clamped rope."""
    setup = clamped(48, len(data.points))
    parts = [PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0))]
    forward = Equilibrium(setup, [*parts, *calibration(setup, Priors(), False)])
    return fit(forward, FitProblem(data, Noise(), BINS))
