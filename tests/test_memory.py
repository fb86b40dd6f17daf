"""Ropes that remember: the laws against their closed forms, shapes against beam theory, derivatives
against differences, and concealed effects found again."""

import numpy as np
import pytest

from ropefit.diagnosis.search import search
from ropefit.effects import BendingHysteresis, PlasticSet, ViscoelasticCreep
from ropefit.effects.revisit import revisits
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.history import WalkedPoint, laws_of, vectors
from ropefit.models.parameters import set_bend
from ropefit.models.terms import Term
from ropefit.rod import memory
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare
from tests import concealed
from tests.concealed import EI, EYE

EFFECTS = [
    (BendingHysteresis(), [3e-4, 1.0]),
    (PlasticSet(), [0.4, 4.0]),
    (ViscoelasticCreep(), [0.4, 2.0]),
]


def there_and_back(segments: int, frames: int = 24, bend: float = EI) -> Setup:
    """A pinned rope whose end 0 goes to and fro twice on nearly one path, and rests in between."""
    n = np.arange(frames)
    share = 0.5 - 0.5 * np.cos(4 * np.pi * n / (frames - 1))
    path = np.stack(
        [0.85 - 0.6 * share, 0.1 * np.sin(3 * share) + 0.05 * n / frames, 0.15 * share**2], axis=1
    )
    ends = np.stack([path, np.zeros_like(path)], axis=1)
    gravity = np.array([0.0, 0.0, -9.81])
    clamp = np.full((frames, 2, 4), np.nan)
    made = uniform(length=1.0, segments=segments, bend=bend, density=0.06)
    setup = bare(made, gravity, ends, clamp, np.array(EYE))
    return setup._replace(time=np.cumsum(np.where(n % 6 == 0, 3.0, 0.5)))


def cantilever(load: np.ndarray, time: np.ndarray, segments: int = 60) -> Setup:
    """A weightless rod clamped along x at end 0, with a force (F,) [N] down at its tip."""
    frames = len(load)
    made = uniform(length=1.0, segments=segments, bend=1.0, density=1e-9)
    ends = np.zeros((frames, 2, 3))
    ends[:, 1] = np.nan
    clamp = np.full((frames, 2, 4), np.nan)
    clamp[:, 0] = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])
    gravity = np.array([0.0, 0.0, -9.81])
    setup = bare(made, gravity, ends, clamp, np.zeros(3))
    force = np.zeros((frames, segments + 1, 3))
    force[:, -1, 2] = -load
    return setup._replace(load=force, time=time)


def with_effect(setup: Setup, effect, values) -> Setup:
    return effect.apply(setup, np.array(values))


def settled(setup: Setup) -> WalkedPoint:
    point = Equilibrium(setup, []).at(np.empty(0))
    assert point.solution.converged.all()
    assert isinstance(point, WalkedPoint)
    return point


