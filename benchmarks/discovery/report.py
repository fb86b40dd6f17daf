"""The scores as text: targets, what was called otherwise, misses, worked examples."""

from __future__ import annotations

from typing import Any

from benchmarks.discovery.concealed import IN_TIME
from benchmarks.discovery.concealed_errors import UNKNOWN
from benchmarks.discovery.score import VISIBLE, confusion, rows

MOST_MISSES = 40
Case = dict[str, Any]


def markdown(
    judgements: list[dict[str, Any]], impossible: dict[str, str], options: str, listed: int
) -> str:
    """Return the section of docs/results.md; options: of the command; listed: cases it asks for."""
    in_time = [j for j in judgements if IN_TIME & set(j["true"])]
    lines = [
        f"{len(judgements)} of {listed} recordings by simulators that are not ropefit's; by",
        f"`python -m benchmarks.discovery {options}`. *Visible*: a score of at least 12",
        "(signal over noise, without the part explained by EI and errors of the set-up).",
        f"*Time-dependent*: those with {', '.join(sorted(IN_TIME))}.",
        "",
        "| what | target | measured | cases | met | time-dependent | cases | met |",
        "|---|---|---|---|---|---|---|---|",
    ]
    marks = {True: "yes", False: "**no**", None: ""}
    for r, t in zip(rows(judgements), rows(in_time), strict=True):
        if not r["cases"]:
            continue
        lines.append(
            f"| {r['what']} | {r['target']} | {r['measured']} | {r['cases']} "
            f"| {marks[r['passed']]} "
            f"| {t['measured']} | {t['cases'] or ''} | {marks[t['passed']]} |"
        )
    called = confused(judgements)
    if called:
        lines += [
            "",
            "First named (or verdict), where not a true effect: " + "; ".join(called) + ".",
        ]
    missed = [j for j in judgements if miss(j)]
    if missed:
        more = [f"and {len(missed) - MOST_MISSES} more (`--json`)"] * (len(missed) > MOST_MISSES)
        lines += ["", "Misses: " + "; ".join([miss(j) for j in missed[:MOST_MISSES]] + more) + "."]
    if impossible:
        lines += ["", "Not made, because no plausible size reaches the score:", ""]
        lines += [f"- {name}: {why}" for name, why in sorted(impossible.items())]
    return "\n".join(lines) + "\n"


def confused(judgements: list[Case]) -> list[str]:
    """Return, for every true effect that was called something else, by how many and what."""
    out = []
    verdicts = {"clean": {"none"}, "coarse mesh": {"none"}} | {
        name: {"unknown"} for name in UNKNOWN
    }
    for true, counts in confusion(judgements).items():
        right = verdicts.get(true, set(true.split(" + ")))
        others = [f"{name} {count}" for name, count in counts.most_common() if name not in right]
        if others:
            out.append(f"{true} (of {sum(counts.values())}) {', '.join(others)}")
    return out


def miss(j: dict[str, Any]) -> str:
    """Return what went wrong with a case, in a line; empty when nothing did."""
    head = f"`{j['case']}` ({' + '.join(j['true']) or 'nothing'}, score {j['score']:.3g}) "
    if "verdict" not in j:
        return head + str(j["error"])
    said = ", ".join("/".join(one) for one in j["sets"]) or j["verdict"]
    group = j["group"]
    if group == "clean":
        good = j["verdict"] == "none"
    elif group == "coarse":
        good = "physics" not in j["kinds"] and j["verdict"] != "unknown"
    elif group == "unknown":
        ratio = j["heldout_ratio"]
        good = j["verdict"] == "unknown" or (ratio is not None and ratio <= 1.10)
    else:
        good = all(j["in_set"]) or (j["score"] < 5 and j["verdict"] == "none")
    return "" if good else head + f"called {said}"


def examples(judgements: list[Case], answers: dict[str, Case]) -> str:
    """Return the first case of each kind with the right answer; answers by name of the case."""
    chosen = {
        "Found": next((j for j in judgements if _found(j)), None),
        "Clean": next((j for j in judgements if _is(j, "clean", "none")), None),
        "Unknown": next((j for j in judgements if _is(j, "unknown", "unknown")), None),
    }
    write = {"Found": _tell_found, "Clean": _tell_clean, "Unknown": _tell_unknown}
    parts = []
    for kind, case in chosen.items():
        if case is not None:
            parts.append(
                f"**{kind}:** `{case['case']}`. " + write[kind](case, answers[case["case"]])
            )
    return (
        "\n\n".join(["Worked examples, the first of each kind with the right answer:", *parts])
        + "\n"
    )


def _found(j: Case) -> bool:
    return j["group"] == "single" and j["score"] >= VISIBLE and bool(j.get("first"))


def _is(j: Case, group: str, verdict: str) -> bool:
    return j["group"] == group and j.get("verdict") == verdict


def _tell_found(j: Case, answer: Case) -> str:
    effect = answer["effects"][0]
    held, evidence = answer["heldout"], effect["evidence"]
    low, high = effect["arc_length_m"]
    sizes = "; ".join(
        f"{name} {p['value']:.3g} {p['unit']} ({p['ci95'][0]:.3g} to {p['ci95'][1]:.3g})"
        for name, p in effect["parameters"].items()
        if p.get("ci95")
    )
    others = ", ".join(effect["equivalent_to"]) or "nothing"
    return (
        f"Concealed: {j['true'][0]}, score {j['score']:.3g}. Answer: *{effect['description']}*; "
        f"{sizes}; between {low:.3f} and {high:.3f} m; log Bayes factor "
        f"{evidence['log_bayes_factor']:.1f}, held-out frames "
        f"{evidence['heldout_log_likelihood_gain']:.1f} nats more likely; rms "
        f"of held-out points {1e3 * held['rms_before_m']:.2f} mm before and "
        f"{1e3 * held['rms_after_m']:.2f} mm after (noise {1e3 * held['noise_m']:.2f}). "
        f"Could also be: {others}. {_next(answer)}"
    )


def _tell_clean(j: Case, answer: Case) -> str:
    rows = ", ".join(
        f"{name} {size['value']:.3g} {size['unit']}" for name, size in answer["detectable"].items()
    )
    return f"Nothing concealed. Answer: `none`; detectable would have been: {rows}."


def _tell_unknown(j: Case, answer: Case) -> str:
    latent, regions = answer["latent_force"], answer["mismatch"][:3]
    where = "; ".join(
        f"{r['arc_length_m'][0]:.2f} to {r['arc_length_m'][1]:.2f} m in frames {r['frames'][0]} to "
        f"{r['frames'][-1]}, {1e3 * r['rms_m']:.1f} mm"
        for r in regions
    )
    return (
        f"Concealed: {j['true'][0]}, which is in no catalogue. Answer: `unknown`; no known effect "
        f"explains what is missing; a free force along the rope does, log Bayes factor "
        f"{latent['log_evidence']:.1f} (threshold {latent['threshold']:.1f}); strongest at {where}."
    )


def _next(answer: Case) -> str:
    told = answer.get("next_motion")
    return f"To know more: {told['description']}." if told else ""
