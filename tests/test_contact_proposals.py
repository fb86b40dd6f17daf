"""Planes and bars are looked for where the rope is, not where a camera that is off sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis import beginning, contact_beside
from ropefit.diagnosis.beginning import most_promising_first
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.candidates import fit_candidates
from ropefit.diagnosis.contact_beside import by_contact
from ropefit.diagnosis.fits import Fits
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.proposals import misfit_of, proposals, proposals_beside
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.effects import Obstacle, PointMass, SupportPlane
from ropefit.effects.misfit import Misfit
from ropefit.effects.obstacle import heading_across
from ropefit.effects.place import horizontal, middle_of
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.priors import shift_camera
from ropefit.models.response import Point
from tests.concealed import BINS, bar_under, nominal_fit, recorded, rope

DEPTH = 0.002  # m by which the rope would sink into the table in the less low of two frames


def of(point: Point) -> Misfit:
    """What a fit at a point leaves, without data."""
    none = np.empty((0, 3))
    return Misfit(
        point.setup, point.setup, np.empty((0, 0, 3)), np.empty((0, 0), bool), point.seen,
        np.empty(0, int), none, none, 0.0,
        np.zeros(len(point.seen)), frozenset(), list,
        forces=lambda _: pytest.fail("contact tries no fields"),
    )  # fmt: skip


@pytest.mark.parametrize("higher", [-0.004, 0.0, 0.004])
def test_a_table_is_found_although_the_camera_is_off(higher):
    free = rope(288)
    lowest = np.sort(Equilibrium(free, []).at(np.empty(0)).seen[..., 2].min(axis=1))
    height = lowest[1] + DEPTH - float(middle_of(free)[2])
    table = SupportPlane().apply(free, np.array([height, 0.0, 0.0]))
    off = np.array([0.0, 0.0, higher])
    data = recorded(shift_camera(table, off), seed=8)
    nominal = nominal_fit(data)
    data = data.settled(nominal.point.seen)
    nominal = fit(nominal.forward, FitProblem(data, Noise(), BINS), nominal.point.u)
    ((hypothesis, start),) = next(
        p for p in proposals(nominal, slow=True) if p[0][0].name == "support_plane"
    )
    assert start[0] == pytest.approx(height, abs=0.0015)
    candidate = fit_candidate(nominal, hypothesis, start)
    assert candidate is not None
    assert candidate.evidence > 30
    assert candidate.values()[0] == pytest.approx(height, abs=0.001)


def test_a_table_is_proposed_no_lower_than_the_points_are():
    """A rope that hangs deep below a table is compared with places far below the points."""
    free = rope(288)
    nodes = Equilibrium(free, []).at(np.empty(0)).seen
    frames, low = len(nodes), nodes[..., 2].min(axis=1)
    height = np.quantile(low, 0.3) + 0.01  # of a table that bears the rope in many frames
    cloud = nodes[:, 3:-3].copy()
    cloud[..., 2] = np.maximum(cloud[..., 2], height) + 0.004  # on the rope's surface
    deep = low < height - 0.02
    assert 2 <= deep.sum() < 0.5 * frames
    seen = np.maximum(nodes[:, 3:-3, 2], np.where(deep, 0.5 * (height + low), height)[:, None])
    places = nodes[:, 3:-3].reshape(-1, 3)
    moves = np.zeros_like(places)
    moves[:, 2] = seen.ravel() - places[:, 2]
    misfit = replace(
        of(Equilibrium(free, []).at(np.empty(0))),
        points=cloud, counts=np.ones(cloud.shape[:2], bool),
        frame=np.repeat(np.arange(frames), cloud.shape[1]), places=places, moves=moves,
        variance=2e-6,
    )  # fmt: skip
    ((start,),) = SupportPlane().starts(misfit)
    assert start[0] == pytest.approx(height - float(middle_of(free)[2]), abs=0.002)
    # As before where no points are known.
    ((blind,),) = SupportPlane().starts(replace(misfit, counts=np.zeros_like(misfit.counts)))
    assert blind[0] < start[0] - 0.005


def test_bars_are_tried_where_a_slope_bears_the_rope():
    free, slopes = rope(288), np.array([0.1, -0.05])
    lowest = np.sort(Equilibrium(free, []).at(np.empty(0)).seen[..., 2].min(axis=1))
    height = lowest[1] + DEPTH - float(middle_of(free)[2])
    values = np.array([height, *slopes])
    point = Equilibrium(SupportPlane().apply(free, values), []).at(np.empty(0))
    starts = Obstacle().starts_beside(SupportPlane(), values, of(point))
    first, second = horizontal(free.gravity)
    normal = np.array([0.0, 0.0, 1.0]) - slopes[0] * first - slopes[1] * second
    normal /= np.linalg.norm(normal)
    nodes = point.seen - middle_of(free)
    radii = []
    for (at,) in starts:
        top = at[:3] + at[3] * normal
        assert top @ normal == pytest.approx(height * normal[2], abs=5e-4)
        assert np.linalg.norm(nodes - top, axis=-1).min() < 0.002
        radii.append(at[3])
    assert radii == [0.03, 0.01]


def test_a_plane_is_tried_where_a_bar_bears_the_rope():
    """In few frames a plane that touches the bar where the rope does is as good."""
    free = rope(288)
    nodes = Equilibrium(free, []).at(np.empty(0)).seen - middle_of(free)
    frame = int(nodes[..., 2].min(axis=1).argmin())
    low = nodes[frame, nodes[frame, :, 2].argmin()]
    radius, heading = 0.03, heading_across(free)
    beside = np.array([0.01, 0.0, DEPTH - radius])
    values = np.array([*(low + beside), radius, heading])
    point = Equilibrium(Obstacle().apply(free, values), []).at(np.empty(0))
    ((tangent, level),) = SupportPlane().starts_beside(Obstacle(), values, of(point))
    assert np.abs(tangent[1:]).max() > 0.01
    touched = Equilibrium(SupportPlane().apply(free, tangent), [])
    apart = np.linalg.norm(touched.at(np.empty(0)).seen - point.seen, axis=-1)[frame]
    moved = np.linalg.norm(point.seen[frame] - nodes[frame] - middle_of(free), axis=-1)
    assert apart.max() < 0.25 * moved.max()
    assert level[0] == pytest.approx(low[2] + DEPTH, abs=0.002)
    assert not level[1:].any()


def test_there_is_no_bar_where_nothing_is_touched():
    point = Equilibrium(rope(288), []).at(np.empty(0))
    below = np.array([-2.0, 0.0, 0.0])
    assert Obstacle().starts_beside(SupportPlane(), below, of(point)) == []


def test_no_plane_is_proposed_beside_a_plane():
    """What is fitted already is no other effect: from its own values it would be fitted again."""
    free = rope(144)
    nominal = nominal_fit(recorded(free, seed=2))
    lowest = float(nominal.point.seen[..., 2].min()) - float(middle_of(free)[2])
    values = np.array([lowest + DEPTH, 0.0, 0.0])
    assert SupportPlane().starts_beside(SupportPlane(), values, misfit_of(nominal)) == []
    beside = proposals_beside(SupportPlane(), values, nominal)
    assert {choices[0][0].name for choices in beside} == {"obstacle"}


def test_a_bar_is_also_tried_to_either_side():
    """Frames in which a bar is not touched where a fit ended do not pull it there."""
    free = rope(288)
    nodes = Equilibrium(free, []).at(np.empty(0)).seen - middle_of(free)
    low = nodes.reshape(-1, 3)[nodes[..., 2].argmin()]
    low[2] += DEPTH - 0.03
    values = np.array([*low, 0.03, heading_across(free)])
    point = Equilibrium(Obstacle().apply(free, values), []).at(np.empty(0))
    (one,), (other,) = Obstacle().starts_beside(Obstacle(), values, of(point))
    first, second = horizontal(free.gravity)
    along = np.cos(values[4]) * first + np.sin(values[4]) * second
    for at, sign in ((one, 1.0), (other, -1.0)):
        moved = at[:3] - values[:3]
        assert sign * moved == pytest.approx(one[:3] - values[:3])
        assert np.linalg.norm(moved) == pytest.approx(0.02)
        assert moved @ along == pytest.approx(0.0, abs=1e-12)
        assert moved[2] == pytest.approx(0.0, abs=1e-12)
        assert (at[3:] == values[3:]).all()


def test_a_bar_whose_fit_ends_elsewhere_is_found_from_the_side():
    free = rope(288)
    true = bar_under(free)
    nominal = nominal_fit(recorded(Obstacle().apply(free, true), seed=6))
    bar, start = Hypothesis(Obstacle(), NO_PLACE), true.copy()
    start[0] += 0.03
    alone = fit_candidate(nominal, bar, start)
    assert alone is not None
    (found,) = fit_candidates(nominal, [], [], [[(bar, start)]], 6.0, names=("obstacle",))
    assert found.fit.cost < 1.1 * len(nominal.z) < 0.1 * alone.fit.cost
    assert found.values()[[0, 2, 3]] == pytest.approx(true[[0, 2, 3]], abs=0.005)


def test_a_bar_beside_an_effect_is_found_from_the_side_too(monkeypatch):
    """And that is not done again where it is known."""
    free = rope(288)
    true = bar_under(free)
    nominal = nominal_fit(recorded(Obstacle().apply(free, true), seed=6))
    bar, start = Hypothesis(Obstacle(), NO_PLACE), true.copy()
    start[0] += 0.03
    monkeypatch.setattr(contact_beside, "proposals", lambda *_, **__: [[(bar, start)]])
    (found,) = by_contact(nominal, 6.0, ("obstacle",)).candidates
    assert found.fit.cost < 1.1 * len(nominal.z)
    assert found.values()[[0, 2, 3]] == pytest.approx(true[[0, 2, 3]], abs=0.005)
    monkeypatch.setattr(Fits, "add", lambda *_, **__: pytest.fail("fitted again"))
    slow, names = [[(bar, start)]], ("obstacle",)
    assert fit_candidates(nominal, [], [], slow, 6.0, names, known=[found]) == [found]


def test_of_alternative_bars_the_one_that_leaves_least_is_first():
    free = rope(288)
    true = bar_under(free)
    nominal = nominal_fit(recorded(Obstacle().apply(free, true), seed=6))
    bar, unit = Hypothesis(Obstacle(), NO_PLACE), np.eye(5)
    nothing, aside = true - 0.3 * unit[2], true + 0.03 * unit[0]
    deep, close = true + 0.03 * unit[2], true + 0.002 * unit[2]
    choices = [(bar, at) for at in (nothing, deep, close, aside)]
    first, *others = most_promising_first(nominal, choices)
    assert first is choices[2]
    assert [id(c) for c in others] == [id(choices[k]) for k in (0, 1, 3)]
    good = [choices[k] for k in (2, 3, 1)]  # the first is better than none: no other is compared
    assert most_promising_first(nominal, good)[0] is good[0]
    anew = [choices[k] for k in (1, 3, 0)]  # none settles at once, and touches the rope
    assert most_promising_first(nominal, anew)[0] is anew[1]
    assert most_promising_first(nominal, choices[:1]) == choices[:1]
    assert most_promising_first(nominal, []) == []


def test_starts_close_to_one_from_which_the_rope_jumps_are_not_compared(monkeypatch):
    free = rope(288)
    true = bar_under(free)
    nominal = nominal_fit(recorded(free, seed=6))
    bar, unit = Hypothesis(Obstacle(), NO_PLACE), np.eye(5)
    tried: list[np.ndarray] = []
    settle = beginning.settled_start

    def settled_start(smaller, starts, at_once):
        tried.append(starts[0][1])
        return settle(smaller, starts, at_once=at_once)

    monkeypatch.setattr(beginning, "settled_start", settled_start)
    deep = true + 0.04 * unit[2]
    choices = [(bar, at) for at in (deep, deep + 0.004 * unit[2], true)]
    most_promising_first(nominal, choices)
    assert [id(at) for at in tried] == [id(deep), id(true)]


def test_contact_beside_an_effect_counts_where_it_would_be_accepted():
    free = rope(288)
    lowest = np.sort(Equilibrium(free, []).at(np.empty(0)).seen[..., 2].min(axis=1))
    height = lowest[1] + DEPTH - float(middle_of(free)[2])
    for setup, there in (
        (SupportPlane().apply(free, np.array([height, 0, 0])), True),
        (free, False),
    ):
        data = recorded(setup, seed=8)
        nominal = nominal_fit(data)
        data = data.settled(nominal.point.seen)
        nominal = fit(nominal.forward, FitProblem(data, Noise(), BINS), nominal.point.u)
        found = by_contact(nominal, 6.0, None)
        assert found.evidence > 30 if there else found.evidence == 0
        assert by_contact(nominal, 6.0, ("point_mass",)).evidence == 0
        assert by_contact(nominal, 1e6, None).evidence == 0


def test_bars_are_proposed_where_a_plane_or_a_bar_bears_the_rope():
    point = Equilibrium(rope(288), []).at(np.empty(0))
    above = np.array([1.0, 0.0, 0.0])
    assert Obstacle().starts_beside(SupportPlane(), above, of(point))
    low = np.array([0.0, 0.0, -2.0, 0.03, 0.0])
    assert Obstacle().starts_beside(Obstacle(), low, of(point)) == []


def test_planes_one_after_the_other_do_not_mix():
    """A second plane, on the first or in its place, meets states settled with other supports: it
    once wrote past its arrays (`make bounds`)."""
    free = rope(288, 6)
    low = float(Equilibrium(free, []).at(np.empty(0)).seen[..., 2].min())
    height = low + DEPTH - float(middle_of(free)[2])
    table = SupportPlane().apply(free, np.array([height, 0.0, 0.0]))
    nominal = nominal_fit(recorded(table, seed=9), 72)
    hypothesis = Hypothesis(SupportPlane(), NO_PLACE)
    first = fit_candidate(nominal, hypothesis, np.array([height, 0.0, 0.0]))
    assert first is not None
    for smaller in (nominal, first.fit):
        for higher in (0.02, 0.1, 0.4):  # up to deep inside most of the rope
            second = fit_candidate(smaller, hypothesis, np.array([height + higher, 0.1, 0.0]))
            assert second is None or np.isfinite(second.fit.point.seen).all()
    mass = Hypothesis(PointMass(), PointMass().scan_places(free))
    assert np.isfinite(Sensitivities(first.fit).of(mass).values).all()
