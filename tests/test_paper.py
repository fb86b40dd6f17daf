"""The paper's experiments: their files, their worlds, and the column *agrees / differs*."""

import numpy as np
import pytest
from pydantic import ValidationError

from benchmarks.paper.document import Claim, claims, diagnosed
from benchmarks.paper.pipeline import Experiment, Rendered, RopeTable, SweepTable, read
from benchmarks.paper.rendering import looking
from benchmarks.paper.runner import Place, recall
from benchmarks.paper.worlds import settled, shapes, sweep
from tests.conftest import ROOT

EXPERIMENTS = sorted((ROOT / "pipelines").glob("*.toml"))
SWEEP = SweepTable(
    kind="sweep", frames=6, distance=(0.4, 0.9), elevation=10, azimuth=20, gripper=(-30, 0)
)


@pytest.mark.parametrize("path", EXPERIMENTS, ids=lambda path: path.stem)
def test_an_experiment_names_only_what_it_has_and_has_a_make_target(path):
    experiment = read(path)
    assert experiment.experiment == path.stem
    assert path.stem in (ROOT / "pipelines" / "paper.mk").read_text().split("\n")[2].split()
    known = list(experiment.recordings)
    done: list[str] = []
    for name, run in experiment.runs.items():
        assert run.recording in known
        source = experiment.recordings[run.recording]
        if not isinstance(source, Rendered):
            assert source.run in done  # derived of a run that comes before
        done.append(name)
    for target in experiment.targets.values():
        assert target.recording in known


def test_all_three_experiments_are_there():
    assert [path.stem for path in EXPERIMENTS] == ["baxter", "dvrk", "shape-control"]


def test_unknown_keys_are_refused():
    good = read(EXPERIMENTS[0]).model_dump()
    with pytest.raises(ValidationError, match="speed"):
        Experiment.model_validate(good | {"speed": 1})


def test_a_sweep_has_the_distances_and_directions_asked_for():
    held = sweep(SWEEP, length=1.0)
    apart = np.linalg.norm(held.positions[:, 1] - held.positions[:, 0], axis=1)
    assert apart.min() == pytest.approx(0.4, abs=1e-9)
    assert 0.8 < apart.max() <= 0.9
    assert held.kinds == ("clamped", "pinned")
    q = held.orientations[:, 0]
    w, x, y, z = q.T
    tangent = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z], 1)
    np.testing.assert_allclose(tangent, np.tile([np.cos(np.pi / 6), 0, -0.5], (6, 1)), atol=1e-9)


def test_a_rope_is_as_long_as_its_tension_makes_it():
    """A nearly taut rope of small weight: strain times EA is its tension, an elastic catenary's."""
    length, weight, stiffness = 1.0, 0.05 * 9.81, 20.0
    rope = RopeTable(length=length, diameter=0.008, mass=0.05, EI=1e-4, EA=stiffness)
    flat = SweepTable(kind="sweep", frames=4, distance=(0.95, 0.95))
    truth = settled(rope, sweep(flat, length), "elastica")
    long = np.linalg.norm(np.diff(truth.nodes[0], axis=0), axis=1).sum()
    horizontal = _elastic_catenary(length, 0.95, weight, stiffness)
    a = horizontal / (weight / length)
    half = length / 2  # the mean tension of a catenary over its rest length
    s = np.linspace(-half, half, 2001)
    tension = weight / length * np.sqrt(a**2 + s**2)
    assert long - length == pytest.approx(length * tension.mean() / stiffness, rel=0.02)


def _elastic_catenary(length: float, apart: float, weight: float, stiffness: float) -> float:
    """[N] horizontal force of a level elastic catenary, from its span (Irvine, 1981)."""
    low, high = 1e-3 * weight, 1e3 * weight
    for _ in range(200):
        force = np.sqrt(low * high)
        span = force * length / stiffness + 2 * force * length / weight * np.arcsinh(
            weight / (2 * force)
        )
        low, high = (force, high) if span < apart else (low, force)
    return force


def test_a_rod_held_in_the_middle_stretches_on_its_tensioned_side():
    recording = read(ROOT / "pipelines" / "dvrk.toml").recordings["dvrk"]
    assert isinstance(recording, Rendered)
    few = recording.motion.model_copy(update={"frames": 4})
    truth = shapes(recording.model_copy(update={"motion": few}))
    at = int(np.argmin(np.abs(truth.arc - few.at)))
    np.testing.assert_allclose(truth.nodes[:, at], truth.gripper, atol=1e-6)
    step = np.linalg.norm(np.diff(truth.nodes, axis=1), axis=2)
    strain = [step[:, :at].sum(1) / few.at, step[:, at:].sum(1) / (recording.rope.length - few.at)]
    assert (strain[0] > strain[1]).all()
    assert (strain[1] > 1).all()


def test_the_camera_looks_where_it_should():
    eye = looking((0.0, -1.0, 0.5), (0.0, 0.0, 0.5))
    np.testing.assert_allclose(eye.project(np.array([[0.0, 0.0, 0.5]])), [[eye.cx, eye.cy]])
    up = eye.project(np.array([[0.0, 0.0, 0.6]]))[0]
    assert up[1] < eye.cy
    assert up[0] == pytest.approx(eye.cx)


def test_a_claim_gives_its_reason_only_for_the_outcome_that_it_explains():
    kept = Claim("a", "b", True, "since c")
    lost = Claim("a", "b", False, "since c")
    other = Claim("a", "b", False, "since d", explains=False)
    assert kept.row().endswith("agrees: since c |")
    assert lost.row().endswith("**differs**: not explained |")
    assert other.row().endswith("**differs**: since d |")
    assert claims([kept, lost]).count("\n") == 4


def test_a_diagnosis_is_reported_with_its_size_and_equivalents():
    size = {"value": 0.3, "unit": "N", "ci95": [0.2, 0.4]}
    effect = {"name": "tether", "parameters": {"EA": size}, "equivalent_to": ["tether", "kink"]}
    told = diagnosed({"diagnose": {"verdict": "found", "effects": [effect]}})
    assert told == "verdict *found*: `tether`, EA 0.3 N (0.2 to 0.4), equivalent to kink"
    none = diagnosed({"diagnose": {"verdict": "none", "effects": []}})
    assert none == "verdict *none*, no effect named"


def test_nothing_is_recalled_of_runs_that_were_not_done(tmp_path):
    assert recall(read(EXPERIMENTS[0]), Place(tmp_path)) == {}
