"""Score the answers: each case against its truth, and the table of targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.discovery.concealed import IN_MOTION
from benchmarks.discovery.concealed_errors import MEASUREMENT

VISIBLE, WEAK = 12.0, 6.0
PLACE = 0.03  # of the length
# The place of a plane or a bar has many parametrisations: only that there is one is scored.
NO_SIZE = {"support_plane", "obstacle"}
GRAVITY_TURNED = "distributed_load"  # on a uniform rope: no shape tells the two apart
OTHER_TIMES = {*IN_MOTION, "contact_friction"}  # whose bars are other ones
FACTORS = {"log_factor": lambda v: abs(float(np.log(v))), "scale": lambda v: v - 1}


def names_of(effect: dict[str, Any]) -> set[str]:
    """Return the names of an accepted effect and of its equivalents."""
    return {effect["name"], *effect.get("equivalent_to", [])}


def judged(truth: dict[str, Any], result: dict[str, Any]) -> dict[str, Any]:
    """Judge one case: return everything that the table counts."""
    answer = result["answer"]
    out: dict[str, Any] = {
        "case": truth["name"],
        "group": truth["group"],
        "true": [effect["name"] for effect in truth["effects"]],
        "score": min((e["score"] for e in truth["effects"]), default=0.0),
        "calibration": truth["calibration_errors"],
        "error": result["error"],
        "seconds": sum(result["seconds"].values()),
        "diagnose_seconds": result["seconds"].get("diagnose"),
        "processor": result.get("processor"),
    }
    if answer is None:
        return out
    effects = answer["effects"]
    held = answer.get("heldout") or {}
    out["verdict"] = answer["verdict"]
    out["named"] = [effect["name"] for effect in effects]
    out["kinds"] = [effect["kind"] for effect in effects]
    out["sets"] = [sorted(names_of(effect)) for effect in effects]
    after, noise = held.get("rms_after_m"), held.get("noise_m")
    out["heldout_ratio"] = after / noise if after is not None and noise else None
    out["set_size"] = len(names_of(effects[0])) if effects else 0
    out["first"] = bool(effects) and effects[0]["name"] in out["true"]
    sets = [names_of(effect) for effect in effects]
    out["in_set"] = [any(name in one for one in sets) for name in out["true"]]
    out |= _place_and_size(truth, effects)
    return out


def _place_and_size(truth: dict[str, Any], effects: list[dict[str, Any]]) -> dict[str, Any]:
    """Return whether the named true effects have the right place and size; None where not asked."""
    place, size, error = [], [], []
    for true in truth["effects"]:
        match = next((e for e in effects if e["name"] == true["name"]), None)
        if match is None:
            continue
        where, said = true["arc_length_m"], match.get("arc_length_m")
        local = where is not None and where[1] - where[0] < 0.9 * truth["length_m"]
        if where is not None and local and said:
            off = abs(np.mean(where) - np.mean(said)) / truth["length_m"]
            error.append(float(off))
            place.append(bool(off <= PLACE))
        found, value = same_quantity(true, match.get("parameters", {}))
        if found and found.get("ci95"):
            low, high = sorted(found["ci95"])
            values = [value]
            if low <= high <= 0:  # a direction's sign is a matter of convention
                values.append(-value)
            size.append(any(low <= value <= high for value in values))
    return {"place": place, "place_error": error, "size": size}


def same_quantity(
    true: dict[str, Any], parameters: dict[str, Any]
) -> tuple[dict[str, Any] | None, float]:
    """Return the reported parameter of the true one's name, or the only one of its unit; its truth.

    Factors may also be reported as their logarithm or as what they add to one.
    """
    value = float(true["value"])
    if true["name"] in NO_SIZE:
        return None, value
    if true["parameter"] in parameters:
        return parameters[true["parameter"]], value
    if true["parameter"] == "factor":
        for name, convert in FACTORS.items():
            if name in parameters:
                return parameters[name], convert(value)
    unit = _plain(true["unit"])
    same = [p for p in parameters.values() if _plain(p.get("unit", "")) == unit]
    return (same[0] if len(same) == 1 else None), value


def _plain(unit: str) -> str:
    return unit.replace("·", " ").replace("*", " ").replace("-", "").strip() or "1"


def share(values: list[Any]) -> tuple[float, int] | None:
    """Return the share of true values and their number; None of nothing."""
    known = [value for value in values if value is not None]
    return (float(np.mean(known)), len(known)) if known else None


def rows(judgements: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the table: what, target, measured, number of cases, whether it is met."""
    done = [j for j in judgements if "verdict" in j]
    group = {
        name: [j for j in done if j["group"] == name]
        for name in ("clean", "single", "pair", "decoy", "coarse", "unknown")
    }
    strong = [j for j in group["single"] if j["score"] >= 0.9 * VISIBLE]
    weak = [j for j in group["single"] if 0.8 * WEAK <= j["score"] < 0.9 * VISIBLE]
    effects = [j for j in group["single"] + group["pair"] if any(j["in_set"])]

    def wrong(j: dict[str, Any]) -> bool:
        return j["verdict"] == "found" and not any(j["in_set"])

    def physics(j: dict[str, Any]) -> bool:
        return j["verdict"] == "unknown" or "physics" in j["kinds"]

    def as_measurement(j: dict[str, Any]) -> bool:
        return bool(j["sets"]) and bool(set(j["sets"][0]) & set(MEASUREMENT))

    def fits(j: dict[str, Any]) -> bool:
        return j["heldout_ratio"] is not None and j["heldout_ratio"] <= 1.10

    table = [
        ("clean recordings called anything but `none`", "<=", 0.01,
         share([j["verdict"] != "none" for j in group["clean"]])),
        ("coarse mesh or loose tolerance called physics", "<=", 0.05,
         share([physics(j) for j in group["coarse"]])),
        ("visible single effect: first", ">=", 0.90, share([j["first"] for j in strong])),
        ("the same, without uniform loads, which are gravity turned", ">=", 0.90,
         share([j["first"] for j in strong if j["true"] != [GRAVITY_TURNED]])),
        ("visible single effect: in the reported set", ">=", 0.97,
         share([all(j["in_set"]) for j in strong])),
        ("score 6: detected", ">=", 0.60, share([j["verdict"] != "none" for j in weak])),
        ("score 6: named wrongly with confidence", "<=", 0.05, share([wrong(j) for j in weak])),
        ("place: centre within 3 % of L", ">=", 0.90,
         share([hit for j in strong for hit in j["place"]])),
        ("size inside its 95 % interval", "within", (0.90, 0.98),
         share([hit for j in effects for hit in j["size"]])),
        ("held-out rms at most 1.10 x noise", ">=", 0.90, share([fits(j) for j in effects])),
        ("two effects, both named", ">=", 0.80, share([all(j["in_set"]) for j in group["pair"]])),
        ("of them where both score 6 or more", ">=", 0.80,
         share([all(j["in_set"]) for j in group["pair"] if j["score"] > 0.9 * WEAK])),
        ("out of catalogue: `unknown`, or held-out frames predicted to noise", ">=", 0.90,
         share([j["verdict"] == "unknown" or fits(j) for j in group["unknown"]])),
        ("measurement decoys of score 6 or more called measurement (or a tie)", ">=", 0.95,
         share([as_measurement(j) for j in group["decoy"] if j["score"] > 0.9 * WEAK])),
    ]  # fmt: skip
    out = [_row(what, sign, target, found) for what, sign, target, found in table]
    sizes = [j["set_size"] for j in strong if j["set_size"]]
    out.append(_number("mean set size of visible single effects", 2.0, sizes))
    times = [j["diagnose_seconds"] for j in done]
    out.append(_number("mean time of `diagnose` [s]", 60.0, times))
    still = [j["processor"] for j in done if not OTHER_TIMES & set(j["true"]) and j["processor"]]
    what = "longest processor time of a recording at rest, all stages, but for friction [s]"
    out.append(_number(what, 60.0, still, np.max))
    failed = [j for j in judgements if "verdict" not in j]
    out.append(_row("recordings without an answer", "<=", 0.0,
                    (len(failed) / max(len(judgements), 1), len(judgements))))  # fmt: skip
    return out


