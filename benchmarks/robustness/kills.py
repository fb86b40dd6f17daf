"""Kill -9 at random instants of all stages: is every artifact the old one or the new one?

    python -m benchmarks.robustness.kills [--kills 300] [--chain 0|1] [--write docs/robustness.md]
                                          [--json FILE]

Two sets of settings take turns in one run directory, so that there is always something old to lose.
Half of the kills come at a random time, half at a random step of writing (before or after a file is
made, filled, flushed, renamed or removed). After each, every file must be, by hash, that of an
undisturbed run of either settings; the next process goes on in what was left.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.document import parser, publish
from benchmarks.robustness.interrupted_runs import (
    RESUMED,
    Chain,
    chains,
    count_steps,
    hashes,
    prepare,
    run_chain,
    tell_resumed,
)
from benchmarks.threads import use_threads
from ropefit.diagnosis.rules import Rules
from ropefit.runs import checkpoint
from ropefit.runs.run_directory import CHECKPOINTS
from ropefit.stages import diagnose
from tests.factories import marker_recording

KILLED = -signal.SIGKILL
SOUGHT = ("distributed_load", "scale_error")  # by the diagnosis: all would take a minute a time
LOST = ("damaged", "other", "unequal", "left")


@dataclass
class Tally:
    """Kills by stage, and what was found after them."""

    kills: Counter[str] = field(default_factory=Counter)
    resumed: int = 0
    finished: int = 0
    damaged: list[str] = field(default_factory=list)
    other: list[str] = field(default_factory=list)
    unequal: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)


def disturb(chain: Chain, kills: int, run: Path, rng: np.random.Generator) -> Tally:
    """Kill until there are enough; what was found."""
    tally, which = Tally(), 0
    while True:
        enough = sum(tally.kills.values()) >= kills
        by_step = not enough and rng.random() < 0.5
        at = int(rng.integers(1, chain.steps + 1)) if by_step else None
        read_end, write_end = os.pipe()
        child = os.fork()
        if child == 0:
            count_steps(at)
            tell_resumed(write_end)
            try:
                run_chain(chain, which, run, write_end)
            except BaseException as error:
                print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
                os._exit(1)
            os._exit(0)
        os.close(write_end)
        if not enough and not by_step:
            time.sleep(float(rng.uniform(0, chain.seconds)))
            os.kill(child, signal.SIGKILL)  # a process that has ended waits for us: its own number
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        stages = os.read(read_end, 100)
        os.close(read_end)
        _check(chain, run, tally)
        print(f"{chain.name}: {sum(tally.kills.values())} of {kills} kills", file=sys.stderr)
        tally.resumed += stages.count(RESUMED)
        stages = stages.replace(bytes([RESUMED]), b"")
        if code == KILLED:
            tally.kills[chain.calls[which][stages[-1]][0] if stages else "start"] += 1
        elif code != 0:
            tally.unequal.append(f"exit code {code}")
            if enough:
                return tally
        else:
            tally.finished += 1
            _finished(chain, which, run, tally)
            if enough:
                return tally
            which = 1 - which


def _check(chain: Chain, run: Path, tally: Tally) -> None:
    try:
        found = hashes(run)
    except Exception as error:
        tally.damaged.append(str(error))
        return
    for name, digest in found.items():
        if name not in CHECKPOINTS and digest not in (f.get(name) for f in chain.files):
            tally.other.append(name)


def _finished(chain: Chain, which: int, run: Path, tally: Tally) -> None:
    """Check a run that came to its end: the same numbers, and nothing else in the folder."""
    found = hashes(run)
    if found != chain.files[which]:
        wrong = {
            n for n in {*found, *chain.files[which]} if found.get(n) != chain.files[which].get(n)
        }
        tally.unequal.append(f"{sorted(wrong)} after {sum(tally.kills.values())} kills")
    tally.left += [path.name for path in run.iterdir() if path.name not in found]


def measure(
    kills: int, scratch: Path, seed: int = 0, which: int | None = None, until: str = "report"
) -> dict[str, Tally]:
    """Prepare and disturb both chains, or one of them, up to a stage."""
    use_threads(1)
    checkpoint.EVERY, checkpoint.SELDOM = 0.01, 0  # so that many are interrupted, and resumed
    diagnose.RULES = Rules(effects=SOUGHT)
    recording = marker_recording(scratch / "recording", frames=4)
    out = {}
    for number, chain in enumerate(chains(recording)):
        if which not in (None, number):
            continue
        last = [name for name, _ in chain.calls[0]].index(until) + 1
        chain.calls = [calls[:last] for calls in chain.calls]
        prepare(chain, scratch)
        part = kills if which is not None else kills - kills // 3 if number == 0 else kills // 3
        rng = np.random.default_rng([seed, number])
        out[chain.name] = disturb(chain, part, scratch / f"run {number}", rng)
    return out


def main() -> None:
    """Print the table; exit 1 if anything was lost."""
    p = parser(__doc__)
    p.add_argument("--kills", type=int, default=300)
    p.add_argument("--seed", type=int, default=0)
    p.add_argument(
        "--chain",
        type=int,
        choices=(0, 1),
        default=None,
        help="one of the two; the other's counts are taken from --json",
    )
    p.add_argument("--until", default="report", help="last stage")
    options = p.parse_args()
    scratch = Path(tempfile.mkdtemp(prefix="ropefit-kills-"))
    try:
        found = measure(options.kills, scratch, options.seed, options.chain, options.until)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    stages = ["start", "preprocess", "identify", "diagnose", "control", "report"]
    lines = [
        "Processes ended by kill -9, half at random times, half at random steps of writing a file;",
        "written by `python -m benchmarks.robustness.kills`. *Damaged*: an artifact that cannot be",
        "read or whose hash is wrong; *other*: neither the old file nor the new one; *unequal*: a",
        "resumed run that ended with other bytes than an undisturbed one; *left*: temporary files",
        "left behind. Here stages write a checkpoint every 0.01 s instead of every 10 s; *resumed*",
        "counts those that continued from one. To be quick, the diagnosis tests two effects only.",
        "",
        f"| chain | {' | '.join(stages)} | resumed | finished | damaged | other | unequal | left |",
        "|---" * (len(stages) + 7) + "|",
    ]
    data = {name: vars(t) | {"kills": dict(t.kills)} for name, t in found.items()}
    if options.chain is not None and options.json and options.json.exists():
        data = {**json.loads(options.json.read_text()), **data}
    for name, t in data.items():
        counts = " | ".join(str(t["kills"].get(stage, 0)) for stage in stages)
        rest = " | ".join(str(len(t[what])) for what in LOST)
        lines.append(f"| {name} | {counts} | {t['resumed']} | {t['finished']} | {rest} |")
    publish(options, "kills", "\n".join(lines) + "\n", data)
    lost = [f"{what}: {t[what]}" for t in data.values() for what in LOST if t[what]]
    if lost:
        raise SystemExit("\n".join(["something was lost:", *lost]))


if __name__ == "__main__":
    main()
