"""The ablations: every variant leaves out what it says; a free rope can bend to what it should, and
pays for it."""

from __future__ import annotations

import inspect
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.discovery.ablations import CASES, markdown, without
from benchmarks.discovery.cases import listed
from benchmarks.discovery.free_rope import KNOTS, FreeRope, free_rope
from benchmarks.discovery.left_out import (
    FREE,
    VARIANTS,
    WHOLE,
    WITHOUT_RESTART,
    NaiveBic,
    WithFreeRope,
)
from ropefit.diagnosis.first_noise import first_noise
from ropefit.diagnosis.hypotheses import hypotheses
from ropefit.diagnosis.rules import RULES, Rules, Selection
from ropefit.effects import StiffSection
from ropefit.effects.intrinsic_curvature import IntrinsicCurvature
from ropefit.inference.noise import Noise
from tests.concealed import nominal_fit, recorded, rope, with_effect

SETUP = rope(24, 3)


def test_a_free_rope_holds_the_uniform_ones():
    free = FreeRope()
    values = np.zeros(3 * KNOTS)
    assert np.array_equal(free.apply(SETUP, values).properties.bend, SETUP.properties.bend)
    values[:KNOTS] = 0.7
    values[KNOTS : 2 * KNOTS], values[2 * KNOTS :] = 0.4, -0.2
    p = free.apply(SETUP, values).properties
    whole = np.array([0.4, -0.2, 0.5, 2.0])
    curved = IntrinsicCurvature().apply(SETUP, whole).properties.curvature
    np.testing.assert_allclose(p.bend / SETUP.properties.bend, np.exp(0.7), rtol=1e-12)
    np.testing.assert_allclose(p.twist / SETUP.properties.twist, np.exp(0.7), rtol=1e-12)
    np.testing.assert_allclose(p.curvature, curved, atol=1e-12)
    assert all(hypothesis.name != "free_rope" for hypothesis in hypotheses(SETUP))


def test_a_free_rope_absorbs_a_stiff_stretch_and_pays_on_a_clean_recording():
    stiff = recorded(with_effect(StiffSection(), [1.2, 0.5, 0.3], 96), seed=4)
    clean = recorded(rope(96), seed=4)
    found = {}
    for name, data in (("stiff", stiff), ("clean", clean)):
        nominal = nominal_fit(data, 48)
        candidate = free_rope(nominal)
        assert candidate is not None
        assert candidate.fit.cost <= nominal.cost
        found[name] = candidate
    assert found["clean"].evidence < 0 < found["stiff"].evidence
    log = found["stiff"].values()[:KNOTS]
    assert log[3:5].mean() - log[[1, 6]].mean() == pytest.approx(1.2, abs=0.5)


def candidate(evidence: float, cost: float, effect: str = "kink") -> SimpleNamespace:
    hypothesis = next(hypothesis for hypothesis in hypotheses(SETUP) if hypothesis.name == effect)
    return SimpleNamespace(hypothesis=hypothesis, evidence=evidence, fit=SimpleNamespace(cost=cost))


def test_each_variant_changes_its_own_rule_only():
    changed = {}
    for key, variant in VARIANTS.items():
        rules = variant.rules({})
        changed[key] = [
            f.name for f in fields(Rules) if getattr(rules, f.name) != getattr(RULES, f.name)
        ]
    assert changed == {
        WHOLE: ["selection"], "calibration": ["calibration"], "white": ["noise"],
        WITHOUT_RESTART: ["selection"], "bic": ["selection"], FREE: ["selection"],
    }  # fmt: skip


def test_with_white_noise():
    data = recorded(rope(48), seed=3)
    nominal = nominal_fit(data, 24)
    noise = Noise(correlated=1e-3, white=(1e-6, 1e-6))
    nominal = replace(nominal, problem=nominal.problem.under(noise))
    white = first_noise(nominal, VARIANTS["white"].rules({}))[0]
    assert white.ends is None
    assert white.correlated == 0
    assert white.white == (1e-6, 1e-6)
    assert first_noise(nominal, RULES)[0].ends is not None


def test_the_restart_is_counted_and_left_out(monkeypatch):
    again, told = object(), {}
    monkeypatch.setattr(Selection, "restarted", lambda *_: again)
    arguments: tuple = (None, None, 0.2)
    assert VARIANTS[WHOLE].rules(told).selection.restarted(*arguments) is again
    assert told["restarts"] == 1
    assert VARIANTS[WITHOUT_RESTART].rules({}).selection.restarted(*arguments) is None


