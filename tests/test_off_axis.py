"""Markers that sit beside the axis of a rope, and turn with it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ropefit
from benchmarks.accuracy.wrong_nominal import FREE, OFF_AXIS, drawn, recorded
from reference_simulators.planar_cable import Cable
from ropefit.adapters.priors import UNKNOWN_OFFSET, off_axis_sd
from ropefit.adapters.settings import DiagnoseSettings
from ropefit.effects.place import QUARTERS
from ropefit.fitting.posed import KnownRope, posed
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.models.priors import Priors, calibration, markers_off_axis
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare

STEP, SEED = 1e-5, 254


def held(frames: int = 4, segments: int = 24) -> Setup:
    """A rope of 0.6 m that rests curved in space, its base held at several angles."""
    start = np.zeros(3)
    ends = np.full((frames, 2, 3), np.nan)
    ends[:, 0] = start
    clamp = np.full((frames, 2, 4), np.nan)
    upright = from_rotation_vector(np.array([0.0, 0.5 * np.pi, 0.0]))
    for t, angle in enumerate(np.linspace(-1.2, 1.0, frames)):
        clamp[t, 0] = multiply(from_rotation_vector(np.array([0.3 * angle, angle, 0.0])), upright)
    made = uniform(length=0.6, segments=segments, bend=2e-3, density=0.06)
    made = made._replace(curvature=made.curvature + np.array([0.8, -0.5, 0.3]))
    return bare(made, np.array([0.0, 0.0, -9.81]), ends, clamp, np.array([0.5, -1.6, 0.0]))


def test_a_marker_lies_across_the_rope_at_its_offset():
    setup = held()
    (term,) = markers_off_axis(setup, 0.004)
    values = np.array([0.0, 0.0, 0.0, 0.006, 0.0, 0.0, 0.0, 0.002])
    on, off = (Equilibrium(s, []).at(np.empty(0)) for s in (setup, term.apply(setup, values)))
    np.testing.assert_allclose(off.solution.x, on.solution.x, atol=1e-12)  # the rope is the same
    moved = off.seen - on.seen
    tangent = on.solution.x[:, -1] - on.solution.x[:, -2]
    np.testing.assert_allclose(np.linalg.norm(moved[:, -1], axis=-1), np.hypot(0.006, 0.002))
    np.testing.assert_allclose((moved[:, -1] * tangent).sum(-1), 0, atol=1e-9)
    first = int(0.75 * setup.segments)
    np.testing.assert_allclose(moved[:, : first + 1], 0, atol=1e-15)


def test_what_is_seen_has_exact_derivatives():
    setup = held()
    (term,) = markers_off_axis(setup, 0.004)
    terms = [
        PARAMETERS["EI"].term(setup), replace(term, start=np.linspace(-0.006, 0.006, term.size)),
        *calibration(setup, Priors(), False),
    ]  # fmt: skip
    model = Equilibrium(setup, terms)
    u = model.start()
    point = model.at(u)
    assert point.converged.all()
    slopes = point.respond(model.changes(u))
    for k, slope in enumerate(slopes):
        step = STEP * np.eye(len(u))[k]
        low, high = (
            Equilibrium(setup, terms, point.solution).at(u + s).seen for s in (-step, step)
        )
        difference = (high - low) / (2 * STEP)
        np.testing.assert_allclose(slope, difference, atol=2e-6 * max(np.abs(difference).max(), 1))


def test_nothing_is_allowed_for_where_the_rope_may_spin():
    setup = held()
    spins = setup._replace(clamp_compliance=np.array([[0.0, np.inf], [0.0, np.inf]]))
    assert markers_off_axis(spins, 0.004) == markers_off_axis(setup, 0.0) == []


@pytest.mark.parametrize(
    ("source", "told", "diameter", "expected"),
    [
        ("markers", 0.003, 0.02, 0.003), ("markers", 0.0, 0.02, 0.01),
        ("markers", 0.0, None, UNKNOWN_OFFSET), ("clouds", 0.0, 0.02, 0.0),
    ],
)  # fmt: skip
def test_markers_lie_where_told_or_on_the_surface(source, told, diameter, expected):
    o: Any = SimpleNamespace(source=source, marker_offset=told, diameter=diameter)
    assert off_axis_sd(o) == pytest.approx(expected / 2**0.5)


def test_offsets_of_markers_are_recovered(tmp_path):
    pair = drawn(np.random.default_rng(SEED))
    cable = pair.cable
    bend = np.full_like(cable.bend, cable.bend.mean())
    plain = Cable(cable.length, cable.mass, bend, np.zeros_like(bend))
    places, offsets = np.linspace(0, 1, 5), OFF_AXIS * np.array([0.0, 1.5, -1.0, 0.5, -1.5])
    pair = replace(pair, cable=plain, bases=pair.told, places=places, offsets=offsets)
    o = ropefit.preprocess(recorded(pair, (), tmp_path / "off", SEED))
    problem = posed(o, KnownRope(ropefit.fit(o, free=FREE.split(","))), DiagnoseSettings())
    fitted = problem.fitted()
    parts = zip(fitted.forward.terms, fitted.forward.split(fitted.point.u), strict=True)
    found = next(term.value(u) for term, u in parts if term.name == "off_axis")
    mine = next(k for k, t in enumerate(fitted.forward.terms) if t.name == "off_axis")
    first = sum(t.size for t in fitted.forward.terms[:mine])
    sd = fitted.sd()[first : first + len(found)] * fitted.forward.terms[mine].scale
    told = np.concatenate([offsets[1:], np.zeros(4)])  # in the plane: along one director
    far = min(np.abs((sign * np.roll(told, shift) - found) / sd).max()
              for sign in (-1, 1) for shift in (0, 4))  # fmt: skip
    assert far < 4
    assert sd[: len(QUARTERS) - 1].min() < 0.25 * OFF_AXIS  # and says something
    assert fitted.scale < 1.25
