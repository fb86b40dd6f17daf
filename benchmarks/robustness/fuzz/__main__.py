"""Fuzz every reader, coverage-guided, until there are enough executions.

    python -m benchmarks.robustness.fuzz [--executions 1000000] [--write docs/robustness.md]
                                         [--json FILE]

Counts add up over calls (in build/fuzz); --fresh begins anew. Needs atheris: pip install atheris.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path
from typing import Any

import atheris

from benchmarks.document import parser, publish
from benchmarks.robustness.fuzz.one import HANG, MEMORY, fuzz, slug

ROOMS = ["ropefit.recordings", "ropefit.artifacts", "ropefit.importers", "ropefit.adapters.targets"]
with atheris.instrument_imports(  # type: ignore[attr-defined]
    include=[*ROOMS, "ropefit.stages.simulate"]
):
    from benchmarks.robustness.fuzz.targets import TARGETS, WORDS

STATE = Path("build/fuzz")


def main() -> None:
    """Fuzz in rounds over all targets; print the table."""
    p = parser(__doc__)
    p.add_argument("--executions", type=int, default=1_000_000)
    p.add_argument("--seconds", type=int, default=30, help="of one target in one round")
    p.add_argument("--fresh", action="store_true")
    p.add_argument("--only", nargs="*", choices=sorted(TARGETS), default=None)
    options = p.parse_args()
    if options.fresh:
        shutil.rmtree(STATE, ignore_errors=True)
    STATE.mkdir(parents=True, exist_ok=True)
    (STATE / "words").write_text("".join(f'"{_escaped(word)}"\n' for word in WORDS))
    totals = _load()
    names = options.only or list(TARGETS)
    while (left := options.executions - _executions(totals)) > 0:
        print(f"{left} executions to go", file=sys.stderr, flush=True)
        for name in names:
            if _executions(totals) >= options.executions and len(totals) >= len(names):
                break
            _round(name, options.seconds, totals)
            (STATE / "totals.json").write_text(json.dumps(totals, indent=1))
    publish(options, "fuzz", _table(totals), totals)
    if any(t["findings"] or t["ended"] for t in totals.values()):
        raise SystemExit("there are findings: see the inputs and traces in build/fuzz")


def _load() -> dict[str, Any]:
    path = STATE / "totals.json"
    return json.loads(path.read_text()) if path.exists() else {}


def _executions(totals: dict[str, Any]) -> int:
    return sum(t["executions"] for t in totals.values())


def _round(name: str, seconds: int, totals: dict[str, Any]) -> None:
    """Fuzz one target in a process of its own; add what it counted and found."""
    t = totals.setdefault(
        name, {"executions": 0, "refused": 0, "rounds": 0, "findings": {}, "ended": []}
    )
    log = STATE / f"{slug(name)}.json"
    log.unlink(missing_ok=True)
    told = STATE / f"{slug(name)}.log"
    child = os.fork()  # all is imported and instrumented already
    if child == 0:
        with told.open("w") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        fuzz(name, seconds, 1 + t["rounds"], STATE)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    t["rounds"] += 1
    if log.exists():
        found = json.loads(log.read_text())
        t["executions"] += found["executions"]
        t["refused"] += found["refused"]
        t["findings"] |= found["findings"]
    if status != 0:  # a hang, a crash or too much memory
        text = told.read_text(errors="replace")
        lines = [line for line in text.splitlines() if "ERROR" in line or "SUMMARY" in line]
        t["ended"].append(" ".join(lines)[:300] or f"status {status}: {text[-300:]}")


def _escaped(word: str) -> str:
    return "".join(c if c.isalnum() else f"\\x{ord(c):02x}" for c in word)


def _table(totals: dict[str, Any]) -> str:
    lines = [
        f"{_executions(totals):,} executions, guided by coverage (atheris), of readers on a valid",
        "source one file of which the fuzzer replaces; written by",
        "`python -m benchmarks.robustness.fuzz`. *Finding*: an exception other than a one-line",
        "failure, a warning, a file touched outside the source, a program started, anything",
        f"unpickled. *Ended*: a crash, a hang over {HANG} s, more than {MEMORY} MB.",
        "",
        "| readers | targets | executions | refused | findings | ended |",
        "|---|---|---|---|---|---|",
    ]
    kinds: dict[str, list[dict[str, Any]]] = {}
    for name, t in totals.items():
        kinds.setdefault(_kind(name), []).append(t)
    for kind, some in kinds.items():
        counts = [sum(t[key] for t in some) for key in ("executions", "refused")]
        found = [sum(len(t[key]) for t in some) for key in ("findings", "ended")]
        lines.append(
            f"| {kind} | {len(some)} | {counts[0]:,} | {counts[1]:,} | {found[0]} | {found[1]} |"
        )
    return "\n".join(lines) + "\n"


def _kind(name: str) -> str:
    """Return the group of readers that a target belongs to, in the table."""
    ends = {
        ".h5": "artifacts", ".ply": "point clouds", ".pcd": "point clouds", ".npz": "markers, ends",
        ".csv": "markers, ends",
    }  # fmt: skip
    if name.startswith("import "):
        return "importers"
    if name in ("colour", "depth"):
        return "pictures"
    return next((kind for end, kind in ends.items() if name.endswith(end)), "descriptions, targets")


if __name__ == "__main__":
    main()
