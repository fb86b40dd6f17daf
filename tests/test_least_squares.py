"""The least-squares fit of the equilibrium model: recovery, derivatives, stations, noise, limits.

Truth comes from a rod twice as fine as the fit's. Markers, unless a test is about clouds.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from ropefit.inference.bins import Data, Stations, match
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import EndNoise, Noise, Whitener, estimate
from ropefit.inference.objective import (
    FAR,
    FORESEEN,
    FRUITLESS,
    PACE_OF,
    PACE_OPTIMISM,
    Objective,
    _Stopped,
)
from ropefit.inference.problem import FitProblem
from ropefit.inference.profile import profile_intervals
from ropefit.inference.turned import turned_jacobian, turned_residual
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration, nuisance
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare
from ropefit.solvers.equilibrium.branches import other_states
from ropefit.solvers.equilibrium.start import frames_along
from tests.ropes import GRAVITY

BINS, SD = 15, 0.0005
EYE = np.array([0.4, -1.6, 0.2])


def ends(frames: int = 6, near: float = 0.4, far: float = 0.8) -> np.ndarray:
    """(F, 2, 3) [m] a motion in space."""
    t = np.linspace(0, 1, frames)
    out = np.zeros((frames, 2, 3))
    reach, angle = near + (far - near) * t, 0.8 * t
    out[:, 1, 0], out[:, 1, 1] = reach * np.cos(angle), reach * np.sin(angle)
    out[:, 1, 2] = 0.2 * np.sin(6 * t)
    return out


def clamps(place: np.ndarray, turn: float = 0.0) -> np.ndarray:
    """(F, 2, 4) both ends along the line between them; end 1 turned about it, frame by frame."""
    line = np.stack([place[:, 0], place.mean(1), place[:, 1]], axis=1)
    q = np.repeat(frames_along(line)[:, :1], 2, axis=1)
    spin = turn * np.linspace(0.3, 1, len(place))
    about = np.stack([0 * spin, 0 * spin, spin], axis=-1)
    q[:, 1] = multiply(q[:, 1], from_rotation_vector(about))
    return q


def setup(segments: int, held: np.ndarray, clamp: np.ndarray | None = None, **rope) -> Setup:
    """A rope of 1 m and 60 g."""
    rope = {"length": 1.0, "bend": 1e-3, "density": 0.06} | rope
    if clamp is None:
        clamp = np.full((len(held), 2, 4), np.nan)
    return bare(uniform(segments=segments, **rope), GRAVITY, held, clamp, EYE)


def markers(truth: Setup, sd: float = SD, count: int = 16, seed: int = 0) -> Data:
    """Markers on the settled rope, with white noise."""
    x = Equilibrium(truth, []).at(np.empty(0)).seen
    every = truth.segments // (count - 1)
    points = x[:, ::every] + np.random.default_rng(seed).normal(0, sd, x[:, ::every].shape)
    share = np.broadcast_to(np.linspace(0, 1, count), points.shape[:2]).copy()
    return Data(points, share, np.ones(share.shape, bool), True, EYE)


def free(name: str, start: float):
    return PARAMETERS[name].within(Range(start, 1e-4 * start, 1e4 * start))


def found(base: Setup, data: Data, *names_and_starts, sd: float = SD):
    forward = Equilibrium(base, [free(*item) for item in names_and_starts])
    noise = Noise(marker=sd)
    result = fit(forward, FitProblem(data, noise, BINS))
    return result, profile_intervals(result).of


def holds(told, truth: float) -> bool:
    """The truth within twice the interval: one in twenty would miss a single one."""
    low, high = told.interval
    return low**2 / told.value < truth < high**2 / told.value


def test_bending_rigidity_comes_back_from_either_side():
    data = markers(setup(60, ends(), bend=8e-4))
    for start in (1e-4, 6e-3):
        result, told = found(setup(30, ends()), data, ("EI", start))
        assert result.converged
        assert told["EI"].verdict == "determined"
        assert holds(told["EI"], 8e-4)
        assert told["EI"].interval[1] / told["EI"].interval[0] < 1.2


def test_twist_rigidity_comes_back_when_clamps_twist_the_rope():
    held = ends(near=0.55, far=0.75)
    clamp = clamps(held, turn=2.0)
    truth = setup(300, held, clamp, bend=8e-4, twist=1.2e-3)
    base = setup(150, held, clamp, bend=8e-4)  # a clamp bends the rope sharply: fine segments
    _, told = found(base, markers(truth), ("EI", 5e-4), ("GJ", 5e-4))
    assert told["GJ"].verdict == "determined"
    assert holds(told["GJ"], 1.2e-3)
    assert holds(told["EI"], 8e-4)


def test_axial_rigidity_comes_back_when_pulled_taut():
    held = ends(near=0.98, far=1.01)
    truth = setup(60, held, bend=8e-4, axial=200.0)
    _, told = found(setup(30, held, bend=8e-4, axial=50.0), markers(truth), ("EA", 50.0))
    assert told["EA"].verdict == "determined"
    assert holds(told["EA"], 200.0)


def test_length_comes_back_with_the_rigidity():
    data = markers(setup(60, ends(), bend=8e-4, length=1.015))
    _, told = found(setup(30, ends()), data, ("EI", 1e-3), ("length", 1.0))
    assert holds(told["length"], 1.015)
    assert told["length"].interval[1] / told["length"].interval[0] < 1.01
    assert holds(told["EI"], 8e-4)


def test_twist_rigidity_does_nothing_to_a_pinned_rope():
    _, told = found(setup(30, ends()), markers(setup(60, ends())), ("EI", 1e-3), ("GJ", 1e-3))
    assert told["GJ"].verdict == "dead"
    assert told["GJ"].interval is None


@pytest.mark.parametrize("held", ["pinned", "clamped", "free"])
def test_every_term_has_the_right_derivative(held):
    """Against central differences of what is seen, for each value of each term."""
    place = ends(3)
    clamp = clamps(place, 1.0) if held == "clamped" else None
    if held == "free":
        place[:, 1] = np.nan
    rope = setup(20, place, clamp, axial=60.0)
    terms = [free("EI", 1e-3), free("GJ", 7e-4), free("EA", 60.0), free("length", 1.0)]
    errors = calibration(rope, Priors(), shared=False)
    assert sum(t.size for t in errors) == {"pinned": 16, "clamped": 22, "free": 13}[held]
    forward = Equilibrium(rope, [*terms, *errors])
    low, high = forward.bounds()
    u = np.random.default_rng(1).normal(0, 0.1, forward.size).clip(low, high)
    point = forward.at(u)
    assert point.solution.converged.all()
    exact = forward.jacobian(point)
    names = [f"{t.name} {name}" for t in forward.terms for name in t.names]
    for k, name in enumerate(names):
        step = np.zeros(forward.size)
        step[k] = 1e-4
        sides = [forward.at(u + s * step).seen for s in (1, -1)]
        measured = (sides[0] - sides[1]) / 2e-4
        size = max(np.abs(measured).max(), 1e-6)
        # What the sensor's own small errors change of a change is left out: second order.
        assert np.abs(exact[k] - measured).max() < 5e-3 * size + 1e-7, name


def line(frames: int = 4, nodes: int = 16) -> np.ndarray:
    """(F, K, 3) [m] the settled rope."""
    return Equilibrium(setup(nodes - 1, ends(frames)), []).at(np.empty(0)).seen


def cloud(x: np.ndarray, count: int, sd: float, seed: int = 0) -> Data:
    """Points scattered about the curve through nodes x, roughly at their true share."""
    rng = np.random.default_rng(seed)
    share = np.sort(rng.uniform(0, 1, (len(x), count)), axis=1)
    at = share * (x.shape[1] - 1)
    low = np.minimum(at.astype(int), x.shape[1] - 2)
    rest, rows = (at - low)[..., None], np.arange(len(x))[:, None]
    points = (1 - rest) * x[rows, low] + rest * x[rows, low + 1]
    points += rng.normal(0, sd, points.shape)
    return Data(points, share, np.ones(share.shape, bool), False, EYE)


@pytest.fixture(scope="module")
def curve() -> np.ndarray:
    """(4, 121, 3) [m] a rope so fine that its chords are its curve."""
    return line(nodes=121)


def test_a_known_offset_comes_back_across_the_curve(curve):
    shift = np.array([0.0, 0.004, 0.0])
    data = cloud(curve, 600, 0.0005)
    moved = replace(data, points=data.points + shift)
    s = match(moved, curve, BINS)
    assert np.allclose(s.residual, s.basis @ shift, atol=4e-4)
    assert np.allclose(np.sqrt(s.scatter), 0.0005, rtol=0.1)
    assert 0.93 * 2400 < s.count.sum() <= 2400  # outliers count less


def test_markers_count_in_three_dimensions(curve):
    data = cloud(curve, 20, 0.0)
    shift = np.array([0.003, -0.001, 0.002])
    mask = data.mask.copy()
    mask[1, 4:9] = False
    s = match(replace(data, points=data.points + shift, material=True, mask=mask), curve, BINS)
    assert s.residual.shape == (4 * 20 - 5, 3)
    assert np.allclose(s.residual, shift, atol=1e-4)
    assert not np.any((s.frame == 1) & (s.bin >= 4) & (s.bin < 9))


def test_what_was_not_seen_gives_no_station(curve):
    data = cloud(curve, 600, 0.0005)
    hidden = data.mask & ~((data.share > 0.4) & (data.share < 0.6))
    s = match(replace(data, mask=hidden), curve, BINS)
    assert not np.any((s.bin >= 6) & (s.bin < 9))
    assert len(match(data, curve, BINS).frame) - len(s.frame) == 4 * 3


def test_stations_hardly_mind_five_percent_of_outliers(curve):
    data = cloud(curve, 600, 0.001)
    rng = np.random.default_rng(5)
    stray = rng.random(data.share.shape) < 0.05
    points = data.points.copy()
    points[stray] += rng.normal(0, 0.02, (int(stray.sum()), 3))
    clean, dirty = (match(replace(data, points=p), curve, BINS) for p in (data.points, points))
    rms = [float(np.sqrt((s.residual**2).mean())) for s in (clean, dirty)]
    assert rms[1] < 1.35 * rms[0]
    assert np.sqrt(dirty.scatter[0, 0]) < 1.25 * np.sqrt(clean.scatter[0, 0])


def planted(correlated: float, length: float, white: float, frames: int = 30) -> Stations:
    """Stations whose residual is noise of a known kind."""
    rng = np.random.default_rng(7)
    share = np.tile((np.arange(BINS) + 0.5) / BINS, frames)
    apart = np.abs(share[:BINS, None] - share[None, :BINS])
    factor = np.linalg.cholesky(np.exp(-apart / length) + 1e-12 * np.eye(BINS))
    residual = correlated * np.einsum("ij,fjd->fid", factor, rng.normal(size=(frames, BINS, 2)))
    residual = residual.reshape(-1, 2) + rng.normal(0, white, (frames * BINS, 2))
    many = frames * BINS
    return Stations(
        np.repeat(np.arange(frames), BINS), np.tile(np.arange(BINS), frames), share, np.ones(many),
        residual, np.zeros((many, 2, 3)), np.zeros(many, int), np.zeros((many, 4)),
        np.full((many, 2), white**2), np.zeros((many, 2)),
    )  # fmt: skip


def test_planted_correlated_noise_is_measured():
    s = planted(0.0015, 0.12, 0.0005)
    noise = estimate(s, Noise())
    assert 0.0011 < noise.correlated < 0.002
    assert noise.length in (0.06, 0.12, 0.25)
    z = Whitener.of(s, noise)(s.residual)
    assert 0.85 < z.std() < 1.15
    assert estimate(planted(0.0, 0.1, 0.0005), Noise()).correlated <= 0.35 * 0.00052


def test_noise_of_the_ends_is_told_from_noise_along_the_rope():
    s = planted(0.0, 0.1, 0.0005)
    rng = np.random.default_rng(4)
    frames = int(s.frame.max()) + 1
    # Two ends: what one does to the rope fades towards the other, in either component.
    near = np.stack([1 - s.share, s.share], axis=1)
    columns = np.zeros((*s.residual.shape, 4))
    for d in range(2):
        columns[:, d, 2 * d : 2 * d + 2] = near
    moved = 0.0005 * rng.normal(size=(frames, 4))
    shaken = replace(s, residual=s.residual + np.einsum("mdp,mp->md", columns, moved[s.frame]))
    ends = EndNoise(shaken, columns, np.zeros((*s.residual.shape, 0)))
    noise = estimate(shaken, Noise(ends=ends))
    assert noise.ends is not None
    assert 0.0003 <= noise.ends.sd[0] <= 0.0008
    z = Whitener.of(shaken, noise)(shaken.residual)
    assert 0.9 < z.std() < 1.1
    quiet = estimate(s, Noise(ends=EndNoise(s, columns, np.zeros((*s.residual.shape, 0)))))
    assert quiet.ends is not None
    assert quiet.ends.sd[0] <= 0.0001


def test_what_a_model_may_have_missed_is_not_taken_for_noise():
    s = planted(0.0, 0.1, 0.0005)
    shape = np.stack([np.sin(3 * s.share), np.cos(2 * s.share)], axis=1)
    missed = replace(s, residual=s.residual + 0.004 * shape)
    assert estimate(missed, Noise()).correlated > 0.001
    design = 0.01 * np.concatenate([shape.reshape(-1, 1)], axis=1)
    assert estimate(missed, Noise(), design).correlated < 0.0003


def test_points_that_count_stay_the_same_under_another_rope():
    held = ends(4, 0.5, 0.7)
    data = markers(setup(60, held), 0.001)
    cloud = replace(data, material=False)
    near = Equilibrium(setup(30, held), []).at(np.empty(0)).seen
    settled = cloud.settled(near)
    first, other = match(settled, near, 10), match(settled, near + 0.02, 10)
    assert first.frame.tolist() == other.frame.tolist()
    assert first.bin.tolist() == other.bin.tolist()


def test_a_soft_rope_is_told_below_a_limit_not_a_number():
    held = ends(4, 0.5, 0.7)
    truth = setup(60, held, bend=1e-8)
    _, told = found(setup(30, held, bend=1e-5), markers(truth, 0.003), ("EI", 1e-5), sd=0.003)
    assert told["EI"].interval is None
    assert told["EI"].verdict == "flat direction"
    assert 1e-8 < told["EI"].below < 3e-3


def test_frames_that_do_not_settle_are_left_out_of_the_fit():
    """The ends of one frame are farther apart than the rope is long."""
    data = markers(setup(60, ends(), bend=8e-4))
    torn = ends()
    torn[2, 1] *= 3
    forward = Equilibrium(setup(30, torn), [free("EI", 1e-3)])
    result = fit(forward, FitProblem(data, Noise(marker=SD), BINS))
    assert not result.point.solution.converged[2]
    assert np.isnan(result.point.seen[2]).all()
    assert not np.any(result.stations.frame == 2)
    assert abs(np.log(float(forward.terms[0].value(result.point.u)[0]) / 8e-4)) < 0.1
    torn[:, 1] *= 3
    with pytest.raises(ArithmeticError, match="no frame"):
        fit(
            Equilibrium(setup(30, torn), [free("EI", 1e-3)]),
            FitProblem(data, Noise(marker=SD), BINS),
        )


def test_calibration_errors_are_held_to_their_priors():
    """An error that the data cannot see stays at zero, with the prior's own uncertainty."""
    blind = nuisance("nothing", ["a"], ["m"], lambda setup, v: setup, [0.002])
    forward = Equilibrium(setup(30, ends()), [free("EI", 1e-3), blind])
    result = fit(forward, FitProblem(markers(setup(60, ends())), Noise(marker=SD), BINS))
    assert result.point.u[1] == pytest.approx(0, abs=1e-6)
    assert result.sd()[1] == pytest.approx(1)


