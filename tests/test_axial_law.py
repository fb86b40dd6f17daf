"""A law of axial strain: closed forms, exact derivatives, found, its form told."""

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from scipy.optimize import brentq

from ropefit.diagnosis.forms import described
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.search import search
from ropefit.effects import AxialExtensibility, AxialLaw, BendingHysteresis, FollowerForce
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import terms
from ropefit.models.terms import Term
from ropefit.rod.axial import TENSIONS, at_tension
from ropefit.rod.rod import build, uniform
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.differentiable import settle
from ropefit.solvers.equilibrium.solve import solve
from tests.concealed import nominal_fit, recorded, rope
from tests.rods import NOT_HELD
from tests.tensors import tensors
from tests.test_laws import by_differences

BENT = [0.5, 0.3, -0.4]
COMPLIANCE, WEIGHT = 0.02, 5.0


def stretchy(segments: int, frames: int = 24, strain: float = 0.05) -> Setup:
    """A rope that stretches by `strain` under its own weight."""
    setup = rope(segments, frames)
    return AxialExtensibility().apply(setup, np.array([strain / float(setup.weight)]))


def array(values: list[float] | list[list[float]]) -> np.ndarray:
    return np.array(values)


def form(setup: Setup, name: str, value: float) -> Setup:
    one = next(f for f in AxialLaw().law(setup).forms if name in f.name)
    return one.apply(setup, array([value]))


@pytest.mark.parametrize("power", [0.6, 0.0, -0.5])
def test_a_chain_of_a_power_law_hangs_as_the_integral_says(power):
    """Without stiffness: x = ∫ H/T (1 + ε(T)) ds with T² = H² + (w s)²."""
    at = 2.0
    axial = power * np.log(TENSIONS / at)
    p = uniform(
        length=1.0, segments=200, bend=1e-9, axial=1 / COMPLIANCE, shear=np.inf, density=WEIGHT
    )
    rod = build(p, array([0.0, 0.0, -1.0]), (False, False))
    ends = array([[0.0, 0.0, 0.0], [0.7, 0.0, 0.0]])[None]
    found = solve(rod, Conditions(ends, NOT_HELD, axial=axial))
    assert found.converged.all()

    def along(pull: float, height: bool) -> float:
        def part(s: float) -> float:
            tension = np.hypot(pull, WEIGHT * s)
            strain = COMPLIANCE * tension * (tension / at) ** power
            return (WEIGHT * s if height else pull) / tension * (1 + strain)

        return quad(part, 0.0, 0.5)[0]

    pull = float(brentq(lambda h: 2 * along(h, False) - 0.7, 1e-3, 50.0))  # pyright: ignore
    assert abs(found.force[0, 100, 0] / pull - 1) < 2e-5
    assert abs(-found.x[0, 100, 2] - along(pull, True)) < 2e-5


def test_no_law_is_the_linear_rope():
    setup = stretchy(40, 3)
    none = Equilibrium(setup, []).at(np.empty(0)).solution
    same = AxialLaw().apply(setup, np.zeros(3))
    zero = Equilibrium(same, []).at(np.empty(0)).solution
    np.testing.assert_allclose(zero.x, none.x, atol=1e-12)


def law_term(values: list[float]) -> Term:
    effect, free = AxialLaw(), np.full(3, np.inf)
    return Term(
        effect.name, effect.names, ("1",) * 3, effect.apply, np.array(values), np.ones(3), -free,
        free, free,
    )  # fmt: skip


@pytest.mark.parametrize("beside", ["nothing", "hysteresis", "follower"])
def test_derivatives_beside_a_law_are_exact(beside):
    """In the law's own values, in rigidity, compliance and length; also in a rope that remembers,
    and under a force that turns with it."""
    setup = stretchy(30, 4, 0.1)
    if beside == "hysteresis":
        setup = BendingHysteresis().apply(setup, array([1e-4, 1.0]))
    if beside == "follower":
        setup = FollowerForce().apply(setup, array([0.05, 0.02, 0.1, 0.4]))
    effect, free = AxialExtensibility(), np.full(1, np.inf)
    softer = Term(
        effect.name, effect.names, ("1/N",), effect.apply, np.array([0.01]), np.array([0.01]),
        -free, free, free,
    )  # fmt: skip
    by_differences(Equilibrium(setup, [softer, law_term(BENT), *terms(setup, ("EI", "length"))]))