def _row(what: str, sign: str, target: Any, found: tuple[float, int] | None) -> dict[str, Any]:
    text = f"{target[0]:.0%}-{target[1]:.0%}" if sign == "within" else f"{sign} {target:.0%}"
    value = found[0] if found else None
    passed = None
    if value is not None:
        passed = {
            "<=": lambda: value <= target,
            ">=": lambda: value >= target,
            "within": lambda: target[0] <= value <= target[1],
        }[sign]()
    measured = "-" if value is None else f"{value:.1%}"
    number = found[1] if found else 0
    return {"what": what, "target": text, "measured": measured, "value": value,
            "cases": number, "passed": passed}  # fmt: skip


def _number(
    what: str, target: float, values: list[float], of: Callable[[list[float]], Any] = np.mean
) -> dict[str, Any]:
    value = float(of(values)) if values else None
    return {"what": what, "target": f"<= {target:g}", "value": value, "cases": len(values),
            "measured": "-" if value is None else f"{value:.2f}",
            "passed": None if value is None else value <= target}  # fmt: skip


def confusion(judgements: list[dict[str, Any]]) -> dict[str, Counter[str]]:
    """Count by true effect what was named first (or the verdict)."""
    out: dict[str, Counter[str]] = {}
    for j in judgements:
        true = {"clean": "clean", "coarse": "coarse mesh"}.get(j["group"], " + ".join(j["true"]))
        if j["group"] == "pair":
            continue
        if "verdict" not in j:
            called = "no answer"
        else:
            called = j["named"][0] if j["verdict"] == "found" and j["named"] else j["verdict"]
        out.setdefault(true, Counter())[called] += 1
    return out