@pytest.mark.parametrize("arch", [True, False])
def test_a_second_equilibrium_is_found_where_there_is_one(arch):
    """An arch held upright falls to one side or to the other; a pinned rope hangs in one way."""
    held = np.zeros((1, 2, 3))
    held[0, 1, 0] = 0.3
    up = np.array([[[0.0, 0, 0], [0, 0, 0.5], [0, 0, 1]]])
    clamp = np.concatenate([frames_along(up)[:, :1], frames_along(-up)[:, :1]], axis=1)
    point = Equilibrium(setup(40, held, clamp if arch else None, bend=5e-3), []).at(np.empty(0))
    assert point.solution.converged.all()
    apart = other_states(point.solution)[1]
    if arch:
        assert 0.1 < apart[0] < 1.0
    else:
        assert np.isnan(apart[0])


def test_a_fit_without_prospect_of_what_is_needed_is_stopped():
    """One that reaches it takes the same steps as without."""
    data = markers(setup(60, ends()))
    model = Equilibrium(setup(30, ends()), [free("EI", 3e-4)])
    problem = FitProblem(data, Noise(marker=SD), BINS)
    whole = fit(model, problem)
    assert not whole.stopped
    stopped = fit(model, problem, needed=0.5 * whole.cost)
    assert stopped.stopped
    assert not stopped.converged
    assert stopped.evaluations < whole.evaluations
    assert stopped.cost == pytest.approx(stopped.z @ stopped.z)
    reached = fit(model, problem, needed=1.01 * whole.cost)
    assert not reached.stopped
    assert reached.cost == pytest.approx(whole.cost, rel=1e-9)


