"""The blind benchmark: its recordings are what they claim to be, its scorer counts right."""

from __future__ import annotations

import csv
import json
import tomllib
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import cKDTree

from benchmarks.discovery import falsified, report, score
from benchmarks.discovery.cases import listed
from benchmarks.discovery.law_causes import DRAWN
from benchmarks.discovery.laws import LAWS, kinds
from benchmarks.discovery.made import Made, write
from benchmarks.discovery.make import Implausible, make, outside_of_bars
from benchmarks.discovery.motion_causes import drag_power
from benchmarks.discovery.setting import World, draw
from reference_simulators.kirchhoff_rod import Ends
from reference_simulators.rod_equations import Field, Rod
from ropefit.adapters.rope_setup import data_in_space
from ropefit.artifacts import Observations, read
from ropefit.recordings.ply import read_ply


@pytest.fixture(scope="module")
def heavy() -> Made:
    """A clamped rope with a concealed mass, in a set-up with errors."""
    return make(["point_mass"], [30.0], seed=11, clamped=True, calibration=False)


@pytest.fixture(scope="module")
def folder(heavy, tmp_path_factory):
    root = tmp_path_factory.mktemp("discovery")
    write(root / "recording", root / "truth.json", "heavy", heavy, 11, "single")
    return root


def test_the_size_is_the_one_that_is_as_visible_as_asked(heavy):
    (mass,) = heavy.sized
    rod = heavy.setting.rod
    assert mass.score == pytest.approx(30.0, rel=0.11)
    assert 1e-4 < mass.size / (rod.density * rod.length) < 0.8


def test_the_rope_keeps_its_length_and_its_ends(heavy):
    curve = CubicHermiteSpline(heavy.arc_length, heavy.nodes, heavy.tangents, axis=1)
    fine = curve(np.linspace(0, heavy.arc_length[-1], 5001))
    length = np.linalg.norm(np.diff(fine, axis=1), axis=2).sum(axis=1)
    np.testing.assert_allclose(length, heavy.setting.rod.length, rtol=1e-3)
    held = heavy.world.held.positions
    np.testing.assert_allclose(heavy.nodes[:, [0, -1]], held, atol=1e-9)


