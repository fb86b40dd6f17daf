"""Ropes that rub on what they lie on: Coulomb's law, a rope that is dragged, derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.candidate import compared, fit_candidate
from ropefit.diagnosis.first_noise import _beside
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.proposals import proposals
from ropefit.diagnosis.reassessment import reassessed
from ropefit.diagnosis.rules import RULES
from ropefit.diagnosis.with_accepted import with_known_past
from ropefit.effects import ContactFriction, Obstacle, SupportPlane
from ropefit.effects.place import horizontal, middle_of
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.history import WalkedPoint
from ropefit.models.parameters import PARAMETERS, Range, set_bend
from ropefit.models.terms import Term
from ropefit.rod import friction
from ropefit.rod.friction import Grip
from ropefit.rod.potential import Potential
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare
from ropefit.solvers.equilibrium.supports import Supported
from tests.concealed import BINS, EI, EYE, recorded
from tests.test_memory import difference

WEIGHT, ROUGH = 0.06 * 9.81, 0.4  # N/m, coefficient
LIFT = 0.3  # m


def table(ends: np.ndarray, clamp: np.ndarray, segments: int, height: float) -> Setup:
    """A rope of 1 m whose ends (F, 2, 3) [m] are led over a rough table."""
    made = uniform(length=1.0, segments=segments, bend=EI, density=0.06)
    gravity = np.array([0.0, 0.0, -9.81])
    setup = bare(made, gravity, np.array(ends), clamp, np.array(EYE))
    plane = np.array([height, 0.0, 0.0])
    return SupportPlane().apply(setup, plane)


def rough(setup: Setup, coefficient: float) -> Setup:
    return ContactFriction().apply(setup, np.array([coefficient]))


def swept(segments: int = 60, frames: int = 10) -> Setup:
    """A rope that hangs onto the table between its ends, one of which sweeps to and fro."""
    share = np.sin(np.linspace(0, 2 * np.pi, frames))
    moving = np.stack([0.9 + 0 * share, 0.1 * share, 0.0 * share], axis=1)
    ends = np.stack([moving, np.zeros_like(moving)], axis=1)
    free = np.full((frames, 2, 4), np.nan)
    return table(ends, free, segments, -0.15)


def test_a_node_sticks_then_slides_at_the_coefficient_times_the_normal_force():
    hardness = np.float64(100.0)

    def energy(x: np.ndarray) -> np.ndarray:
        return 0.5 * hardness * np.maximum(-x[..., 2], 0.0) ** 2

    mu = np.float64(0.3)
    one = np.ones(1)
    contact = Potential(energy, one, hardness, mu, one)
    deep = 0.01  # m: a normal force of 1 N
    grip = Grip(np.zeros((1, 3)), np.ones(1, dtype=bool))
    for x, wanted in [(0.001, -0.1), (0.0025, -0.25), (0.02, -0.3), (0.018, -0.1), (0.012, 0.3)]:
        at = np.array([[x, 0.0, -deep]])
        force = friction.force(contact, grip, at)
        np.testing.assert_allclose(force[0], [wanted, 0, 0], atol=1e-12)
        if x >= 0.0025:
            grip = friction.after(contact, grip, at)
    away = np.array([[0.0, 0.0, 0.001]])
    assert (friction.force(contact, grip, away) == 0).all()
    # Where it touches down again it is dragged from where it was in the air.
    down = np.array([[0.004, 0.0, -deep]])
    force = friction.force(contact, friction.after(contact, grip, away), down)
    np.testing.assert_allclose(force[0], [-0.3, 0, 0], atol=1e-12)


def test_a_dragged_rope_is_as_taut_as_what_it_drags():
    """μ times the weight of all that follows, in either direction of the way."""
    way = np.array([0, -0.002, -0.005, -0.02, -0.05, -0.045, -0.03])
    ends = np.full((len(way), 2, 3), np.nan)
    ends[:, 0] = 0.0
    ends[:, 0, 0] = way
    clamp = np.full((len(way), 2, 4), np.nan)
    clamp[:, 0] = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])
    setup = rough(table(ends, clamp, 60, 0.0), ROUGH)
    point = Equilibrium(setup, []).at(np.empty(0))
    assert point.solution.converged.all()
    tension = point.solution.force[:, 6:54, 0]
    arc = setup.arc
    rest = 1 - 0.5 * (arc[6:54] + arc[7:55])
    np.testing.assert_allclose(tension[0], 0, atol=1e-6)
    # Every third node rubs for its neighbours: steps of a twentieth.
    wanted, step = ROUGH * WEIGHT * rest, ROUGH * WEIGHT / 20
    np.testing.assert_allclose(tension[1:5], np.tile(wanted, (4, 1)), atol=0.6 * step)
    np.testing.assert_allclose(tension[5:7], np.tile(-wanted, (2, 1)), atol=0.6 * step)
    np.testing.assert_allclose(tension[1:5].mean(1), wanted.mean(), rtol=0.02)


def test_without_a_coefficient_nothing_changes():
    setup = swept()
    plain, none = (Equilibrium(s, []).at(np.empty(0)) for s in (setup, rough(setup, 0.0)))
    assert isinstance(none, WalkedPoint)
    np.testing.assert_allclose(none.seen, plain.seen, atol=1e-7)
    assert ContactFriction().applies(setup)
    assert not ContactFriction().applies(setup._replace(potentials=()))


def test_a_rope_is_held_from_where_it_touches_down_between_frames():
    """As one is whose recording shows all the way: from above the table down onto it and aside."""
    way = np.linspace(0.0, 1.0, 41)[:, None]
    moving = np.array([0.75, 0.0, 0.25]) + way * np.array([-0.05, 0.2, -0.15])
    ends = np.stack([moving, np.zeros_like(moving)], axis=1)
    free = np.full((len(way), 2, 4), np.nan)
    last = {}
    for name, every in {"all": 1, "few": 40}.items():
        some = table(ends[::every], free[::every], 60, -0.32)
        for mu in (0.0, ROUGH):
            point = Equilibrium(rough(some, mu), []).at(np.empty(0))
            assert point.solution.converged.all()
            last[name, mu] = point.seen[-1]
    friction_moves = np.linalg.norm(last["all", ROUGH] - last["all", 0.0], axis=-1).max()
    missed = np.linalg.norm(last["few", ROUGH] - last["all", ROUGH], axis=-1).max()
    assert friction_moves > 0.01
    assert missed < 0.15 * friction_moves


def test_only_steps_in_which_nodes_touch_down_are_taken_in_increments():
    setup = rough(swept(), ROUGH)
    point = Equilibrium(setup, []).at(np.empty(0))
    assert isinstance(point, WalkedPoint)
    assert len(point.whole.ends) == point.increments.sum() == len(point.steps)
    kept = point.whole.ends[np.cumsum(point.increments) - 1]
    np.testing.assert_allclose(kept, setup.ends, rtol=0, atol=1e-15)
    above = setup._replace(ends=setup.ends + np.array([0.0, 0.0, 1.0]))
    off = Equilibrium(above, []).at(np.empty(0))
    assert isinstance(off, WalkedPoint)
    assert (off.increments == 1).all()


def test_a_walk_does_not_depend_on_what_was_tried_before():
    """Else a fit, which begins each step where the last one ended, has an objective with jumps."""
    setup, free = rough(swept(40, 8), ROUGH), np.full(1, np.inf)

    def lifted(setup: Setup, v: np.ndarray) -> Setup:  # an end: it touches down later
        by = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
        return setup._replace(ends=setup.ends + v[0] * by * np.abs(setup.ends[:, :1, 1:2]))

    one = np.ones(1)
    term = Term("lift", ("lift",), ("1",), lifted, 0 * one, one, -free, free, free)
    forward = Equilibrium(setup, [term])
    first, there, again = (forward.at(v * one) for v in (0.0, 3.0, 0.0))
    assert isinstance(first, WalkedPoint)
    assert isinstance(there, WalkedPoint)
    assert np.abs(there.seen - first.seen).max() > 0.01
    np.testing.assert_allclose(again.seen, first.seen, atol=1e-8)
    np.testing.assert_array_equal(there.increments, first.increments)
    anew = Equilibrium(setup, [term]).at(3.0 * one)
    assert isinstance(anew, WalkedPoint)
    assert (anew.increments != first.increments).any()  # of another model they are its own


def test_a_walk_starts_from_how_the_rope_moved_at_the_last_step(monkeypatch):
    setup, rounds = rough(swept(40, 8), ROUGH), 0
    settle = Supported.settled

    def counted(*args, **kwargs):
        nonlocal rounds
        rounds += 1
        return settle(*args, **kwargs)

    monkeypatch.setattr(Supported, "settled", counted)
    raised = setup._replace(ends=setup.ends + np.array([0.0, 0.0, 1e-4]))
    first = Equilibrium(setup, []).at(np.empty(0))
    rounds = 0
    alone = Equilibrium(raised, []).at(np.empty(0))
    anew, rounds = rounds, 0
    forward = Equilibrium(raised, [])
    forward.remember(first)
    carried = forward.at(np.empty(0))
    assert rounds < 0.7 * anew
    np.testing.assert_allclose(carried.seen, alone.seen, rtol=0, atol=1e-8)


def test_the_rope_lags_behind_on_the_way_there_and_on_the_way_back():
    setup = swept()
    seen = Equilibrium(rough(setup, ROUGH), []).at(np.empty(0)).seen
    plain = Equilibrium(setup, []).at(np.empty(0)).seen
    behind = (seen - plain)[:, 20:45, 1].mean(1)
    way = np.diff(setup.ends[:, 0, 1])
    assert np.corrcoef(behind[1:], way)[0, 1] < -0.3
    assert np.abs(behind).max() > 1e-3


# With more friction nodes change from sticking to sliding within any step that shows more digits.
@pytest.mark.parametrize(("coefficient", "digits"), [(0.15, 2e-6), (0.5, 1e-4)])
def test_derivatives_through_friction_are_exact(coefficient, digits):
    setup, free = swept(40, 6), np.full(1, np.inf)

    def one(name, apply, start, scale):
        return Term(name, (name,), ("",), apply, np.array([start]), np.array([scale]), -free, free,
                    free)  # fmt: skip

    def moved(setup: Setup, v: np.ndarray) -> Setup:
        by = np.array([[0.3, 0.1, 0.2], [0.0, 0.0, 0.0]])
        return setup._replace(ends=setup.ends + v[0] * by)

    terms = [
        one("EI", set_bend, EI, EI),
        one("ends", moved, 0.0, 0.1),
        one("coefficient", ContactFriction().apply, coefficient, coefficient),
    ]
    forward = Equilibrium(setup, terms)
    point = forward.at(np.zeros(3))
    assert point.solution.converged.all()
    found = forward.jacobian(point)
    for k in range(3):
        errors = [difference(forward, k, step, found[k]) for step in (1e-4, 3e-4, 1e-3, 3e-3)]
        assert min(errors) < digits  # nodes are settled to 1e-9 of the length only


def test_friction_is_found_where_a_rope_lies():
    """Proposed in full, for a small coefficient does not show what it does; and what it rests on
    is not weighed without it."""
    data, noise = recorded(rough(swept(120), ROUGH), seed=2), Noise()
    setup = swept(60)._replace(potentials=())
    bend = PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0))
    nominal = fit(Equilibrium(setup, [bend]), FitProblem(data, noise, BINS))
    assert not any(
        isinstance(c[0][0].effect, ContactFriction) for c in proposals(nominal, slow=True)
    )
    assert any(isinstance(c[0][0].effect, SupportPlane) for c in proposals(nominal, slow=True))
    hypothesis = Hypothesis(SupportPlane(), NO_PLACE)
    plane = fit_candidate(nominal, hypothesis, np.array([-0.15, 0.0, 0.0]))
    assert plane is not None
    ((hypothesis, start), *_), *others = proposals(plane.fit, slow=True)
    assert isinstance(hypothesis.effect, ContactFriction)
    assert not any(isinstance(c[0][0].effect, SupportPlane) for c in others)
    drag = fit_candidate(plane.fit, hypothesis, start)
    assert drag is not None
    assert drag.evidence > 100
    assert drag.values()[0] == pytest.approx(ROUGH, abs=0.05)
    named = [Accepted(r, [], r.evidence, 0.0) for r in (plane, drag)]
    kept, causes = reassessed(drag.fit, named, 5.0, 20)
    assert [one.candidate.hypothesis.name for one in causes] == [
        "support_plane",
        "contact_friction",
    ]
    assert kept.cost == drag.fit.cost


def lifted() -> Setup:
    """A rope that lies on the table in its first frames, is lifted, and put down again."""
    setup = swept(60, 14)
    ends = setup.ends.copy()
    ends[3:5, :, 2] += LIFT
    return setup._replace(ends=ends)


def test_frames_until_a_rope_first_lifts_have_an_unknown_past():
    for setup, wanted in [(lifted(), [0, 1, 2]), (swept(), [])]:
        x = Equilibrium(setup, []).at(np.empty(0)).solution.x
        assert np.flatnonzero(ContactFriction().begun_before(setup, x)).tolist() == wanted


def test_friction_is_looked_for_without_the_frames_of_an_unknown_past():
    """Where something is left to explain, and beside what is known of the noise; its fit begins
    with the best of several coefficients."""
    bend = PARAMETERS["EI"].within(Range(EI, EI / 100, 100 * EI))
    dropped = {}
    for mu in (0.0, ROUGH):
        data = recorded(rough(lifted(), mu), seed=2)
        alone = Equilibrium(lifted()._replace(potentials=()), [bend])
        problem = FitProblem(data, Noise(), BINS).settled(alone.at(np.zeros(1)).seen)
        nominal = fit(alone, problem, evaluations=1)  # at its true rigidity
        hypothesis = Hypothesis(SupportPlane(), NO_PLACE)
        height = -0.15 - LIFT * 2 / 14  # against the mean height of the ends
        term = hypothesis.term(alone.base, np.array([height, 0.0, 0.0]))
        fitted = fit(alone.with_terms([bend, term]), problem, evaluations=3)
        plane = compared(hypothesis, term, nominal, fitted)
        data = with_known_past(problem.data, nominal, plane)
        dropped[mu] = np.flatnonzero(problem.data.mask.any(1) & ~data.mask.any(1)).tolist()
    assert dropped == {0.0: [], ROUGH: [0, 1, 2]}
    (move,) = _beside(nominal, [plane], RULES)
    assert move.shape == nominal.stations.residual.shape
    assert np.abs(move).max() > 0.005
    without = fit(plane.fit.forward, replace(problem, data=data), plane.fit.point.u, 10)
    begun = settled_start(without, [(Hypothesis(ContactFriction(), NO_PLACE), np.array([0.3]))])
    assert begun is not None
    assert begun.terms[0].start == pytest.approx(0.39)


def touched() -> tuple[Potential, np.ndarray, Grip]:
    """A rough table, and nodes (4, 3) that stick, slide, have left it, or just touch down."""
    plane = rough(swept(), ROUGH).potentials[0]._replace(rubbing=np.ones(4))
    x = np.array(
        [[0.1, 0.0, -0.1502], [0.2, 0.01, -0.1503], [0.3, 0.0, -0.14], [0.4, 0.0, -0.1502]]
    )
    off = [[2e-6, -1e-6, 1e-4], [0.003, 0.002, 0.0], [0.01, 0.0, 0.0], [0.01, 0.0, 0.0]]
    return plane, x, Grip(x + np.array(off), np.array([True, True, True, False]))


def differences(function, x: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Derivatives (..., *, 3), of fourth order, of a function of each node's own place x."""
    parts = []
    for way in step * np.eye(3):
        f = [function(x + k * way) for k in (-2, -1, 1, 2)]
        parts.append((f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * step))
    return np.stack(parts, axis=-1)