def test_a_fit_that_begins_too_far_off_is_stopped_there():
    model = Equilibrium(setup(30, ends()), [free("EI", 3e-4)])
    problem = FitProblem(markers(setup(60, ends())), Noise(marker=SD), BINS)
    whole = fit(model, problem)
    stopped = fit(model, problem, highest=0.99 * whole.trace[0])
    assert stopped.stopped
    assert stopped.trace == pytest.approx(whole.trace[:1])
    reached = fit(model, problem, highest=1.01 * whole.trace[0])
    assert reached.cost == pytest.approx(whole.cost)


def test_a_fit_ends_where_a_linear_step_promises_nothing():
    """There no further evaluation is made, and the values are those of one that is made."""
    model = Equilibrium(setup(30, ends()), [free("EI", 3e-4)])
    problem = FitProblem(markers(setup(60, ends())), Noise(marker=SD), BINS)
    whole, rough = fit(model, problem, tolerance=1e-12), fit(model, problem, tolerance=1e-5)
    assert rough.converged
    assert len(rough.trace) < len(whole.trace)
    promised = rough.cost - whole.cost
    assert promised < FORESEEN * 1e-5 * rough.cost
    assert abs(rough.point.u - whole.point.u) < 0.1 * whole.sd()
    again = fit(model.starting_from(whole.point.solution), problem, whole.point.u, tolerance=1e-5)
    assert again.converged
    assert len(again.trace) == 1


