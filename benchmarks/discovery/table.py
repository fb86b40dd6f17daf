"""The scores as text: bars, confusion matrix, misses."""

from __future__ import annotations

from typing import Any

from benchmarks.discovery.concealed import IN_TIME
from benchmarks.discovery.score import confusion, rows

MOST_MISSES = 40


def markdown(
    judgements: list[dict[str, Any]], impossible: dict[str, str], options: str, listed: int
) -> str:
    """The section of docs/results.md; options: of the command; listed: cases it asks for."""
    in_time = [j for j in judgements if IN_TIME & set(j["true"])]
    lines = [
        f"{len(judgements)} of {listed} recordings by simulators that are not ropefit's, by",
        f"`python -m benchmarks.discovery {options}`. *Visible*: a score (signal",
        "over noise, after what EI and the set-up's errors absorb) of at least 12. *In time*:",
        f"of them those with {', '.join(sorted(IN_TIME))}.",
        "",
        "| what | bar | measured | cases | | in time | cases | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    marks = {True: "yes", False: "**no**", None: ""}
    for r, t in zip(rows(judgements), rows(in_time), strict=True):
        if not r["cases"]:
            continue
        lines.append(
            f"| {r['what']} | {r['bar']} | {r['measured']} | {r['cases']} | {marks[r['passed']]} | "
            f"{t['measured']} | {t['cases'] or ''} | {marks[t['passed']]} |"
        )
    counts = confusion(judgements)
    called = sorted({name for row in counts.values() for name in row})
    lines += [
        "",
        "What was called what (rows: truth; columns: first name, or verdict):",
        "",
    ]
    lines += ["| truth | " + " | ".join(called) + " |", "|---" * (len(called) + 1) + "|"]
    for true, row in counts.items():
        cells = [str(row[name]) if row[name] else "" for name in called]
        lines.append(f"| {true} | " + " | ".join(cells) + " |")
    missed = [j for j in judgements if miss(j)]
    if missed:
        lines += ["", "Misses:", ""]
        lines += [f"- {miss(j)}" for j in missed[:MOST_MISSES]]
        if len(missed) > MOST_MISSES:
            lines.append(f"- and {len(missed) - MOST_MISSES} more (`--json`)")
    if impossible:
        lines += ["", "Not made, because no plausible size is as visible as asked:", ""]
        lines += [f"- {name}: {why}" for name, why in sorted(impossible.items())]
    return "\n".join(lines) + "\n"


def miss(j: dict[str, Any]) -> str:
    """What went wrong with a case, in a line; empty when nothing did."""
    head = f"`{j['case']}` ({' + '.join(j['true']) or 'nothing'}, score {j['score']:.3g}): "
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