def test_what_the_restart_did_not_touch_is_not_run_again(tmp_path):
    whole = {
        "answer": {"verdict": "none", "effects": []}, "seconds": {"diagnose": 9.0},
        "told": {"restarts": 0, "restart_seconds": 2.0},
    }  # fmt: skip
    same = without(WITHOUT_RESTART, tmp_path, {WHOLE: whole})
    assert same["answer"] == whole["answer"]
    assert same["seconds"] == {"diagnose": 7.0}


def test_naive_bic_counts_values_and_asks_no_gate(monkeypatch):
    """χ² must fall by k ln n; neither the recording's threshold nor held-out blocks count."""
    current = SimpleNamespace(z=np.zeros(1000), cost=1000.0)
    few, many = candidate(40.0, 960.0), candidate(50.0, 955.0, "stiff_section")
    asked = []

    def fitted(self, now, scan, quick, slow, threshold, names, *more):
        asked.append(threshold)
        return [many, few]

    monkeypatch.setattr(Selection, "candidates", fitted)
    monkeypatch.setattr("benchmarks.discovery.left_out.replace", changed_copy)
    naive: Any = VARIANTS["bic"].rules({}).selection
    candidates = naive.candidates(current, [], [], [], 12.0, None)
    assert asked == [0.0]
    sizes = {c.hypothesis.name: len(c.hypothesis.effect.names) for c in candidates}
    for c in candidates:
        expected = 0.5 * (1000.0 - c.fit.cost - sizes[c.hypothesis.name] * np.log(1000))
        assert c.evidence == pytest.approx(expected)
    assert naive.acceptable(candidates, 12.0, current, []) is candidates[0]
    assert naive.acceptable([SimpleNamespace(evidence=-0.1)], 12.0, current, []) is None


def changed_copy(item: SimpleNamespace, **new) -> SimpleNamespace:
    return SimpleNamespace(**(vars(item) | new))


def test_the_cases_are_of_the_standard_set_half_with_errors():
    known = {case.name: case for case in listed("standard", 13)}
    chosen = [known[name] for name in CASES]
    for group in ("clean", "single"):
        assert np.mean([c.calibration for c in chosen if c.group == group]) == 0.5
    assert all(c.score in (12.0, 30.0) for c in chosen if c.group == "single")
    assert len({c.effects for c in chosen if c.group == "single"}) == 8


def test_the_table_counts():
    def judgement(group, verdict, named, calibration=False):
        return {
            "group": group, "true": ["tether"] if group == "single" else [], "verdict": verdict,
            "named": named, "first": named[:1] == ["tether"], "in_set": ["tether" in named],
            "calibration": calibration, "seconds": 10.0, "score": 12.0,
        }  # fmt: skip

    told = {key: {"restarts": 0, "rounds": []} for key in VARIANTS}
    free = {"name": "free_rope", "evidence": 5.0, "absorbed": 0.4}
    best = {"name": "tether", "evidence": 9.0, "absorbed": 0.9}
    seen = {key: judgement("single", "found", ["tether"]) for key in VARIANTS}
    seen["white"] = judgement("single", "found", ["kink", "tether"])
    quiet = {key: judgement("clean", "none", [], True) for key in VARIANTS}
    quiet["calibration"] = judgement("clean", "found", ["kink"], True)
    noted = told | {FREE: {"rounds": [{"free": free, "best": best}]}}
    done = [
        {"case": "a", "judged": seen, "told": noted},
        {"case": "b", "judged": quiet, "told": told},
    ]
    text = markdown(done, "c", 2)
    rows = {cells[0]: cells[1:] for cells in (line.split(" | ") for line in text.split("\n"))}
    assert rows["| nothing"][:4] == ["0 of 0", "0 of 1", "1 of 1", "1 of 1"]
    assert rows["| no calibration errors"][1] == "1 of 1"
    assert rows["| white noise"][2:5] == ["0 of 1", "1 of 1", "2.0"]
    assert "takes 40% of the misfit beyond noise (the best effect 90%)" in text
    assert "higher evidence in 0 of 1" in text


@pytest.mark.parametrize("selection", [NaiveBic, WithFreeRope])
def test_selections_take_all_that_a_round_gives_them(selection):
    *of_the_model, _ = "self", "current", "scan", "quick", "slow"
    named = set(inspect.signature(Selection.candidates).parameters) - set(of_the_model)
    inspect.signature(selection.candidates).bind(*of_the_model, **dict.fromkeys(named))
