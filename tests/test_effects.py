"""Every effect of the catalogue: harmless at zero, its derivatives exact."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ropefit.adapters.end_path import end_path
from ropefit.effects import (
    CATALOGUE,
    BendingLaw,
    Effect,
    FreeKink,
    Kink,
    Obstacle,
    StiffSection,
    SupportPlane,
    Tether,
)
from ropefit.effects.place import horizontal
from ropefit.models.equilibrium import STEP_LIMIT, Equilibrium
from ropefit.models.equilibrium_rope import EquilibriumRope
from ropefit.models.terms import Term
from ropefit.rod.potential import slope_of
from ropefit.rod.setup import Motion, Setup
from ropefit.solvers.equilibrium import potentials as solver
from ropefit.solvers.equilibrium.branches import overwound, wound
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.potentials import (
    acted_on,
    force_and_stiffness,
    force_of,
    solve_with_potentials,
)
from ropefit.solvers.equilibrium.solve import NEWTON_LIMIT, solve
from ropefit.solvers.status import Status
from tests.concealed import rope
from tests.test_friction import differences

PLACES = {"point": [0.403], "interval": [0.411, 0.207]}
VALUES = {
    SupportPlane: [-0.38, 0.01, -0.02],
    Obstacle: [0.05, 0.02, -0.3, 0.03, 1.4],
    Kink: [0.09, 0.09, -4.0, 0.403],
    FreeKink: [0.09, -4.0, 0.403],
}
DRAWN = [(kind, end) for kind in CATALOGUE for end in ((0, 1) if kind.locus == "end" else (0,))]


def pinned() -> Setup:
    """The test rope, with a plane for projections."""
    setup = moving(rope(40, 4))
    normal = np.tile([0.0, 1.0, 0.0], (4, 1, 1))
    return setup._replace(sensor=setup.sensor._replace(normal=normal))


def moving(setup: Setup) -> Setup:
    """The setup with a motion, of smooth accelerations of some m/s², and a path of its ends."""
    frames, phase = len(setup.ends), np.arange(3.0)
    t = np.arange(frames)[:, None, None]
    nodes = np.sin(t + 3 * setup.arc[:, None] + phase)
    time, turn = 0.3 * np.arange(frames), np.linspace(0, 0.5, frames)
    clamp = np.zeros((frames, 2, 4))
    clamp[..., 0], clamp[..., 2] = np.cos(turn)[:, None], np.sin(turn)[:, None]
    path = end_path(time, np.arange(frames), setup.ends + turn[:, None, None], clamp, 1.0)
    return setup._replace(motion=Motion(nodes, 5 * nodes), end_path=path)


def clamped() -> Setup:
    """The same with both ends clamped."""
    return held(pinned())


def held(setup: Setup) -> Setup:
    """The setup with both ends clamped along its own tangents."""
    x = Equilibrium(setup, []).at(np.empty(0)).solution.q
    clamp = np.stack([x[:, 0], x[:, -1]], axis=1)
    return setup._replace(clamp=clamp, clamped=(True, True))


def setup_for(effect: Effect) -> Setup | None:
    return next((s for s in (pinned(), clamped()) if effect.applies(s)), None)


@pytest.mark.parametrize(("kind", "end"), DRAWN)
def test_nothing_happens_at_zero(kind, end):
    effect = kind(end)
    setup = setup_for(effect)
    if setup is None:
        pytest.skip("occurs at end 1 only")
    if kind in (SupportPlane, Obstacle):
        values = [-5.0, 0, 0] if kind is SupportPlane else [0, 0, -5.0, 0.02, 0]  # far away
    else:
        values = [0.0] * len(effect.quantities) + PLACES.get(effect.locus, [])
    changed = effect.apply(setup, np.array(values))
    before, after = (Equilibrium(s, []).at(np.empty(0)).seen for s in (setup, changed))
    assert np.abs(after - before).max() < 1e-7


@pytest.mark.parametrize(("kind", "end"), DRAWN)
def test_derivatives_equal_differences(kind, end):
    effect = kind(end)
    setup = setup_for(effect)
    if setup is None:
        pytest.skip("occurs at end 1 only")
    sizes = [0.6 * q.size(setup) for q in effect.quantities]
    values = np.array(VALUES.get(kind, sizes + PLACES.get(effect.locus, [])))
    n = len(values)
    free = np.full(n, np.inf)
    scale = np.array([*(q.size(setup) for q in effect.quantities), *PLACES.get(effect.locus, [])])
    term = Term(
        effect.name, effect.names, ("",) * n, effect.apply, values, scale, -free, free, free
    )
    forward = Equilibrium(setup, [term])
    point = forward.at(np.zeros(n))
    assert point.solution.converged.all()
    assert np.abs(point.seen - Equilibrium(setup, []).at(np.empty(0)).seen).max() > 1e-5
    found = forward.jacobian(point)
    for k in range(len(effect.quantities)):  # places move in steps of a segment
        h = 1e-4 * max(abs(values[k]), 1e-2) / scale[k]
        step = np.eye(n)[k] * h
        wanted = (forward.at(step).seen - forward.at(-step).seen) / (2 * h)
        # What the sensor's error does to a change of the rope is left out: second order.
        assert np.abs(found[k] - wanted).max() < 0.08 * np.abs(wanted).max() + 1e-9
        if effect.kind == "physics":
            assert np.abs(found[k] - wanted).max() < 1e-3 * np.abs(wanted).max() + 1e-9


def test_every_effect_says_what_it_is():
    for kind, end in DRAWN:
        effect = kind(end)
        told = effect.sentence(dict.fromkeys(effect.names, 0.1))
        assert not told[0].isupper()
        assert not told.endswith(".")
        assert {q.unit for q in effect.quantities}


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        (BendingLaw(), [-0.3, 0.2, -0.1, 0.15, -0.2]), (StiffSection(), [0.8, 0.45, 0.2]),
        (Tether(), [3.0, 0.1, 0.2, 0.4, 0.5]),
    ],
)  # fmt: skip
def test_a_rope_for_control_has_the_effect_whatever_its_rigidity(effect, values):
    bare = rope(30, frames=3)
    values = np.array(values)
    plain, bend = bare.properties, 1.7 * float(bare.properties.bend[0])
    twist, length = 1.7 * float(plain.twist[0]), float(plain.length.sum())
    whole = EquilibriumRope(effect.apply(bare, values), 3, 0, plain=plain)
    wanted = [bend, twist, np.inf, length]
    given = torch.tensor(wanted, dtype=torch.float64).expand(3, 4)
    stiffer = bare._replace(
        properties=plain._replace(bend=1.7 * plain.bend, twist=1.7 * plain.twist)
    )
    expected = Equilibrium(effect.apply(stiffer, values), []).at(np.empty(0)).seen[:, ::3]
    move = torch.zeros(3, 3, dtype=torch.float64, requires_grad=True)
    x = whole.settle(given, move).x
    np.testing.assert_allclose(x.detach(), expected, atol=1e-7)
    (slope,) = torch.autograd.grad(x[:, 5, 2].sum(), move)
    for axis in range(3):
        step = 1e-5 * torch.eye(3, dtype=torch.float64)[axis]
        up, down = (whole.settle(given, (e * step).expand(3, 3)).x[:, 5, 2] for e in (1, -1))
        np.testing.assert_allclose(slope[:, axis], (up - down) / 2e-5, atol=1e-5)


def test_a_frame_that_cannot_settle_stops_no_other():
    bare = rope(30, frames=3)
    plane = SupportPlane().apply(bare, np.array([-0.3, 0.0, 0.0]))
    ends = plane.ends.copy()
    ends[1, 0] *= 1.5 / np.linalg.norm(ends[1, 0])  # farther than the rope is long
    held, rod = Conditions(ends, plane.clamp), plane.rod()
    every = solve_with_potentials(rod, held, plane.potentials)
    alone = solve_with_potentials(rod, held.frames(np.array([0, 2])), plane.potentials)
    assert every.converged.tolist() == [True, False, True]
    assert np.abs(every.x[[0, 2]] - alone.x).max() < 1e-7


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        (Tether(), [0.7, 0.02, -0.03, 0.05, 0.403]),
        (SupportPlane(), VALUES[SupportPlane]),
        (Obstacle(), VALUES[Obstacle]),
    ],
)
def test_derivatives_that_a_potential_tells_are_those_of_its_energy(effect, values):
    setup = effect.apply(pinned(), np.array(values))
    x = Equilibrium(setup, []).at(np.empty(0)).solution.x - 0.02
    force, stiffness = force_and_stiffness(setup.potentials, x)
    assert np.abs(force).max() > 0
    assert np.array_equal(force_of(setup.potentials, x), force)
    assert np.array_equal(force_of(setup.potentials, x, acted_on(setup.potentials, x)), force)
    (p,) = setup.potentials
    by_energy = differences(p.energy, x)
    by_slope = differences(lambda at: slope_of(p, at), x)
    np.testing.assert_allclose(-p.share[:, None] * by_energy, force, rtol=1e-9, atol=1e-9)
    wanted = p.share[:, None, None] * by_slope
    np.testing.assert_allclose(wanted, stiffness, rtol=1e-9, atol=1e-9)
    # Without closed forms these are what counts.
    bare = force_and_stiffness((p._replace(derivatives=None),), x)
    np.testing.assert_allclose(bare[1], stiffness, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(
    ("effect", "values"), [(SupportPlane(), VALUES[SupportPlane]), (Obstacle(), VALUES[Obstacle])]
)
def test_smooth_contact_has_arrived_before_its_nodes_stand_still(effect, values, monkeypatch):
    setup = effect.apply(pinned(), np.array(values))
    rod, held = setup.rod(), Conditions(setup.ends, setup.clamp)
    found = solve_with_potentials(rod, held, setup.potentials)
    monkeypatch.setattr(solver, "STILL", 1e-11)
    exact = solve_with_potentials(rod, held, setup.potentials)
    assert found.converged.all()
    assert exact.converged.all()
    np.testing.assert_allclose(found.x, exact.x, rtol=0, atol=1e-9)


def test_a_quadratic_potential_is_replaced_at_once_with_the_same_answer():
    """And the same derivatives, which follow from the supports of the solution."""
    setup = Tether().apply(pinned(), np.array([0.7, 0.02, -0.03, 0.05, 0.403]))
    (p,) = setup.potentials
    rod, held = setup.rod(), Conditions(setup.ends, setup.clamp)
    at_once = solve_with_potentials(rod, held, (p,))
    step_by_step = solve_with_potentials(rod, held, (p._replace(quadratic=False),))
    assert at_once.converged.all()
    assert step_by_step.converged.all()
    np.testing.assert_allclose(at_once.x, step_by_step.x, rtol=0, atol=1e-8)
    pull = np.zeros((len(setup.ends), 1, *at_once.x.shape[1:]))
    pull[:, 0, 20, 2] = 1.0
    one, other = (tangent(s, Directions(load=pull))[0] for s in (at_once, step_by_step))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-6 * np.abs(one).max())


TILT = st.floats(-0.1, 0.1)


@given(st.tuples(TILT, TILT), st.tuples(TILT, TILT))
def test_directions_across_gravity_follow_it(a, b):
    """However little gravity is tilted, and to whatever side: planes and bars are told in them."""
    down = np.array([[*a, -1.0], [*b, -1.0]]) * 9.81
    first, second = (np.stack(v) for v in zip(*(horizontal(g) for g in down), strict=True))
    change = np.linalg.norm(down[0] - down[1]) / 9.81
    for across in (first, second):
        assert np.linalg.norm(across[0] - across[1]) <= 1.1 * change + 1e-12
        assert np.abs((across * down).sum(-1)).max() < 1e-12 * 9.81


def test_states_a_turn_of_twist_away_are_told():
    """They are equilibria too, and no fit may come to them."""
    setup = clamped()
    plain = Equilibrium(setup, []).at(np.empty(0))
    for turns in (-1.0, 1.0):
        every = np.full(len(setup.ends), turns)
        turned = solve(plain.solution.rod, plain.solution.conditions, turns=every)
        assert turned.converged.all()
        assert wound(turned, plain.solution).all()
        assert not wound(turned, turned).any()
        assert overwound(turned, plain.solution).all()
        assert not overwound(plain.solution, turned).any()  # it is hardly twisted
    rod, held = plain.solution.rod, plain.solution.conditions
    soft = rod._replace(stiffness=rod.stiffness * np.array([0.7, 0.7, 0.3]))
    near = solve(soft, held, plain.solution)
    assert not wound(near, plain.solution).any()


def test_a_model_does_not_go_on_from_a_state_wound_by_a_turn(monkeypatch):
    """Where a step of the solver jumps by a whole turn, the frame settles from its catenary."""
    setup = clamped()
    plain = Equilibrium(setup, []).at(np.empty(0)).solution

    def jumping(rod, conditions, start=None, **_):
        turns = None if start is None else np.ones(len(setup.ends))
        return solve(rod, conditions, turns=turns)

    monkeypatch.setattr("ropefit.models.equilibrium.solve", jumping)
    again = Equilibrium(setup, []).at(np.empty(0), start=plain)
    assert not wound(again.solution, plain).any()
    assert np.abs(again.solution.x - plain.x).max() < 1e-6


@pytest.mark.parametrize(
    ("reached", "lost", "begun"),
    [(True, 1, [False]), (True, None, []), (False, 1, [True]), (False, None, [True])],
)
def test_a_step_of_a_fit_whose_frames_are_lost_is_taken_back(monkeypatch, reached, lost, begun):
    """Lost frames begin anew from catenaries; by continuation only before a fit, and not at all
    where a step of it loses every frame (None). It is given up sooner, too."""
    setup, anew, limits = clamped(), [], []
    forward = Equilibrium(setup, [])
    plain = forward.at(np.empty(0)).solution
    forward.reached = reached

    def losing(rod, conditions, start=None, limit=NEWTON_LIMIT, continuation=True):
        found = solve(rod, conditions, start)
        if start is None:
            anew.append(continuation)
        else:
            limits.append(limit)
            found.status[slice(lost)] = Status.LIMIT
        return found

    monkeypatch.setattr("ropefit.models.equilibrium.solve", losing)
    point = forward.at(np.empty(0), start=plain)
    assert anew == begun
    assert limits == [STEP_LIMIT if reached else NEWTON_LIMIT]
    assert point.converged.all() == bool(begun)


def test_a_projection_takes_away_what_is_seen_not_the_axis():
    """What the sensor sees lies before the axis; only then it is moved back by as much."""
    setup = pinned()
    far, share, place = 0.004, 0.7, np.array([0.1, -2.0, 0.3])
    flat, standoff = (np.float64(v) for v in (share, far))
    sensor = setup.sensor._replace(flat=flat, standoff=standoff, place=place)
    x = Equilibrium(setup, []).at(np.empty(0)).solution.x
    ray = x - place
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    seen = x - far * ray
    off = (seen - sensor.origin) @ np.array([0.0, 1.0, 0.0])
    wanted = seen - share * off[..., None] * np.array([0.0, 1.0, 0.0]) + far * ray
    np.testing.assert_allclose(sensor(x), wanted, atol=1e-12)
