"""Blind benchmark of `ropefit diagnose` on recordings with concealed effects.

    python -m benchmarks.discovery [--cases small|standard|blind|full|strong] [--only PATTERN]
                                   [--shard I/N] [--out DIR] [--json FILE] [--write FILE]

`--only` takes the cases whose whole names match a regular expression, such as 'clean-.*'. Cases
with an answer are kept in DIR and not run again; shards share DIR. `--make` only makes the
recordings, `--score-only` scores what all shards have finished, `--real-only` falsifies real
recordings and simulates none. `--section` is that of the document which the table replaces.
"""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

from benchmarks.discovery import falsified
from benchmarks.discovery.cases import Case, at_rest, generate, listed
from benchmarks.discovery.report import examples, markdown
from benchmarks.discovery.run import diagnose, identified, kept, read_json, shard
from benchmarks.discovery.score import judged, rows
from benchmarks.document import parser, publish

SIZES = ["small", "standard", "blind", "full", "strong"]


def main() -> None:
    """Make, run, score, print."""
    arguments = parser(__doc__)
    root = Path(__file__).parents[2]
    arguments.add_argument("--cases", choices=SIZES, default="standard")
    arguments.add_argument("--only", default=".*", metavar="PATTERN", help="whole names of cases")
    arguments.add_argument("--shard", type=shard, default=(1, 1), help="I/N: every N-th case")
    arguments.add_argument("--out", type=Path, default=Path("discovery"), help="results' folder")
    arguments.add_argument("--seed", type=int, default=5)
    arguments.add_argument("--make", action="store_true", help="only make the recordings")
    arguments.add_argument("--score-only", action="store_true", help="only what is finished")
    arguments.add_argument("--section", default="discovery")
    arguments.add_argument("--real-only", action="store_true", help="only the real recordings")
    arguments.add_argument("--real", type=Path, default=root.parent / "shared" / "real")
    options = arguments.parse_args()
    first, shards = options.shard
    if options.real_only:
        publish(options, "discovery-real", *falsified.table(options.real, options.out))
        return
    # What one seed makes is not another's.
    out = options.out / f"seed-{options.seed}"
    cases = [c for c in listed(options.cases, options.seed) if re.fullmatch(options.only, c.name)]
    cases = cases[first - 1 :: shards]
    judgements, impossible = [], {}
    for case in cases:
        found = one(case, out, options.make, options.score_only)
        if isinstance(found, str):
            impossible[case.name] = found
        elif found is not None:
            judgements.append(found)
    if options.make:
        for name, why in impossible.items():
            print(f"{name}: not made: {why}")
        return
    chosen = f"--cases {options.cases} --seed {options.seed}"
    if options.only != ".*":
        chosen += f" --only '{options.only}'"
    if shards > 1:
        chosen += f" --shard {first}/{shards}"
    answers = {
        j["case"]: read_json(out / "results" / f"{j['case']}.json")["answer"] for j in judgements
    }
    text = markdown(judgements, impossible, chosen, len(cases))
    text += "\n" + examples(judgements, answers)
    data: dict[str, Any] = {
        "rows": rows(judgements), "cases": judgements, "impossible": impossible,
    }  # fmt: skip
    publish(options, options.section, text, data)


def one(case: Case, out: Path, make_only: bool, score_only: bool) -> dict[str, Any] | str | None:
    """Return a case's judgement, a sentence if it cannot be made, None if nothing is judged."""
    recordings, truths, results = out / "recordings", out / "truth", out / "results"
    stored = results / f"{case.name}.json"
    if score_only and not stored.exists():
        return None
    if score_only:
        return judged(read_json(truths / f"{case.name}.json"), read_json(stored))
    start = time.perf_counter()
    why = generate(case, recordings, truths)
    if why is not None:
        return why
    print(f"{case.name}: made in {time.perf_counter() - start:.0f} s", flush=True)
    if make_only:
        return None
    nominal = None
    if case.nominal:
        nominal = out / "runs" / at_rest(case)
        kept(
            results / f"{at_rest(case)}.json",
            lambda: identified(recordings / at_rest(case), nominal),
        )
    run = out / "runs" / case.name
    result = kept(stored, lambda: diagnose(recordings / case.name, run, case.preprocess, nominal))
    return judged(read_json(truths / f"{case.name}.json"), result)


if __name__ == "__main__":
    main()
