"""A fitted rope with its laws in poses that were not recorded: at rest, and in motion."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.adapters.synthetic_spec import SimulationSpec
from ropefit.effects import (
    BendingHysteresis,
    BendingLaw,
    DragLaw,
    Effect,
    FollowerForce,
    ForceField,
    ScaleError,
)
from ropefit.errors import BadInput, WrongUsage
from ropefit.fitting.simulated import moving_rope, physical, settled_rope
from tests.report_runs import observations

POSES, CLAMP = 9, np.array([np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0])  # along x
FREE = np.full((POSES, 2, 4), np.nan)
BESIDE = [0.0, 0.2, -0.3]  # m, from the middle of the ends


def to_and_fro() -> np.ndarray:
    """Ends (F, 2, 3) [m] of which one goes to the other and back."""
    ends = np.zeros((POSES, 2, 3))
    ends[:, 1, 0] = 0.7 - 0.35 * np.sin(np.linspace(0, np.pi, POSES))
    return ends


def seen(kinds=("pinned", "pinned"), **changes: Any):
    clamp = np.where([[[kind == "clamped"] for kind in kinds]], CLAMP, np.nan)
    return observations(
        end_kind=kinds, end_position=to_and_fro(), end_orientation=np.tile(clamp, (POSES, 1, 1)),
        **changes,
    )  # fmt: skip


def model(effect: Effect | None = None, values: list[float] | None = None, **parameters: float):
    """What `simulated` reads of a fitted model with a law."""
    given = {"EI": 2e-4} | parameters
    group = SimpleNamespace(
        parameters={k: SimpleNamespace(value=v) for k, v in given.items()}, free_names=list(given)
    )
    cause = SimpleNamespace(
        name=effect.name if effect else "", variant=type(effect).__name__, end=None,
        values=np.array(values),
    )  # fmt: skip
    out: Any = SimpleNamespace(
        balance=SimpleNamespace(segments=40), stepped=SimpleNamespace(segments=24),
        groups={"all": group}, laws={cause.name: cause} if effect else {},
    )  # fmt: skip
    return out


def rest(o, effect: Effect | None = None, values: list[float] | None = None) -> np.ndarray:
    return settled_rope(o, model(effect, values), None, to_and_fro(), o.end_orientation)[0]


def test_a_law_of_bending_and_a_follower_force_change_shapes():
    o = seen(("clamped", "pinned"))
    plain = rest(o)
    assert plain.shape == (POSES, len(o.node_arc), 3)
    for effect, values in [(BendingLaw(), [0.8, 0.0, 0.0, 0.0, 0.0]),
                           (FollowerForce(), [0.0, 0.05, 0.0, 0.5])]:  # fmt: skip
        assert np.abs(rest(o, effect, values) - plain).max() > 1e-3, effect.name


def test_a_point_repels_or_attracts():
    plain = rest(seen())
    point = to_and_fro().mean(axis=1)[0] + BESIDE
    far = [
        np.linalg.norm(
            rest(seen(), ForceField(), [size, 0.0, 8.0, *BESIDE]) - point, axis=-1
        ).min()
        for size in (0.1, -0.03)
    ]  # fmt: skip
    near = np.linalg.norm(plain - point, axis=-1).min()
    assert far[0] > near + 0.002
    assert far[1] < near - 0.002


def test_friction_remembers_the_way():
    there, back = 1, POSES - 2  # the same pose
    plain = rest(seen())
    np.testing.assert_allclose(plain[there], plain[back], atol=1e-6)
    rubbed = rest(seen(), BendingHysteresis(), [1e-4, 1.0])
    assert np.abs(rubbed[there] - rubbed[back]).max() > 1e-4


def test_ends_are_held_as_the_runs_were():
    loose = to_and_fro()
    loose[:, 0] = np.nan
    with pytest.raises(BadInput, match="end0: the run's rope is held"):
        settled_rope(seen(), model(), None, loose, FREE)
    with pytest.raises(BadInput, match="tangents"):
        settled_rope(seen(("clamped", "pinned")), model(), None, to_and_fro(), FREE)
    two = model()
    two.groups["more"] = two.groups["all"]
    with pytest.raises(WrongUsage, match="--groups one"):
        settled_rope(seen(), two, None, to_and_fro(), FREE)


def test_errors_of_measurement_are_not_the_ropes():
    assert physical(model(ScaleError(), [1.1]), None) == []
    assert len(physical(model(BendingLaw(), [0.1] * 5), None)) == 1


def test_drag_that_grows_with_speed_in_motion():
    """Shaken for a while: from rest, as without a law at an exponent of one, else not."""
    count = 80
    time = 0.01 * np.arange(count)
    ends = np.zeros((count, 2, 3))
    ends[:, 1, 0] = 0.7
    late = np.maximum(time - 0.02, 0.0)
    ends[:, 0, 1] = 0.1 * np.sin(12 * late) * np.minimum(late / 0.1, 1.0)
    free = np.full((count, 2, 4), np.nan)
    o = seen()

    def moved(effect: Effect | None = None, values: list[float] | None = None) -> np.ndarray:
        one = model(effect, values, air_damping=0.1)
        return moving_rope(o, one, None, ends, free, time)[0]

    plain = moved()
    assert plain.shape == (count, 25, 3)
    np.testing.assert_allclose(plain[0], plain[1], atol=1e-3)  # it begins at rest
    assert np.abs(plain[-1] - plain[0]).max() > 0.02
    np.testing.assert_allclose(moved(DragLaw(), [0.0, 0.0, 0.0]), plain, atol=1e-9)
    assert np.abs(moved(DragLaw(), [1.0, 0.0, 0.0]) - plain).max() > 1e-3
    with pytest.raises(BadInput, match=r"at most 0\.1 s"):
        moving_rope(o, model(air_damping=0.1), None, ends, free, 20 * time)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"model": {"run": "run", "steps": 3}}, "nothing else"),
        ({"model": {"run": "run"}, "rope": {"length": 1.0}}, "leave them out"),
        ({}, "give \\[rope\\]"),
    ],
)
def test_one_rope_is_described(given: dict[str, Any], words: str):
    content = {"format": "ropefit-simulation/1", "name": "one",
               "motion": {"frames": 2, "end0": {"path": [[0, 0, 0]]}}}  # fmt: skip
    with pytest.raises(ValueError, match=words):
        SimulationSpec.model_validate(content | given)
