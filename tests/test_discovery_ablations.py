"""The ablations: every variant leaves out what it says and nothing stays changed; a free rope can
bend to what it should, and pays for it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks.discovery.ablations import CASES, markdown, without
from benchmarks.discovery.cases import listed
from benchmarks.discovery.free_rope import KNOTS, FreeRope, free_rope
from benchmarks.discovery.left_out import FREE, VARIANTS, WHOLE, WITHOUT_RESTART
from ropefit.effects import StiffSection
from ropefit.effects.intrinsic_curvature import IntrinsicCurvature
from ropefit.inference.diagnosis import search as engine
from ropefit.inference.diagnosis.families import families
from ropefit.inference.noise import Noise
from ropefit.stages import diagnose
from tests.concealed import BINS, nominal_fit, recorded, rope, with_effect

SETUP = rope(24, 3)


def test_a_free_rope_holds_the_uniform_ones():
    free = FreeRope()
    values = torch.zeros(3 * KNOTS, dtype=torch.float64)
    assert free.apply(SETUP, values).properties.bend.equal(SETUP.properties.bend)
    values[:KNOTS] = 0.7
    values[KNOTS : 2 * KNOTS], values[2 * KNOTS :] = 0.4, -0.2
    p = free.apply(SETUP, values).properties
    whole = torch.tensor([0.4, -0.2, 0.5, 2.0], dtype=torch.float64)
    curved = IntrinsicCurvature().apply(SETUP, whole).properties.curvature
    np.testing.assert_allclose(p.bend / SETUP.properties.bend, np.exp(0.7), rtol=1e-12)
    np.testing.assert_allclose(p.twist / SETUP.properties.twist, np.exp(0.7), rtol=1e-12)
    np.testing.assert_allclose(p.curvature, curved, atol=1e-12)
    assert all(family.name != "free_rope" for family in families(SETUP))


def test_a_free_rope_absorbs_a_stiff_stretch_and_pays_on_a_clean_recording():
    stiff = recorded(with_effect(StiffSection(), [1.2, 0.5, 0.3], 96), seed=4)
    clean = recorded(rope(96), seed=4)
    found = {}
    for name, data in (("stiff", stiff), ("clean", clean)):
        nominal = nominal_fit(data, 48)
        rival = free_rope(nominal, data, Noise(), BINS)
        assert rival is not None
        assert rival.fit.cost <= nominal.cost
        found[name] = rival
    assert found["clean"].evidence < 0 < found["stiff"].evidence
    log = found["stiff"].values()[:KNOTS]
    assert log[3:5].mean() - log[[1, 6]].mean() == pytest.approx(1.2, abs=0.5)


def rival(evidence: float, cost: float, effect: str = "kink") -> SimpleNamespace:
    family = next(family for family in families(SETUP) if family.name == effect)
    return SimpleNamespace(family=family, evidence=evidence, fit=SimpleNamespace(cost=cost))


def parts() -> tuple:
    return (
        diagnose.calibration, engine.measure, engine._restarted, engine.fit_rivals,
        engine.winner_of, engine._noise,
    )  # fmt: skip


def test_each_variant_changes_its_own_part_and_puts_it_back():
    before, told = parts(), {}
    changed = {}
    for key, variant in VARIANTS.items():
        with variant.apart(told):
            pairs = zip(before, parts(), strict=True)
            changed[key] = [k for k, (old, new) in enumerate(pairs) if old is not new]
        assert parts() == before
    assert changed == {
        WHOLE: [2], "calibration": [0], "white": [1], WITHOUT_RESTART: [2], "bic": [3, 4, 5],
        FREE: [3, 5],
    }  # fmt: skip


def test_without_calibration_and_with_white_noise():
    with VARIANTS["calibration"].apart({}):
        assert diagnose.calibration(SETUP, diagnose.priors_of, False) == []  # type: ignore[arg-type]
    with VARIANTS["white"].apart({}):
        noise = engine.measure(None, [], Noise(correlated=1e-3, white=(1e-6, 1e-6)), [])  # type: ignore[arg-type]
    assert not noise.coloured
    assert noise.white == (1e-6, 1e-6)


def test_the_restart_is_counted_and_left_out(monkeypatch):
    again, told = object(), {}
    monkeypatch.setattr(engine, "_restarted", lambda *_: again)
    with VARIANTS[WHOLE].apart(told):
        assert engine._restarted(None, None, None, None, 0) is again  # type: ignore[arg-type]
    assert told["restarts"] == 1
    with VARIANTS[WITHOUT_RESTART].apart({}):
        assert engine._restarted(None, None, None, None, 0) is None  # type: ignore[arg-type]


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
    few, many = rival(40.0, 960.0), rival(50.0, 955.0, "stiff_section")
    asked = []

    def fitted(now, scan, driven, touching, data, noise, bins, threshold):
        asked.append(threshold)
        return [many, few]

    monkeypatch.setattr(engine, "fit_rivals", fitted)
    monkeypatch.setattr("benchmarks.discovery.left_out.replace", changed_copy)
    with VARIANTS["bic"].apart({}):
        rivals = engine.fit_rivals(current, [], [], [], None, Noise(), BINS, 12.0)  # type: ignore[arg-type]
        winner = engine.winner_of(rivals, 12.0, current, [])  # type: ignore[arg-type]
        assert asked == [0.0]
        sizes = {r.family.name: len(r.family.effect.names) for r in rivals}
        for r in rivals:
            expected = 0.5 * (1000.0 - r.fit.cost - sizes[r.family.name] * np.log(1000))
            assert r.evidence == pytest.approx(expected)
        assert winner is rivals[0]
        nothing = [SimpleNamespace(evidence=-0.1)]
        assert engine.winner_of(nothing, 12.0, current, []) is None  # type: ignore[arg-type]


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
