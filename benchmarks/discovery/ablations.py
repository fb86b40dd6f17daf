"""What each rule of the diagnosis contributes: the same recordings, one rule disabled at a time.

    python -m benchmarks.discovery.ablations [--cases NAME,...] [--seed N] [--out DIR]
                                             [--json FILE] [--write docs/results.md]

Recordings of `python -m benchmarks.discovery`, made and identified in DIR if they are not yet. The
diagnosis runs in this process; what is finished is kept in DIR and not run again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery.cases import Case, generate, listed
from benchmarks.discovery.left_out import FREE, VARIANTS, WHOLE, WITHOUT_RESTART, Notes
from benchmarks.discovery.run import identified, kept, read_json
from benchmarks.discovery.score import judged
from benchmarks.document import parser, publish
from ropefit.artifacts import Model, Observations
from ropefit.diagnosis.rules import Rules
from ropefit.errors import RopefitError
from ropefit.runs.loading import load
from ropefit.runs.protocol import Context
from ropefit.stages import diagnose

# Each first one in an exact set-up (the effect of score 12), the second in one with errors (30).
CASES = (
    "clean-000", "clean-003",
    "single-pointmass-001", "single-clampedend-002",
    "clean-009", "clean-006",
    "single-kink-005", "single-intrinsiccurvature-002",
    "single-endtwist-005", "single-softsection-006",
    "clean-012", "clean-015",
    "single-axialextensibility-001", "single-supportplane-006",
)  # fmt: skip
STIFFNESS = {"stiff_section", "soft_section", "intrinsic_curvature", "kink"}  # a free rope has them


def main() -> None:
    """Prepare, run, print."""
    arguments = parser(__doc__)
    arguments.add_argument("--cases", default=",".join(CASES), help="names, of the standard set")
    arguments.add_argument("--out", type=Path, default=Path("discovery"), help="results' folder")
    arguments.add_argument("--seed", type=int, default=5)
    arguments.add_argument("--score-only", action="store_true", help="only what is finished")
    options = arguments.parse_args()
    out, names = options.out / f"seed-{options.seed}", options.cases.split(",")
    known = {case.name: case for case in listed("standard", options.seed)}
    if strange := [name for name in names if name not in known]:
        arguments.error(f"--cases: {', '.join(strange)}: not in the standard set")
    done: list[dict[str, Any]] = []
    for name in names:
        found = one(known[name], out, options.score_only)
        if found is not None:
            done.append(found)
    command = f"python -m benchmarks.discovery.ablations --seed {options.seed}"
    if options.cases != ",".join(CASES):
        command += f" --cases {options.cases}"
    publish(options, "ablations", markdown(done, command, len(names)), {"cases": done})


def one(case: Case, out: Path, score_only: bool) -> dict[str, Any] | None:
    """Return the judgements of a case by variant, with notes; None if it cannot be made."""
    truth, run = out / "truth" / f"{case.name}.json", out / "runs" / case.name
    stored = {key: out / "ablations" / case.name / f"{key}.json" for key in VARIANTS}
    if score_only and not all(path.exists() for path in stored.values()):
        return None
    if not score_only:
        why = generate(case, out / "recordings", out / "truth")
        if why is not None:
            print(f"{case.name}: not made: {why}")
            return None
        if not (run / Model.file_name).exists():
            result = identified(out / "recordings" / case.name, run)
            if result["error"]:
                print(f"{case.name}: {result['error']}")
                return None
    results: dict[str, dict[str, Any]] = {}
    for key in VARIANTS:
        if score_only:
            results[key] = read_json(stored[key])
        else:
            results[key] = kept(stored[key], lambda key=key: without(key, run, results))
        said = results[key]["answer"] or {"verdict": results[key]["error"], "effects": []}
        called = "/".join(effect["name"] for effect in said["effects"])
        seconds = results[key]["seconds"]["diagnose"]
        print(f"{case.name}: {key}: {said['verdict']} {called} {seconds:.0f} s", flush=True)
    known = read_json(truth)
    return {
        "case": case.name,
        "judged": {key: judged(known, result) for key, result in results.items()},
        "told": {key: result["told"] for key, result in results.items()},
    }


def without(key: str, run: Path, results: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the answer to a prepared run under a variant, with the CPU time [s] it took.

    Where beginning anew changed nothing, the diagnosis without that rule is the whole one, less
    the time of trying, and is not run again.
    """
    if key == WITHOUT_RESTART and results[WHOLE]["answer"] is not None:
        whole = results[WHOLE]
        if not whole["told"]["restarts"]:
            seconds = whole["seconds"]["diagnose"] - whole["told"]["restart_seconds"]
            return whole | {"seconds": {"diagnose": seconds}}
    return timed(VARIANTS[key].rules, run)


