"""Blind benchmark of the coefficient of friction: MuJoCo's rope, dragged over a rough table.

    python -m benchmarks.discovery.friction [--seeds FIRST:LAST] [--most N] [--rough COEFFICIENT]
        [--out DIR] [--json FILE] [--write docs/results.md]

Every seed draws a rope, a table, a path and a camera (`dragging.py`); seeds whose rope does not
come to rest are excluded and counted. Asked is the coefficient that `ropefit diagnose` gives,
nothing told of the table. Finished seeds are kept in DIR.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery import dragging
from benchmarks.discovery.made import write
from benchmarks.discovery.run import diagnose, kept, read_json
from benchmarks.document import parser, publish
from reference_simulators.collocation import NotConverged

ROUGH, CLOSE, MOST_SECONDS = 0.3, 0.2, 120.0  # coefficient; relative error, s: the bars
NAME, VALUE = "contact_friction", "coefficient"


def one(seed: int, rough: float, out: Path) -> dict[str, Any]:
    """Make, run and judge a seed."""
    recording, truth = out / f"recording-{seed}", out / f"truth-{seed}.json"
    if not truth.exists():
        try:
            made = dragging.make(seed, False, rough)
        except (RuntimeError, NotConverged, np.linalg.LinAlgError) as error:
            return {"seed": seed, "not_made": str(error)}
        write(recording, truth, f"friction-{seed}", made, seed, "pair")
    done = kept(out / f"{seed}.json", lambda: diagnose(recording, out / f"run-{seed}"))
    scores = {e["name"]: e["score"] for e in read_json(truth)["effects"]}
    return {"seed": seed, "score": scores[NAME], **judge(rough, done["answer"]), **done}


def judge(rough: float, answer: dict[str, Any] | None) -> dict[str, Any]:
    """Return the coefficient that was found, its interval, and whether it is right."""
    effects = answer["effects"] if answer else []
    own = next((e for e in effects if e["name"] == NAME), None)
    if own is None:
        return {"value": None, "interval": None, "inside": None, "close": False}
    told = own["parameters"][VALUE]
    low, high = told["ci95"]
    close = abs(told["value"] / rough - 1) <= CLOSE
    inside = bool(low <= rough <= high)
    return {"value": told["value"], "interval": [low, high], "inside": inside, "close": close}


def table(found: list[dict[str, Any]], rough: float, chosen: str) -> str:
    """Return the table, a row for each recording that could be made."""
    made = [row for row in found if "not_made" not in row]
    told = [row for row in made if row["value"] is not None]
    times = [row["processor"] for row in made]
    lines = [
        f"A pinned rope dragged over a rough table in 20 poses (coefficient {rough:g}), by MuJoCo; "
        f"nothing told of the table; by `python -m benchmarks.discovery.friction {chosen}`. "
        f"*Score*: of friction alone. {len(found) - len(made)} further seeds not made (no rest).",
        "",
        "| seed | score | answer | coefficient (95 %) | error | processor time [s] |",
        "|---" * 6 + "|",
    ]
    for row in made:
        answer = row["answer"]
        names = ", ".join(e["name"] for e in answer["effects"]) if answer else row["error"]
        size, error = "-", "-"
        if row["value"] is not None:
            low, high = row["interval"]
            size = f"{row['value']:.3f} ({low:.2f} .. {high:.2f})"
            error = f"{100 * (row['value'] / rough - 1):+.0f} %"
        what = names or answer["verdict"]
        lines.append(
            f"| {row['seed']} | {row['score']:.0f} | {what} | {size} | {error} "
            f"| {row['processor']:.0f} |"
        )
    lines += [
        "",
        f"Friction named: {len(told)} of {len(made)}; within {100 * CLOSE:.0f} %: "
        f"{sum(row['close'] for row in made)}; inside the interval: "
        f"{sum(bool(row['inside']) for row in told)} of {len(told)}; processor time of all three "
        f"stages at most {MOST_SECONDS:.0f} s: {sum(t <= MOST_SECONDS for t in times)} "
        f"(longest {max(times, default=0.0):.0f} s).",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Make, run, judge, print."""
    arguments = parser(__doc__)
    arguments.add_argument("--seeds", default="0:12", help="FIRST:LAST, the last one excluded")
    arguments.add_argument("--most", type=int, default=10, help="recordings that are judged")
    arguments.add_argument("--rough", type=float, default=ROUGH, help="coefficient of friction")
    arguments.add_argument("--out", type=Path, default=Path("discovery-friction"))
    options = arguments.parse_args()
    first, last = (int(part) for part in options.seeds.split(":"))
    found: list[dict[str, Any]] = []
    for seed in range(first, last):
        if sum("not_made" not in row for row in found) >= options.most:
            break
        found.append(one(seed, options.rough, options.out))
        print({k: v for k, v in found[-1].items() if k not in ("answer", "seconds")}, flush=True)
    chosen = f"--seeds {options.seeds}"
    if options.rough != ROUGH:
        chosen += f" --rough {options.rough:g}"
    publish(options, "discovery-friction", table(found, options.rough, chosen), {"rows": found})


if __name__ == "__main__":
    main()