@pytest.mark.parametrize("creeps", [False, True])
def test_a_fit_too_slow_for_what_is_needed_is_stopped(monkeypatch, creeps):
    """Whatever its linear steps foresee: here much more than each achieves."""
    forward = Equilibrium(setup(30, ends()), [free("EI", 3e-3)])
    problem = FitProblem(markers(setup(60, ends())), Noise(marker=SD), BINS)
    exact = Objective.jacobian

    def steep(self: Objective, u: np.ndarray) -> np.ndarray:
        return (10.0 if creeps else 1.0) * exact(self, u)

    monkeypatch.setattr(Objective, "jacobian", steep)
    free_to_end = fit(forward, problem, evaluations=9)
    needed = 0.9 * free_to_end.cost if creeps else 1.01 * free_to_end.cost
    found = fit(forward, problem, evaluations=9, needed=needed)
    assert found.stopped == creeps
    if creeps:
        assert len(found.trace) > PACE_OF
        gained = (found.trace[-1 - PACE_OF] - found.trace[-1]) / PACE_OF
        reach = found.trace[-1] - PACE_OPTIMISM * (9 - len(found.trace)) * gained
        assert reach > (1 + FAR) * needed


def test_a_fit_ends_where_the_predicted_decrease_is_not_achieved(monkeypatch):
    base = setup(30, ends())
    forward = Equilibrium(base, [free("EI", 2e-3)])
    problem = FitProblem(markers(setup(60, ends())), Noise(marker=SD), BINS)
    best = fit(forward, problem)
    exact = Objective.jacobian

    def misled(self, u):
        # Along the residual: a decrease is predicted.
        return exact(self, u) + 0.5 * self.at(u)[2][:, None]

    monkeypatch.setattr(Objective, "jacobian", misled)
    again = fit(forward.starting_from(best.point.solution), problem, best.point.u)
    assert again.converged
    assert len(again.trace) <= 2 + FRUITLESS
    np.testing.assert_allclose(again.point.u, best.point.u, atol=1e-6)