def test_the_adjoint_agrees_with_differences():
    """In flexibility, length and load, for a loss of all nodes."""
    setup = AxialLaw().apply(stretchy(20, 2, 0.1), array(BENT))
    assert setup.axial is not None
    held = tensors(Conditions(setup.ends, setup.clamp, axial=setup.axial))
    start = tensors(setup.rod())
    way = torch.randn(2, 21, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def loss(name: str, more: torch.Tensor) -> torch.Tensor:
        state, solution = settle(start._replace(**{name: getattr(start, name) + more}), held)
        assert solution.converged.all()
        return (state.x * way).sum()

    for name in ("flexibility", "length", "load"):
        value = getattr(start, name)
        more = torch.zeros_like(value, requires_grad=True)
        (found,) = torch.autograd.grad(loss(name, more), more)
        one = torch.randn(
            value.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(2)
        )
        one = one * (1e-4 * value.abs().mean())
        if name == "flexibility":
            one[..., :2] = 0.0
        with torch.no_grad():
            wanted = 0.5 * (loss(name, one) - loss(name, -one))
        assert abs(float((found * one).sum() / wanted) - 1) < 1e-5, name


def test_the_curve_is_what_the_solver_does():
    setup = AxialLaw().apply(stretchy(30, 2), array(BENT))
    assert setup.axial is not None
    tension = np.geomspace(0.02, 10.0, 40) * float(setup.weight)
    soft = float(1 / setup.properties.axial[0] + setup.stretch[0])
    strain = soft * tension * np.exp(at_tension(setup.axial, tension))
    np.testing.assert_allclose(AxialLaw().law(setup).curve(setup, strain), tension, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "value", "tension"),
    [
        ("e^n", 1.7, lambda e: e**1.7),
        ("e^3", 0.8, lambda e: e + e**3 / 0.64),
        ("tanh", 1.5, lambda e: np.tanh(e / 1.5)),
        ("ln", 2.5, lambda e: -np.log1p(-e / 2.5)),
    ],
)
def test_a_form_is_its_formula(name, value, tension):
    """As near as values at whole octaves are, where the rope's tensions are; and its constants are
    those of the formula."""
    setup = form(stretchy(30, 2), name, value)
    law = AxialLaw().law(setup)
    middle = float(setup.stretch[0]) * float(setup.weight) * 0.1**0.5
    strain = np.linspace(0.4, 1.4, 20)
    size = float(law.curve(setup, np.array([middle]))[0])
    wanted = size * tension(strain) / tension(1.0)
    np.testing.assert_allclose(law.curve(setup, strain * middle), wanted, rtol=0.03)
    one = next(f for f in law.forms if name in f.name)
    told = {c.name: c.value for c in one.constants(setup, np.array([value]))}
    if "e0" in told:
        np.testing.assert_allclose(told["e0"], value * middle, rtol=1e-9)
    if "b" in told:
        np.testing.assert_allclose(told["a"] / told["b"], (value * middle) ** 2, rtol=1e-9)


def test_a_law_whose_strain_would_fall_is_held_to_one_that_grows():
    setup = AxialLaw().apply(stretchy(30, 2), array([-0.9, 3.0, -3.0]))
    assert setup.axial is not None
    assert (np.diff(setup.axial) > -np.log(2.0) / 4).all()
    assert Equilibrium(setup, []).at(np.empty(0)).converged.all()


RULES = Rules(effects=("axial_law", "axial_extensibility", "point_mass", "soft_section"))


def test_a_law_is_found_and_its_form_told():
    fine = form(stretchy(144, strain=0.12), "e^n", 0.5)
    result = search(nominal_fit(recorded(fine, seed=3), 48), 0, lambda *_: None, RULES)
    names = [one.candidate.hypothesis.name for one in result.accepted]
    assert names == ["axial_extensibility", "axial_law"]
    found = described(result.accepted[1].candidate, result.final)
    assert found is not None
    assert any("e^n" in f.form.name for f in found.forms)
    best = next(f for f in found.forms if "e^n" in f.form.name)
    n = next((c, i) for c, i in zip(best.constants, best.intervals, strict=True) if c.name == "n")
    assert n[1][0] < 0.5 < n[1][1]


def test_a_cord_that_is_much_longer_under_its_own_weight_has_a_law():
    """Its linear stretch is half of its length under its weight, and was held to be implausible."""
    fine = form(stretchy(144, 22, strain=0.2), "e^n", 0.6)
    result = search(nominal_fit(recorded(fine, seed=3), 48), 0, lambda *_: None, RULES)
    names = [one.candidate.hypothesis.name for one in result.accepted]
    assert names == ["axial_extensibility", "axial_law"]


def test_a_linear_stretch_is_no_law():
    result = search(
        nominal_fit(recorded(stretchy(144, strain=0.12), seed=5), 48), 0, lambda *_: None, RULES
    )
    names = [one.candidate.hypothesis.name for one in result.accepted]
    assert names == ["axial_extensibility"]


def test_a_rope_that_does_not_stretch_has_no_law_of_it():
    assert not AxialLaw().applies(rope(30, 2))
    assert AxialLaw().applies(stretchy(30, 2))