def test_the_recording_says_what_was_simulated(heavy, folder):
    told = tomllib.loads((folder / "recording" / "recording.toml").read_text())
    assert told["gravity"] == [0.0, 0.0, -9.81]
    rod = heavy.setting.rod
    assert told["rope"]["length"] == pytest.approx(rod.length, rel=1e-5)
    assert told["rope"]["mass"] == pytest.approx(rod.density * rod.length, rel=1e-5)
    with (folder / "recording" / "ends.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    said = np.array([[float(r[k]) for k in "xyz"] for r in rows]).reshape(-1, 2, 3)
    assert np.abs(said - heavy.nodes[:, [0, -1]]).max() < 0.001
    truth = json.loads((folder / "truth.json").read_text())
    assert truth["effects"][0]["name"] == "point_mass"
    assert "point_mass" not in "".join(
        path.read_text() for path in (folder / "recording").glob("*.*")
    )


def test_clouds_are_one_sided_and_as_noisy_as_asked(heavy, folder):
    sensor, radius = heavy.setting.sensor, 0.5 * heavy.setting.diameter
    curve = CubicHermiteSpline(heavy.arc_length, heavy.nodes, heavy.tangents, axis=1)
    fine = curve(np.linspace(0, heavy.arc_length[-1], 4001))
    ahead, strays = [], []
    for frame, path in enumerate(sorted((folder / "recording" / "clouds").glob("*.ply"))):
        points = np.asarray(read_ply(path, path.read_bytes()))[:, :3]
        assert 150 < len(points) <= 450
        distance, near = cKDTree(fine[frame]).query(points)
        strays.append((distance > radius + 6 * sensor.noise).mean())
        good = distance < radius + 4 * sensor.noise
        back = np.asarray(sensor.viewpoint) - points[good]
        back /= np.linalg.norm(back, axis=1, keepdims=True)
        ahead.append(((points[good] - fine[frame][near[good]]) * back).sum(1))
    ahead = np.concatenate(ahead)
    assert 0.001 < np.mean(strays) < 0.02
    assert 0.6 * radius < ahead.mean() < 1.0 * radius
    # The half circle's depth varies by 0.22 of the radius besides the noise.
    assert ahead.std() == pytest.approx(np.hypot(sensor.noise, 0.22 * radius), rel=0.2)


def test_preprocess_accepts_it(ropefit, heavy, folder):
    found = ropefit.json("preprocess", folder / "recording")
    assert found["frames"] == len(heavy.nodes)
    assert found["dropped"] == []
    assert found["ends"] == ["clamped", "clamped"]
    assert 0.5 * heavy.setting.sensor.noise < found["noise_m"] < 4 * heavy.setting.sensor.noise
    seen, _ = read(ropefit.directory / found["artifact"], Observations)
    assert data_in_space(seen).radius == pytest.approx(0.5 * heavy.setting.diameter, rel=1e-3)
    assert seen.point_before is not None
    # Depths that have nothing to do with a round surface are not taken for one.
    mixed = np.random.default_rng(1).permutation(seen.point_before)
    assert data_in_space(seen.model_copy(update={"point_before": mixed})).radius == 0


def test_the_lists_are_complete_and_the_same_every_time():
    full = listed("full")
    assert full == listed("full")
    assert len({case.name for case in full}) == len(full)
    groups = [case.group for case in full]
    assert groups.count("clean") == 300
    assert groups.count("single") == 16 * 8 + 3 * 4
    assert groups.count("pair") == 20 + 4
    assert groups.count("decoy") >= 10
    assert groups.count("unknown") >= 10
    halves = [case.calibration for case in full if case.group == "clean"]
    assert np.mean(halves) == pytest.approx(0.5, abs=0.02)
    assert len(listed("small")) == 18


def answer(name: str, **more) -> dict:
    """An answer of `diagnose --json` that names one effect."""
    effect = {
        "name": name,
        "kind": "physics",
        "arc_length_m": [0.4, 0.42],
        "frames": [0],
        "parameters": {"mass": {"value": 0.004, "unit": "kg", "ci95": [0.0035, 0.0045]}},
        "equivalent_to": [],
        "evidence": {},
        **more,
    }
    held = {"rms_before_m": 0.004, "rms_after_m": 0.001, "noise_m": 0.001}
    return {"verdict": "found", "effects": [effect], "heldout": held}


def truth(name: str, group: str = "single", level: float = 30.0) -> dict:
    true = {"name": name, "arc_length_m": [0.4, 0.4], "parameter": "mass", "unit": "kg"}
    effects = [{**true, "kind": "physics", "value": 0.004, "score": level}]
    return {
        "name": f"{group}-{name}", "group": group, "effects": effects if name else [],
        "calibration_errors": False, "length_m": 1.0,
    }  # fmt: skip


def test_a_bar_off_which_a_load_lifts_the_rope_is_refused():
    with pytest.raises(Implausible, match="obstacle: hardly seen beside"):
        make(["obstacle", "distributed_load"], [30.0, 30.0], 362263822, clamped=False)


def test_a_rope_that_passes_through_a_bar_is_refused():
    bar = Field(np.array([0.5, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), 0.02, 5e3, "bar")
    soft = replace(bar, soft=True)
    rope = Rod(1.0, 0.05, 1e-3, 1e-3)
    straight = np.zeros((2, 101, 13))
    straight[..., 0] = np.linspace(0.0, 1.0, 101)
    straight[..., 2] = 0.019
    held = Ends(np.zeros((2, 2, 3)), np.zeros((2, 2, 4)), ("pinned", "pinned"))
    outside_of_bars(World(replace(rope, fields=(bar, soft)), held), straight)
    straight[1, :, 2] = 0.004
    outside_of_bars(World(replace(rope, fields=(soft,)), held), straight)
    with pytest.raises(Implausible, match="passes through the bar"):
        outside_of_bars(World(replace(rope, fields=(bar,)), held), straight)


def test_the_scorer_counts_hits_ties_and_misses():
    times = {"preprocess": 1.0, "identify": 2.0, "diagnose": 3.0}

    def judged(true, said):
        return score.judged(true, {"answer": said, "error": None, "seconds": times})

    hit = judged(truth("point_mass"), answer("point_mass"))
    assert (hit["first"], hit["in_set"], hit["place"], hit["size"]) == (
        True,
        [True],
        [True],
        [True],
    )
    tie = judged(truth("point_mass"), answer("tether", equivalent_to=["point_mass"]))
    assert (tie["first"], tie["in_set"], tie["set_size"]) == (False, [True], 2)
    wrong = judged(truth("kink", level=6.0), answer("tether"))
    quiet = judged(truth("", "clean"), {"verdict": "none", "effects": [], "heldout": {}})
    failed = score.judged(
        truth("point_mass"), {"answer": None, "error": "diagnose: exit 1", "seconds": times}
    )
    everything = [hit, tie, wrong, quiet, failed]
    value = {row["what"]: row["value"] for row in score.rows(everything)}
    assert value["visible single effect: first"] == 0.5
    assert value["visible single effect: in the reported set"] == 1.0
    assert value["score 6: named wrongly with confidence"] == 1.0
    assert value["clean recordings called anything but `none`"] == 0.0
    assert value["recordings without an answer"] == pytest.approx(0.2)
    assert score.confusion(everything)["point_mass"] == {
        "point_mass": 1,
        "tether": 1,
        "no answer": 1,
    }
    text = report.markdown(everything, {}, "--cases small", len(everything))
    assert "exit 1" in text
    assert "called tether" in text
    assert "true effect: point_mass (of 3) tether 1, no answer 1; kink (of 1) tether 1." in text


def test_worked_examples_are_the_first_that_were_answered_rightly():
    times = {"preprocess": 1.0, "identify": 2.0, "diagnose": 3.0}
    said = answer("point_mass") | {
        "next_motion": None,
        "detectable": {"kink": {"value": 0.01, "unit": "rad"}},
        "mismatch": [],
        "latent_force": {"log_evidence": 1.0, "threshold": 10.0},
    }
    said["effects"][0] |= {
        "description": "a mass sits on the rope",
        "evidence": {"log_bayes_factor": 20.0, "heldout_log_likelihood_gain": 30.0},
    }
    said["heldout"] = {"rms_before_m": 0.002, "rms_after_m": 0.001, "noise_m": 0.001}
    judged = score.judged(truth("point_mass"), {"answer": said, "error": None, "seconds": times})
    told = report.examples([judged], {judged["case"]: said})
    assert "a mass sits on the rope" in told
    assert "log Bayes factor 20.0" in told
    assert "**Clean:**" not in told


def test_a_falsehood_changes_one_thing(real, tmp_path):
    source = real / "wire_black"
    for number, (change, _) in enumerate(falsified.FALSEHOODS.values()):
        copy = tmp_path / str(number)
        falsified.copied(source, copy, "copy")
        before = {path.name: path.read_bytes() for path in copy.iterdir()}
        change(copy)
        changed = [path.name for path in copy.iterdir() if path.read_bytes() != before[path.name]]
        assert len(changed) == 1


@pytest.mark.parametrize(
    ("sets", "score", "expected"),
    [
        ([["weight_error"]], 30.0, ["all", "visible", "named"]),
        ([["tether", "weight_error"]], 12.0, ["all", "visible", "named"]),
        ([["tether"]], 30.0, ["all", "visible", "wrong"]),
        ([], 30.0, ["all", "visible"]),
        ([["tether"]], 11.0, ["all", "wrong"]),
        ([["weight_error"]], 11.0, ["all"]),
    ],
)
def test_only_visible_falsehoods_are_asked_for(sets, score, expected):
    effects = [{"name": names[0], "equivalent_to": names[1:]} for names in sets]
    answer = {"effects": effects, "verdict": "found" if effects else "unknown"}
    assert falsified.outcome({"weight_error"}, score, answer) == expected
    assert falsified.outcome({"weight_error"}, score, None) == ["all"]


def test_sixty_recordings_hold_every_law_and_as_much_else():
    found = Counter(kinds(60))
    assert found["clean"] == 15
    for law in ("bending_law", "axial_law", "force_field", "follower_force", "bending_hysteresis",
                "drag_law"):  # fmt: skip
        assert found[law] == 5, law
    assert sum(n for kind, n in found.items() if kind not in LAWS) == 30


def test_dahls_friction_and_a_power_of_drag_are_drawn_as_told(tmp_path):
    setting = draw(True, np.random.default_rng(3), back=True)
    one = DRAWN["bending_hysteresis"](setting, np.random.default_rng(4))
    law = one.concealed.change(setting.world, 1e-3).law
    assert law is not None
    assert law.dahl
    assert law.rigidity * law.slip == pytest.approx(1e-3)
    assert one.constants(1e-3) == {"M0": 1e-3, "k0": law.slip}
    _, _, drag = drag_power(setting, np.random.default_rng(4))
    assert drag is not None
    assert drag.names == ("drag_law",)
    assert 1.2 <= drag.drag == drag.size <= 2.0