def test_closed_derivatives_of_friction_are_those_of_its_energy():
    plane, x, grip = touched()
    assert plane.slope is not None
    assert plane.derivatives is not None
    one = friction.potential(plane, grip)
    assert one.derivatives is not None
    slope, rows = one.derivatives(x)
    push = plane.slope(x)  # for a normal force that stays as it is
    same = friction.potential(plane._replace(slope=lambda _: push), grip)
    assert same.slope is not None
    np.testing.assert_allclose(slope, differences(same.energy, x), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(rows, differences(same.slope, x), rtol=1e-9, atol=1e-9)
    assert (np.linalg.norm(slope[:2], axis=1) > 0).all()
    assert (slope[2:] == 0).all()
    assert one.slope is not None
    assert np.array_equal(one.slope(x), slope)
    assert np.array_equal(plane.slope(x), plane.derivatives(x)[0])


@pytest.mark.parametrize("curved", [False, True])
def test_where_nodes_are_dragged_has_closed_derivatives(curved):
    """In the nodes and in where they were held; also on a bar, whose normal turns."""
    contact, x, grip = touched()
    if curved:
        radius, below = 0.05, np.array([0.0, 0.0, -0.2])
        bare = swept()._replace(potentials=())
        values = np.array([*(below - middle_of(bare)), radius, 0.3])
        bar = rough(Obstacle().apply(bare, values), ROUGH).potentials[0]
        contact = bar._replace(rubbing=np.ones(4))
        up, (first, second) = np.array([0.0, 0.0, 1.0]), horizontal(bare.gravity)
        axis = np.cos(0.3) * first + np.sin(0.3) * second
        turns, far = np.array([0.3, -0.5, 0.1, 0.8]), radius - np.array([2e-4, 3e-4, -1e-3, 2e-4])
        around = np.outer(np.sin(turns), np.cross(axis, up)) + np.outer(np.cos(turns), up)
        moved = below + far[:, None] * around + np.outer([0.1, 0.2, 0.3, 0.4], axis)
        x, grip = moved, grip._replace(place=grip.place - x + moved)
    by_x, by_place = friction.slopes(contact, grip, x)
    in_x = differences(lambda at: friction.dragged(contact, grip, at), x)
    in_place = differences(
        lambda at: friction.dragged(contact, grip._replace(place=at), x), grip.place
    )
    np.testing.assert_allclose(by_x, in_x, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(by_place, in_place, rtol=1e-7, atol=1e-8)
    assert np.abs(by_place[:2]).max() > 0.5
    assert (by_place[3] == 0).all()
