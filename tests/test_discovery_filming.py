"""Ropes filmed in motion for the blind benchmark."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.discovery import filming, made
from benchmarks.discovery.cases import listed
from benchmarks.discovery.setting import draw
from ropefit.rod.moving import Damping, moving
from ropefit.rod.rod import build, uniform
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import solve
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle

pytest.importorskip("mujoco")
SEGMENTS, STEP = 60, 0.005


@pytest.fixture(scope="module")
def setting():
    return draw(False, np.random.default_rng(3), count=filming.POSES)


@pytest.fixture(scope="module")
def film():
    return filming.Film(period=4.0, drag=1.0, lag=0.05)


@pytest.fixture(scope="module")
def picture(setting, film):
    return filming.filmed(setting.world, setting.diameter, film)


def test_the_rope_moves_as_an_independent_solver_says(setting, film, picture):
    """The same motion, far from the shapes at rest."""
    rod = setting.rod
    p = uniform(length=rod.length, segments=SEGMENTS, bend=rod.bending, density=rod.density)
    zero = np.zeros(SEGMENTS)
    built = build(p, np.array(rod.gravity), (False, False))
    rope = moving(p, built, Damping(zero, zero, zero, zero + film.drag * rod.density))
    time = np.arange(0.0, filming.times(film)[-1] + STEP, STEP)
    pose = filming.path(setting.held, film)
    ends = np.stack([[pose(t)[0], setting.held.positions[0, 1]] for t in time])[None]
    clamp = np.full((1, len(time), 2, 4), np.nan)
    still = settle(built, Conditions(ends[:, 0], clamp[:, 0]))
    start = Start(still.x, still.q, np.zeros_like(still.x))
    found = solve(rope, Drive(time[None], ends, clamp), start)
    assert found.converged.all(), found.why()
    at = np.linspace(0.1, 0.9, 9)
    mine = CubicSpline(time, found.x[0], axis=0)(filming.times(film))
    mine = CubicSpline(np.linspace(0, 1, SEGMENTS + 1), mine, axis=1)(at)
    theirs = CubicSpline(picture[0] / rod.length, picture[1], axis=1)(at)
    rest = CubicSpline(setting.problem.mesh / rod.length, setting.states[..., :3], axis=1)(at)
    apart = np.linalg.norm(mine - theirs, axis=-1)
    moved = np.linalg.norm(theirs[:: filming.EACH] - rest, axis=-1)
    assert np.median(moved) > 0.005
    assert np.median(apart) < 0.08 * np.median(moved)


def test_ends_are_told_late_and_the_path_is_closed(setting, film):
    told = filming.seen(setting.held, film.lag / film.period)
    pose = filming.path(setting.held, film)
    for frame, time in ((0, 4.0), (50, 4.0 * 50 / filming.FRAMES)):
        true = pose(0.5 * film.period + time - film.lag)[0]
        np.testing.assert_allclose(told.positions[frame, 0], true, atol=1e-9)
    np.testing.assert_allclose(filming.seen(setting.held).positions[:: filming.EACH],
                               setting.held.positions, atol=1e-12)  # fmt: skip
    speed = [np.linalg.norm(pose(t + 1e-6)[0] - pose(t)[0]) for t in (0.0, 1e-3)]
    assert max(speed) < 1e-8  # it begins at rest


def test_a_film_is_written_with_its_causes(setting, film, picture, tmp_path):
    cause = filming._cause("time_lag", film.lag)
    told = made.Sized(cause, film.lag, 30.0, [0])
    s, nodes = picture
    one = made.Made(setting, setting.world, [told], s, nodes[::3], nodes[::3], "mujoco", 0.1)
    made.write(tmp_path / "film", tmp_path / "truth.json", "film", one, 1, "single")
    lines = (tmp_path / "film" / "ends.csv").read_text().splitlines()
    assert float(lines[3].split(",")[1]) == pytest.approx(0.1)
    (effect,) = json.loads((tmp_path / "truth.json").read_text())["effects"]
    assert (effect["name"], effect["kind"], effect["unit"]) == ("time_lag", "measurement", "s")


def test_half_of_the_filmed_ropes_are_known_at_rest():
    cases = [case for case in listed("standard", 11) if case.filmed]
    assert {case.effects[0] for case in cases} == {"inertia", "damping", "time_lag"}
    assert sum(case.nominal for case in cases) == len(cases) / 2


def test_a_lag_is_as_visible_as_it_exceeds_what_clocks_are_off(setting):
    """However exact the cloud: a clock may be off by its prior in every film."""
    scale = filming.meter(setting)
    rate = filming._round(scale.points)(np.arange(filming.POSES) / filming.POSES, 1)
    late = 0.03 * rate / 9.0  # m, of a turn in 9 s
    alone = scale.score(late)
    clocked = filming.with_clock(scale, filming.Film(period=9.0)).score(late)
    assert alone > 30
    assert clocked == pytest.approx(10, rel=0.05)
