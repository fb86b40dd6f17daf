"""Three answers in full: an effect that was found, a clean recording, and something unknown."""

from __future__ import annotations

from typing import Any

from benchmarks.discovery.score import VISIBLE

Case = dict[str, Any]


def markdown(judgements: list[Case], answers: dict[str, Case]) -> str:
    """Of each kind the first case that was answered rightly; truths by name in the judgements."""
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
        "\n\n".join(["Worked examples, the first of each kind that was answered rightly:", *parts])
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
        f"Concealed: {j['true'][0]}, score {j['score']:.3g}. Said: *{effect['description']}*; "
        f"{sizes}; between {low:.3f} and {high:.3f} m; log Bayes factor "
        f"{evidence['log_bayes_factor']:.1f}, held-out frames "
        f"{evidence['heldout_log_likelihood_gain']:.1f} nats more likely; rms "
        f"of held-out points {1e3 * held['rms_before_m']:.2f} mm before and "
        f"{1e3 * held['rms_after_m']:.2f} mm after (noise {1e3 * held['noise_m']:.2f}). "
        f"Could also be: {others}. {_next(answer)}"
    )


def _tell_clean(j: Case, answer: Case) -> str:
    rows = [
        f"| {name} | {size['value']:.3g} {size['unit']} |"
        for name, size in answer["detectable"].items()
    ]
    table = "\n".join(["| effect | detectable from |", "|---|---|", *rows])
    return f"Nothing concealed. Said: nothing beyond noise; what would have been seen:\n\n{table}"


def _tell_unknown(j: Case, answer: Case) -> str:
    latent, regions = answer["latent_force"], answer["mismatch"][:3]
    where = "; ".join(
        f"{r['arc_length_m'][0]:.2f} to {r['arc_length_m'][1]:.2f} m in frames {r['frames'][0]} to "
        f"{r['frames'][-1]}, {1e3 * r['rms_m']:.1f} mm"
        for r in regions
    )
    return (
        f"Concealed: {j['true'][0]}, which is in no catalogue. Said: something is missing that no "
        f"known effect explains; a free force along the rope does, log Bayes factor "
        f"{latent['log_evidence']:.1f} (threshold {latent['threshold']:.1f}); strongest at {where}."
    )


def _next(answer: Case) -> str:
    told = answer.get("next_motion")
    return f"To know more: {told['description']}." if told else ""