@pytest.mark.parametrize(
    ("costs", "evaluations"),
    [
        ([100.0, 99.0, 99.01, 99.02, 90.0], 4),  # they hardly differ
        ([100.0, 99.0, 104.0, 103.0, 90.0], 5),
        ([100.0, 99.0, 98.99, 98.98, 98.97], 5),  # each lowers it
        ([100.0, 99.0, *5 * [104.0], 90.0], 2 + FRUITLESS),
    ],
)
def test_a_fit_ends_where_evaluations_change_nothing(monkeypatch, costs, evaluations):
    objective = Objective.__new__(Objective)
    objective.trace, objective.best, objective.rubs = [], np.zeros(1), False

    def rows(self, u):
        self.trace.append(costs[len(self.trace)])
        return u

    monkeypatch.setattr(Objective, "rows", rows)
    with contextlib.suppress(IndexError, _Stopped):
        while True:
            objective.patient_rows(np.zeros(1), 0)
    assert len(objective.trace) == evaluations


@pytest.mark.parametrize("rows", [3, 500, 20_000])
def test_a_turned_residual_and_its_jacobian_are_the_same_to_an_optimiser(rows):
    rng = np.random.default_rng(5)
    jacobian, z = rng.normal(size=(rows, 4)) * [1.0, 1e-3, 1e3, 1.0], rng.normal(size=rows)
    half = rows // 2
    small = turned_jacobian([(jacobian[:half], z[:half]), (jacobian[half:], z[half:])])
    one = turned_residual(float(z @ z), 4)
    assert small.shape == (5, 4)
    assert one @ one == pytest.approx(z @ z, rel=1e-12)
    size = np.linalg.norm(jacobian, axis=0)
    assert small.T @ one / size == pytest.approx(jacobian.T @ z / size, rel=1e-11)
    both = np.outer(size, size)
    assert small.T @ small / both == pytest.approx(jacobian.T @ jacobian / both, abs=1e-12)