def forces(effect, values, curvature: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(F,) [N m] moments of one bend element's branch on a path of curvatures (F, 2) [1/m]."""
    setup = with_effect(cantilever(np.zeros(len(time)), time), effect, values)
    law, node = laws_of(setup), 7
    length = float(setup.properties.length[node])
    state = memory.unloaded(np.zeros((setup.segments + 1, 2)), 1)
    out = []
    for t, k in enumerate(curvature):
        vector = np.zeros_like(state.vector)
        vector[node] = 0.5 * length * k
        state = memory.after(law, t, t == 0, state, vector)
        out.append(0.5 * law.drag[0, node] * state.strain[0, node])  # v = turn / 2
    return np.array(out)


def test_one_element_goes_round_a_prandtl_loop():
    path = np.concatenate([np.linspace(0, 3, 13), np.linspace(3, -3, 25), np.linspace(-3, 3, 25)])
    path = np.stack([path, 0 * path], axis=1)
    time = np.arange(len(path)) * 1.0
    found = forces(BendingHysteresis(), [0.2, 1.0], path, time)[:, 0]
    up, down = (
        np.clip(0.2 * path[:13, 0], 0, 0.2),
        np.clip(0.2 - 0.2 * (3 - path[13:38, 0]), -0.2, 0.2),
    )
    np.testing.assert_allclose(found[:13], up, atol=1e-12)
    np.testing.assert_allclose(found[13:38], down, atol=1e-12)
    # The loop's area is what friction takes: moment times the path slipped there and back.
    lost = np.trapezoid(found[12:], path[12:, 0])
    assert lost == pytest.approx(2 * 0.2 * (6 - 2 * 1.0), rel=1e-12)


def test_one_element_yields_radially_and_keeps_a_set():
    way = np.array([0.6, 0.8])
    path = np.array([0.0, 2.0, 5.0, 2.5])[:, None] * way
    found = forces(PlasticSet(), [0.3, 3.0], path, np.arange(4.0))
    # Elastic to 3, then sliding; back by 2.5 of the excess of 2 that it has kept.
    np.testing.assert_allclose(found, 0.3 * np.array([0, 2, 3, 0.5])[:, None] * way, atol=1e-12)


@pytest.mark.parametrize("steps", [1, 7])
def test_one_element_relaxes_as_maxwell_says(steps):
    """A ramp in any number of steps, then rest: exact for both."""
    tau, share = 2.0, 0.4
    time = np.r_[np.linspace(0, 3, steps + 1), 3.5, 7.0]
    path = np.r_[np.linspace(0, 1.5, steps + 1), 1.5, 1.5]
    found = forces(ViscoelasticCreep(), [share, tau], np.stack([0 * path, path], 1), time)[:, 1]
    ramp = share * 0.5 * tau * (1 - np.exp(-np.minimum(time, 3.0) / tau))
    np.testing.assert_allclose(found, ramp * np.exp(-np.maximum(time - 3, 0) / tau), atol=1e-12)


def test_a_cantilever_creeps_like_a_standard_linear_solid():
    share, tau, load = 0.5, 2.0, 1e-3
    time = np.r_[0.0, 1e-6 + np.linspace(0, 8, 41)]
    force = np.r_[0.0, np.full(41, load)]
    point = settled(with_effect(cantilever(force, time), ViscoelasticCreep(), [share, tau]))
    drop = -point.seen[:, -1, 2]
    late = load / 3  # P L³ / 3 EI of a relaxed rod
    wanted = late * (1 - share / (1 + share) * np.exp(-time / (tau * (1 + share))))
    np.testing.assert_allclose(drop[1:], wanted[1:], rtol=1e-3)
    assert drop[0] == pytest.approx(0.0, abs=1e-8)


def test_a_cantilever_bent_too_far_keeps_the_set_of_beam_theory():
    share, most, load = 0.4, 0.02, 0.035
    point = settled(
        with_effect(cantilever(np.array([load, 0.0]), np.arange(2.0)), PlasticSet(), [share, most])
    )
    step = point.steps[-1]
    (left,) = vectors(step.solution)
    size = 2 * np.linalg.norm(left, axis=1)[1:-1] * 60  # 1/m
    arm = 1 - point.setup.arc[1:-1]
    # EI = 1: (1 - h) k + h k_y = M beyond the yield curvature k_y, and k = h (k - k_y) once free.
    excess = np.maximum((load * arm - share * most) / (1 - share) - most, 0)
    np.testing.assert_allclose(size, share * excess, atol=2e-3 * share * excess.max())
    assert (size > 1e-4).sum() > 20


def test_same_pose_other_shape_on_the_way_back():
    setup = there_and_back(60)
    path = setup.ends.copy()
    path[12:] = path[:12][::-1]
    setup = setup._replace(ends=path)
    plain = Equilibrium(setup, []).at(np.empty(0)).seen
    np.testing.assert_allclose(plain[:12], plain[12:][::-1], atol=1e-8)
    for effect, values in EFFECTS:
        seen = settled(with_effect(setup, effect, values)).seen
        apart = np.abs(seen[:12] - seen[12:][::-1]).max(axis=(1, 2))
        assert apart[4:10].max() > 5e-4


@pytest.mark.parametrize(("effect", "values"), EFFECTS)
def test_derivatives_through_the_history_are_exact(effect, values):
    check_derivatives(effect, values)


def check_derivatives(effect, values) -> None:
    """Of rigidity, ends and the effect itself, in frames of which some are not shown."""
    few = np.array([1, 2, 4, 7, 10])
    setup = there_and_back(50, 12).frames(few)
    free = np.full(2, np.inf)

    def moved(setup: Setup, v: np.ndarray) -> Setup:
        by = np.array([[0.3, 0.1, 0.2], [0.0, 0.0, 0.0]])
        return setup._replace(ends=setup.ends + v[0] * by)

    def one(name, apply, start, scale):
        return Term(name, (name,), ("",), apply, np.array([start]), np.array([scale]), -free[:1],
                    free[:1], free[:1])  # fmt: skip

    scale = np.array(values)
    term = Term(effect.name, effect.names, ("",) * 2, effect.apply, scale, scale, -free, free, free)
    terms = [one("EI", set_bend, EI, EI), one("ends", moved, 0.0, 0.1), term]
    forward = Equilibrium(setup, terms)
    point = forward.at(np.zeros(4))
    assert point.solution.converged.all()
    found = forward.jacobian(point)
    for k in range(4):
        # Long steps change what slips where, short ones show where the solver stopped.
        errors = [difference(forward, k, step, found[k]) for step in (1e-5, 3e-4, 1e-3, 3e-3)]
        assert min(errors) < 1e-6


def difference(forward: Equilibrium, k: int, step: float, found: np.ndarray) -> float:
    """Largest error of a derivative against differences of fourth order, over the largest."""
    seen = {n: forward.at(n * step * np.eye(forward.size)[k]).seen for n in (-2, -1, 1, 2)}
    wanted = (8 * (seen[1] - seen[-1]) - (seen[2] - seen[-2])) / (12 * step)
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


def test_frames_that_are_not_shown_are_remembered():
    setup = with_effect(there_and_back(50, 16), *EFFECTS[0])
    whole = settled(setup).seen
    few = np.array([2, 3, 7, 11, 15])
    later = setup.frames(few).frames(np.array([1, 3, 4]))
    np.testing.assert_allclose(settled(later).seen, whole[[3, 11, 15]], atol=1e-9)
    forgotten = setup.frames(np.array([3, 11, 15]))._replace(past=None)
    assert np.abs(settled(forgotten).seen[1] - whole[11]).max() > 1e-4


def test_a_new_clip_begins_without_a_past():
    setup = with_effect(there_and_back(50, 16), *EFFECTS[2])
    time = setup.time.copy()
    time[8:] -= float(time[8])
    two = settled(setup._replace(time=time)).seen
    again = settled(
        setup._replace(ends=setup.ends[8:], clamp=setup.clamp[8:], time=time[8:],
                       sensor=setup.frames(np.arange(8, 16)).sensor)
    ).seen  # fmt: skip
    np.testing.assert_allclose(two[8:], again, atol=1e-9)


def test_only_recordings_that_come_back_can_show_memory():
    setup = there_and_back(20)
    assert revisits(setup)
    assert not revisits(setup._replace(ends=setup.ends[:7], clamp=setup.clamp[:7]))
    away = setup.ends.copy()
    away[:, 0, 0] = np.linspace(0.9, 0.2, 24)
    away[:, 0, 1:] = 0
    assert not revisits(setup._replace(ends=away))
    assert not BendingHysteresis().applies(setup._replace(ends=away))


def diagnosed(data):
    return search(concealed.nominal_fit(data, 72), 0, lambda share, text: None)


@pytest.fixture
def looped(monkeypatch):
    """The recordings of `concealed` go to and fro."""
    monkeypatch.setattr(
        concealed,
        "rope",
        lambda segments, frames=24, bend=EI: there_and_back(segments, frames, bend),
    )


def test_friction_inside_the_rope_is_found(looped):
    made = with_effect(there_and_back(216), BendingHysteresis(), [1.5e-4, 1.0])
    d = diagnosed(concealed.recorded(made, seed=1))
    assert d.verdict == "found"
    candidates = [d.accepted[0].candidate, *d.accepted[0].equivalent]
    mine = next(r for r in candidates if r.hypothesis.name == "bending_hysteresis")
    value, sd = mine.values()[0], mine.sd()[0]
    assert abs(value - 1.5e-4) < 3 * sd + 0.03 * 1.5e-4
    assert mine.gains.min() > 0


def test_going_to_and_fro_is_no_reason_for_an_alarm(looped):
    d = diagnosed(concealed.recorded(there_and_back(216), seed=4))
    assert d.verdict == "none"
    assert d.detectable["bending_hysteresis"] < 1e-4  # N m
