"""Exported ropes come to rest in the simulators where the exact elastica says they must."""

from __future__ import annotations

import ast
import json
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.accuracy.exporters import NotInstalled, deviation, python_for, settle
from reference_simulators.as_ropefit import describe
from ropefit.attachments import (
    BendingFriction,
    Cylinder,
    EndTwist,
    Plane,
    PointMass,
    Sphere,
    Tether,
)
from ropefit.effects.friction_law import dahl, prandtl, with_friction
from ropefit.errors import BadInput, WrongUsage
from ropefit.exporters import export, exporters
from ropefit.exporters.layout import lay_out
from ropefit.exporters.rotation import from_vector, multiply, rotate
from ropefit.rod import memory
from tests import concealed

FAST = ("mujoco", "mujoco3")
MOST_APART = 0.01  # of the rope's length


def needed(target: str) -> None:
    try:
        python_for(target)
    except NotInstalled as missing:
        pytest.skip(str(missing))


@pytest.mark.parametrize("ratio", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("ends", ["pinned", "clamped"])
@pytest.mark.parametrize("target", FAST)
def test_rest_is_where_the_elastica_is(target: str, ends: str, ratio: float) -> None:
    needed(target)
    assert deviation(target, describe(ends, ratio)) < MOST_APART / 10


@pytest.mark.parametrize("ends", ["pinned", "clamped"])
def test_rest_in_pyelastica(ends: str) -> None:
    needed("pyelastica")
    assert deviation("pyelastica", describe(ends, 1e-2, 21)) < MOST_APART / 10


def test_rest_in_newton() -> None:
    needed("newton")
    assert deviation("newton", describe("pinned", 1e-2, 21)) < MOST_APART


def tapered(s: np.ndarray) -> np.ndarray:
    return 1 + 10 * np.exp(-6 * s)


def hooked(s: np.ndarray) -> np.ndarray:
    return 1.5 * np.sin(3 * s)


@pytest.mark.parametrize(
    "shape",
    [{"stiffness": tapered}, {"curvature": hooked}, {"tip": 0.3}],
    ids=["stiffness", "curvature", "tip"],
)
@pytest.mark.parametrize("target", ["mujoco", "mujoco3", "pyelastica"])
def test_what_varies_along_the_rope_goes_along(target: str, shape: dict) -> None:
    needed(target)
    rope = describe("clamped", 1e-2, 31, **shape)
    assert deviation(target, rope) < MOST_APART / 5
    plain = describe("clamped", 1e-2, 31)
    assert np.abs(rope.x - plain.x).max() > 2 * MOST_APART  # else nothing was tested


@pytest.mark.parametrize("target", FAST)
def test_a_point_mass_is_a_heavier_node(target: str) -> None:
    needed(target)
    nodes = 31
    heavier = describe("pinned", 1e-3, nodes).masses
    heavier[10] += 0.02
    as_effect = settle(target, describe("pinned", 1e-3, nodes, effects=(PointMass(10, 0.02),)))
    as_mass = settle(target, describe("pinned", 1e-3, nodes, masses=heavier))
    np.testing.assert_allclose(as_effect, as_mass, atol=1e-5)
    assert np.abs(as_effect - describe("pinned", 1e-3, nodes).x[0]).max() > MOST_APART


@pytest.mark.parametrize("target", ["mujoco", "mujoco3", "pyelastica"])
def test_a_tether_carries(target: str) -> None:
    """The stretched spring and the rest length tell the force; the node hangs higher for it."""
    needed(target)
    free = describe("pinned", 1e-3, 21)
    anchor = (float(free.x[0, 10, 0]), 0.0, 0.1)
    rope = describe("pinned", 1e-3, 21, effects=(Tether(10, anchor, 5.0, 0.1),))
    shape = settle(target, rope)
    pull = 5.0 * (np.linalg.norm(shape[10] - anchor) - 0.1)
    assert 0.1 < pull < 0.05 * 9.81  # N: it carries, but not more than the rope weighs
    assert shape[10, 2] > free.x[0, 10, 2] + MOST_APART
    slack = describe("pinned", 1e-3, 21, effects=(Tether(10, anchor, 5.0, 1.0),))
    assert np.abs(settle(target, slack) - free.x[0]).max() < MOST_APART / 5


OBSTACLES = {
    "plane": Plane((0.0, 0.0, -0.25), (0.0, 0.0, 1.0)),
    "sphere": Sphere((0.33, 0.0, -0.42), 0.15),
    "cylinder": Cylinder((0.33, -0.3, -0.35), (0.33, 0.3, -0.35), 0.08),
}


@pytest.mark.parametrize("kind", OBSTACLES)
@pytest.mark.parametrize("target", ["mujoco", "mujoco3", "pyelastica"])
def test_obstacles_carry(target: str, kind: str) -> None:
    needed(target)
    effect = OBSTACLES[kind]
    free = describe("pinned", 1e-3, 31)
    # A start inside would be thrown out; an arch above the chord falls onto the obstacle.
    chord = np.linspace(free.x[0, 0], free.x[0, -1], 31)
    above = free.x * [1, 1, -1] + 2 * chord * [0, 0, 1]
    shape = settle(target, describe("pinned", 1e-3, 31, effects=(effect,), x=above))
    radius = 0.004

    def gap(x: np.ndarray) -> np.ndarray:
        if isinstance(effect, Plane):
            return x[:, 2] + 0.25 - radius
        centre = effect.centre if isinstance(effect, Sphere) else (0.33, 0.0, -0.35)
        return np.hypot(x[:, 0] - centre[0], x[:, 2] - centre[2]) - effect.radius - radius

    assert gap(free.x[0]).min() < -MOST_APART  # without it the rope would be inside
    assert gap(shape).min() > -0.002
    assert gap(shape).min() < 0.005  # and it lies on it


def both_clamped(**changes) -> object:
    free = describe("pinned", 1e-2, 21)
    first, last = (free.x[0, 1] - free.x[0, 0]), (free.x[0, -1] - free.x[0, -2])
    q = [from_vector(np.array([0.0, np.arctan2(t[0], t[2]), 0.0])) for t in (first, last)]
    return describe(
        "pinned",
        1e-2,
        21,
        end_kinds=("clamped", "clamped"),
        end_orientations=np.array([q]),
        **changes,
    )


@pytest.mark.parametrize("target", ["mujoco", "mujoco3"])
def test_end_twist_leaves_the_plane(target: str) -> None:
    """Clamps along the free tangents change little; a full turn of one drives the rope sideways."""
    needed(target)
    still = settle(target, both_clamped())
    assert np.nanmax(np.abs(still - both_clamped().x[0])) < 3 * MOST_APART
    assert np.nanmax(np.abs(still[:, 1])) < 1e-4
    turned = settle(target, both_clamped(effects=(EndTwist(1, 2.5),)))
    assert np.nanmax(np.abs(turned[:, 1])) > MOST_APART / 2


def test_two_dialects_agree_on_twist() -> None:
    needed("mujoco"), needed("mujoco3")
    rope = both_clamped(effects=(EndTwist(1, 2.0),))
    apart = np.linalg.norm(settle("mujoco", rope) - settle("mujoco3", rope), axis=1)
    assert np.nanmax(apart) < MOST_APART


def test_every_pose_is_exported() -> None:
    needed("mujoco")
    one, other = describe("pinned", 1e-2, 21), describe("pinned", 1e-4, 21)
    shift = np.array([0.0, 0.3, 0.2])
    both = describe(
        "pinned",
        1e-2,
        21,
        x=np.concatenate([other.x, one.x + shift]),
        end_positions=np.concatenate([other.end_positions, one.end_positions + shift]),
        end_orientations=np.concatenate([one.end_orientations] * 2),
    )
    np.testing.assert_allclose(settle("mujoco", both, 1), one.x[0] + shift, atol=MOST_APART / 5)


def everything() -> object:
    rope = describe("clamped", 1e-2, 21)
    effects = (
        PointMass(5, 0.01),
        *OBSTACLES.values(),
        Plane((0, 0, -0.5), (0, 0, 1), friction=0.4),
        Tether(7, (0.0, 0.0, 1.0), 3.0, 0.2),
        Tether(0, (0.0, 0.0, 1.0), 3.0, 0.2),
        EndTwist(0, 0.3),
        EndTwist(1, 0.3),
    )
    return describe(
        "clamped",
        1e-2,
        21,
        effects=effects,
        diameter=None,
        EA=np.full(20, 50.0),
        GA=np.full(20, 20.0),
        GJ=rope.GJ * np.linspace(1, 2, 19),
        name='it\'s "a" rope --> """ \\',
    )


@pytest.mark.parametrize("target", sorted(exporters()))
def test_what_is_lost_is_said_in_the_text(target: str) -> None:
    result = export(everything(), target)
    for sentence in result.not_expressed:
        assert sentence.replace("--", "- -") in result.text
    if target == "json":
        assert not result.not_expressed
    elif target.startswith("mujoco"):
        words = " ".join(result.not_expressed)
        for lost in ("diameter", "stretch", "shear", "GJ", "tether at node 0", "end 1"):
            assert lost in words


def test_texts_are_well_formed() -> None:
    """An awkward name included; nothing in a name may become code or markup."""
    for target, kind in exporters().items():
        text = export(everything(), target).text
        if kind.suffix == ".xml":
            assert ElementTree.fromstring(text).tag == "mujoco"
        elif kind.suffix == ".py":
            ast.parse(text)
        else:
            assert json.loads(text)["name"] == 'it\'s "a" rope --> """ \\'


def test_json_holds_everything() -> None:
    rope = describe("clamped", 1e-3, 11, effects=(PointMass(3, 0.1),))
    data = json.loads(export(rope, "json").text)
    assert data["effects"] == [{"kind": "PointMass", "node": 3, "mass": 0.1}]
    np.testing.assert_allclose(data["x"], rope.x)
    assert data["EA"] == [None] * 10  # infinite
    assert data["end_positions"][0][1] == [None] * 3
    assert data["units"]["EI"] == "N m^2"


def test_newton_carries_usd() -> None:
    usd = export(describe("pinned", 1e-3, 11), "newton").files["rope.usda"]
    assert "curveVertexCounts = [11]" in usd
    assert "physics:restShapePoints" in usd


def lost_in_a_cycle(turns: np.ndarray, moments: np.ndarray) -> float:
    """The area [J] of the loop of a moment over the last cycle of turns (T,) [rad]."""
    mean, steps = 0.5 * (moments[1:] + moments[:-1]), np.diff(turns)
    return float((mean * steps)[len(steps) // 2 :].sum())


def dahl_moments(turns: np.ndarray, largest: float, decay: float) -> np.ndarray:
    """Dahl's friction, dM/dθ = (largest - sign M) / decay, stepped as SolverVBD does."""
    out = np.zeros_like(turns)
    for k, step in enumerate(np.diff(turns)):
        way, kept = np.sign(step), np.exp(-abs(step) / decay)
        out[k + 1] = way * largest * (1 - kept) + out[k] * kept
    return out


def lost_here(turns: np.ndarray, friction: BendingFriction) -> np.ndarray:
    """The same loss (J,) [J] at the inner nodes of a rope of ropefit, which all turn alike."""
    values = np.array([friction.moment, friction.range])
    element = {"Prandtl": prandtl, "Dahl": dahl}[friction.law](*values)
    setup = with_friction(concealed.rope(10, 1), element)
    time = np.arange(float(len(turns)))
    law = memory.laws(setup.memory, setup.rod(), setup.properties.bend, time)
    vector = np.zeros((len(turns), 11, 2))
    vector[..., 0] = np.sin(turns / 2)[:, None]
    state, force = memory.unloaded(vector[0], 1), np.zeros((len(turns), 9))
    for t in range(len(turns)):
        state = memory.after(law, t, t == 0, state, vector[t])
        force[t] = (law.drag[..., None] * state.strain).sum(0)[1:-1, 0]
    return np.array([lost_in_a_cycle(vector[:, 0, 0], column) for column in force.T])


@pytest.mark.parametrize("law", ["Prandtl", "Dahl"])
@pytest.mark.parametrize("amplitude", [2.0, 4.0])  # of the curvature, in ranges
def test_bending_friction_in_newton_loses_what_it_does_here(amplitude: float, law) -> None:
    friction = BendingFriction(2e-4, 1.5, law)
    rope = describe("pinned", 1e-3, 11, effects=(friction,))
    result = export(rope, "newton")
    numbers = {
        node.targets[0].id: np.array(ast.literal_eval(node.value.args[0]))
        for node in ast.parse(result.text).body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
        and isinstance(node.value, ast.Call) and ast.unparse(node.value.func) == "np.array"
    }  # fmt: skip
    reach = lay_out(rope).voronoi
    turns = amplitude * friction.range * 0.1 * np.sin(np.linspace(0, 4 * np.pi, 2001))
    np.testing.assert_allclose(reach, 0.1)
    for joint, ours in enumerate(lost_here(turns, friction)):
        largest = numbers["BEND"][joint] * numbers["DAHL_EPS_MAX"][joint]
        theirs = lost_in_a_cycle(turns, dahl_moments(turns, largest, numbers["DAHL_TAU"][joint]))
        assert ours > 0
        assert abs(theirs / ours - 1) < {"Prandtl": 0.1, "Dahl": 0.03}[law]
    assert any("friction" in sentence for sentence in result.not_expressed)
    usd = result.files["rope.usda"]
    (line,) = [row for row in usd.splitlines() if "isaaclab:cable:dahlDecay" in row]
    decay = ast.literal_eval(line.split(" = ")[1])
    np.testing.assert_allclose(decay, friction.range * 0.1, rtol=1e-6)
    for target in ("mujoco", "mujoco3", "pyelastica"):
        assert any("friction" in sentence for sentence in export(rope, target).not_expressed)


def test_newton_reads_the_usd(tmp_path) -> None:
    """Joint stiffness of its own importer: EI and GJ over the length of a segment."""
    needed("newton")
    import subprocess

    rope = describe("pinned", 1e-2, 21)
    (tmp_path / "rope.usda").write_text(export(rope, "newton").files["rope.usda"])
    code = (
        "import json, sys, newton; b = newton.ModelBuilder(); b.add_usd(sys.argv[1]); "
        "k = [x for x in b.joint_target_ke if x]; "
        "print(json.dumps([b.body_count, sum(b.body_mass), k[3], k[5]]))"
    )
    run = subprocess.run(
        [python_for("newton"), "-c", code, tmp_path / "rope.usda"], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout.strip().splitlines()[-1])
    expected = [20, rope.masses.sum(), rope.EI[0] * 20, rope.GJ[0] * 20]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_clamp_keeps_the_length_that_bends() -> None:
    for nodes in (11, 41):
        rope = describe("clamped", 1e-3, nodes)
        layout = lay_out(rope)
        # The free end's outer half segment has no joint; all the rest bends.
        assert layout.voronoi.sum() == pytest.approx(1 - layout.lengths[-1] / 2)
        assert layout.masses.sum() == pytest.approx(rope.masses.sum())
        np.testing.assert_allclose(layout.start[0][layout.node > 0], rope.x[0, 1:], atol=1e-12)


def test_frames_end_in_the_clamps() -> None:
    rope = both_clamped(effects=(EndTwist(1, 1.0),))
    layout = lay_out(rope)
    frames = layout.frames(0)
    for end, at in ((0, 0), (1, -1)):
        apart = multiply(frames[at] * [1, -1, -1, -1], layout.end_q[0, end])
        assert abs(apart[0]) == pytest.approx(1, abs=1e-6)
    tangents = np.diff(layout.start[0], axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    np.testing.assert_allclose(rotate(frames, np.array([0, 0, 1.0])), tangents, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"EI": np.zeros(9)}, "EI must be positive"),
        ({"EI": np.ones(8)}, r"shape \(8,\), not \(9,\)"),
        ({"length": 2.0}, "add up to 1 m"),
        ({"diameter": 3.0}, "thick"),
        ({"end_kinds": ("glued", "free")}, "'glued'"),
        ({"end_kinds": ("clamped", "free")}, "unit quaternion"),
        ({"end_positions": np.full((1, 2, 3), np.nan)}, "without a position"),
        ({"effects": (PointMass(99, 0.1),)}, "node 99"),
        ({"effects": (PointMass(1, -0.1),)}, "mass must be positive"),
        ({"effects": (Plane((0, 0, 0), (0, 0, 0)),)}, "normal is zero"),
        ({"effects": (Sphere((0, 0, np.nan), 1.0),)}, "finite"),
        ({"effects": (Cylinder((0, 0, 0), (0, 0, 0), 1.0),)}, "coincide"),
        ({"effects": (EndTwist(2, 1.0),)}, "end is 0 or 1"),
    ],
)
def test_descriptions_that_make_no_rope(change: dict, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        describe("pinned", 1e-2, 11, **change)


def test_unknown_target() -> None:
    with pytest.raises(WrongUsage, match="mujoco3"):
        export(describe("pinned", 1e-2, 11), "bullet")


def test_no_simulator_is_imported() -> None:
    import subprocess
    import sys

    code = (
        "import sys; from ropefit.exporters import exporters; exporters(); "
        "bad = {'mujoco', 'elastica', 'newton', 'warp', 'pxr', 'torch'} & set(sys.modules); "
        "assert not bad, bad"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