def timed(rules: Callable[[Notes], Rules], run: Path) -> dict[str, Any]:
    """One diagnosis with something about it changed."""
    inputs = {kind.file_name: load(run, kind)[0] for kind in (Observations, Model)}
    warmed_up(run)
    notes: Notes = {}
    out: dict[str, Any] = {"answer": None, "error": None, "told": notes}
    begin = time.process_time()
    try:
        settings = diagnose.DiagnoseSettings()
        found = diagnose.diagnosed(inputs, settings, Context(), rules(notes))
    except RopefitError as error:
        out["error"] = str(error)
    else:
        effects = [
            {"name": cause.name, "kind": cause.kind, "equivalent_to": cause.equivalent_to}
            for cause in found["causes"].values()
        ]
        out["answer"] = {"verdict": found["verdict"], "effects": effects}
    return out | {"seconds": {"diagnose": time.process_time() - begin}}


@lru_cache(maxsize=1)
def warmed_up(run: Path) -> None:
    """Diagnose a few frames: loading compiled code is no part of any variant's time."""
    inputs = {kind.file_name: load(run, kind)[0] for kind in (Observations, Model)}
    with suppress(RopefitError):
        diagnose.compute(inputs, diagnose.DiagnoseSettings(most_frames=4), Context())


def markdown(done: list[dict[str, Any]], command: str, listed: int) -> str:
    """Return the section of docs/results.md."""
    clean = [one for one in done if one["judged"][WHOLE]["group"] == "clean"]
    single = [one for one in done if one not in clean]
    errors = sum(one["judged"][WHOLE]["calibration"] for one in done)
    scores = [one["judged"][WHOLE]["score"] for one in single]
    told = f" (scores {min(scores):.0f} to {max(scores):.0f})" if scores else ""
    lines = [
        f"One rule of the diagnosis disabled at a time, on {len(clean)} clean recordings and",
        f"{len(single)} with one visible effect{told} of the blind benchmark, the same in every",
        f"row; {errors} of these {len(done)} have errors of the set-up. {len(done)} of {listed}",
        f"asked for; by `{command}`. *False alarm*: a clean",
        "recording called anything but `none`. Time is the processor's, for one recording.",
        "",
        "| what is different | false alarms: exact set-up | with its errors | visible effect first "
        "| in the set | effects named | time [s] | meaning |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for key, variant in VARIANTS.items():
        quiet = [one["judged"][key] for one in clean]
        seen = [one["judged"][key] for one in single]
        cells = [
            variant.title,
            *(
                _count([_alarm(j) for j in quiet if j["calibration"] == errors])
                for errors in (False, True)
            ),
            _count([j.get("first", False) for j in seen]),
            _count([all(j.get("in_set", [False])) for j in seen]),
            _mean([len(j.get("named", [])) for j in seen], 1),
            _mean([j["seconds"] for j in quiet + seen], 0),
            variant.meaning or "the diagnosis as it is",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", *_said(done, single)]
    return "\n".join(lines) + "\n"


def _alarm(judgement: dict[str, Any]) -> bool:
    return judgement.get("verdict") != "none"


def _count(values: list[bool]) -> str:
    return f"{sum(values)} of {len(values)}"


def _mean(values: list[float], digits: int) -> str:
    return f"{np.mean(values):.{digits}f}" if values else "-"


def _said(done: list[dict[str, Any]], single: list[dict[str, Any]]) -> list[str]:
    """Return the notes of the variants: restarts, and the share that the free rope explains."""
    restarts = [one["told"][WHOLE]["restarts"] > 0 for one in done]
    lines = [
        f"The model was fitted again from the winner's values in {_count(restarts)} recordings; in "
        "the others that rule changes nothing.",
        "",
    ]
    others = [one for one in single if not STIFFNESS & set(one["judged"][WHOLE]["true"])]
    for what, some in (
        ("Effects other than stiffness and rest curve", others),
        ("Stiffness and rest curve", [one for one in single if one not in others]),
    ):
        first = [one["told"][FREE]["rounds"][:1] for one in some]
        fitted = [rounds[0] for rounds in first if rounds]
        if not fitted:
            continue
        beaten = [
            r["best"] is None or r["free"]["evidence"] > r["best"]["evidence"] for r in fitted
        ]
        named = ["free_rope" in one["judged"][FREE].get("named", []) for one in some]
        free, best = (_share([candidates[of] for candidates in fitted]) for of in ("free", "best"))
        lines.append(
            f"{what}: the free rope takes {free} of the misfit beyond noise "
            f"(the best effect {best}), has the higher evidence in {_count(beaten)} and is "
            f"accepted in {_count(named)}."
        )
    return lines


def _share(candidates: list[dict[str, Any] | None]) -> str:
    """Return the share of the misfit that each candidate takes away."""
    known = [r["absorbed"] if r else None for r in candidates]
    return ", ".join("none" if share is None else f"{share:.0%}" for share in known)


if __name__ == "__main__":
    main()
