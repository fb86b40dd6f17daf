"""The user's stopwatch: what a person waits for, every row a whole process.

    python -m benchmarks.felt [--repeats 5] [--only PATTERN] [--write docs/scale.md]
    python -m benchmarks.felt --check     # quick: against the ratios in felt.json
    python -m benchmarks.felt --record    # writes these ratios anew

Seconds differ between machines. The check compares processor time, best of three, with what an
import of numpy (rows without computation) or a fixed loop of matrix products takes in the same
minute, and fails where a row takes twice its recorded multiple of that.
"""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.document import parser, publish

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_data"
RATIOS = Path(__file__).with_suffix(".json")
SLOWER = 2.0  # times the recorded ratio: the check fails
TRIES = 3  # the best of them counts
FEW = 3  # frames of the recording that shows start-up
SEED = 101  # of the recordings with a cause; no seed of the blind benchmark's tables
CAUSES = {"weight": "point_mass", "contact": "support_plane"}  # a recording each, and its run
REAL = ROOT.parent / "shared" / "real" / "mocap_dlo1"  # rows of a measured motion need it
CLIPS = {"clips": 6, "clip": 1}  # of 500 frames, 13 markers each, in a recording of that name
JOIN = """
from pathlib import Path
from numpy import linspace
from benchmarks.real.motion import clips_of, join
every = clips_of(Path({real!r}), "train")
few = [every[int(k)] for k in linspace(0, len(every) - 1, {count}).round()]
join(Path({real!r}), few, Path({out!r}))
"""  # in a process of its own: the parent of what is measured stays light, see `spent`
MOVING = "EI,bend_damping,air_damping,rest_curve,length"
IMPORT = "import numpy"
PRODUCTS = "import numpy as np; a = np.ones((500, 500)); [a @ a for _ in range(100)]"


@dataclass(frozen=True)
class Row:
    """What is typed. `bar`: longest time [s] that is wanted; `computes`: compared with the loop of
    matrix products; `checked`: quick enough for the check; `most`: largest memory [MB] that is
    wanted; `first`: nothing is compiled yet."""

    name: str
    typed: str
    bar: float | None = None
    computes: bool = False
    checked: bool = True
    most: float | None = None
    first: bool = False


def slow(name: str, typed: str, bar: float | None, **more: Any) -> Row:
    """Return a row that is not part of the check."""
    return Row(name, typed, bar, True, False, **more)


ROWS = (
    Row("help", "--help", 0.2),
    Row("help of a command", "identify --help", 0.6),
    Row("a refusal", "identify --run none", 0.6),
    Row("an answer that is up to date", "identify --run sample", 0.6),
    Row("inspect a run", "inspect sample", 0.6),
    Row("preprocess, three frames of markers", "preprocess few --run few_run --force", 1.5, True),
    Row("identify, three frames of markers", "identify --run few_run --force", None, True),
    Row("preprocess, the sample", "preprocess --run sample --force", 2.0, True),
    Row("identify, the sample", "identify --run sample --force", 3.0, True),
    Row("diagnose, nothing missing", "diagnose --run sample --force", 8.0, True),
    Row("report, the sample", "report --run sample --force", None, True),
    slow("diagnose, one cause", "diagnose --run weight_run --force", 15.0),
    slow("diagnose, contact", "diagnose --run contact_run --force", 40.0),
    slow("run, the sample", "run --run sample --force", 15.0),
    slow("preprocess, 500 frames", "preprocess clip --run clip_run --force", None, most=600.0),
    slow("identify, 500 frames", "identify --run clip_run --force", None, most=600.0),
    slow("diagnose, 500 frames", "diagnose --run clip_run --force", None, most=600.0),
    slow(
        "identify, six clips in motion",
        f"identify --run clips_run --solver dynamics --free {MOVING} --force",
        60.0,
        most=500.0,
    ),
    slow("first use: all is compiled", "warm-up", 25.0, first=True),
)


@dataclass(frozen=True)
class Spent:
    """What one process took: time [s], processor time [s], peak of memory [MB]."""

    seconds: float
    processor: float
    memory: float


def spent(*command: str, folder: Path, **more: str) -> Spent:
    """Run a process to its end. Its exit code is not looked at: some rows are refusals.

    The peak of memory is at least that of this process, which the child begins as. more: of the
    environment.
    """
    started = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, *command],
        cwd=folder, env=_environment() | more, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    _, _, used = os.wait4(process.pid, 0)
    process.returncode = 0  # it was waited for
    size = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)  # bytes
    return Spent(time.perf_counter() - started, used.ru_utime + used.ru_stime, size / 1e6)


def typed(row: Row, folder: Path) -> Spent:
    shutil.rmtree(folder / "compiled", ignore_errors=True)
    more = {"NUMBA_CACHE_DIR": str(folder / "compiled")} if row.first else {}
    return spent("-m", "ropefit", *row.typed.split(), folder=folder, **more)


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def prepare(folder: Path, rows: list[Row]) -> None:
    """Make the runs that the rows need; what numba compiles is compiled here."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    _few_frames(folder / "few")
    todo = ["preprocess few --run few_run", "identify --run few_run"]
    todo += ["preprocess --run sample", "identify --run sample"]
    needed = {run for row in rows for run in re.findall(r"(\w+)_run", row.typed)}
    for run in needed & set(CAUSES):
        from benchmarks.discovery.cases import generate, listed  # a light parent: see spent

        case = next(
            c for c in listed("standard", SEED)
            if c.effects == (CAUSES[run],) and c.simulator == "elastica"
        )  # fmt: skip
        why = generate(case, folder / "made", folder / "truths")
        assert why is None, why
        todo += [f"preprocess made/{case.name} --run {run}_run", f"identify --run {run}_run"]
    for run in needed & set(CLIPS):
        code = JOIN.format(real=str(REAL), count=CLIPS[run], out=str(folder / run))
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=_environment(), check=True)
        todo += [f"preprocess {run} --run {run}_run"]
        todo += [f"identify --run {run}_run"] if CLIPS[run] == 1 else []
    for line in todo:
        subprocess.run(
            [sys.executable, "-m", "ropefit", *line.split(), "--quiet"],
            cwd=folder, env=_environment(), check=True,
        )  # fmt: skip


def _few_frames(folder: Path) -> None:
    """Copy the first frames of the sample of markers."""
    folder.mkdir()
    shutil.copy(SAMPLES / "markers" / "recording.toml", folder)
    for name in ("markers.csv", "ends.csv"):
        with (SAMPLES / "markers" / name).open() as file:
            head, *lines = csv.reader(file)
        kept = [line for line in lines if int(line[head.index("frame")]) < FEW]
        with (folder / name).open("w", newline="") as file:
            csv.writer(file).writerows([head, *kept])


def unit(row: Row, folder: Path) -> float:
    """Return the processor time [s] of what a row is compared with, on one thread."""
    code = PRODUCTS if row.computes else IMPORT
    alone = f"import os; os.environ['OPENBLAS_NUM_THREADS'] = '1'; {code}"
    return min(spent("-c", alone, folder=folder).processor for _ in range(TRIES))


def ratio(row: Row, folder: Path, enough: float = 0.0) -> float:
    """Return the best of three, as a multiple of `unit`; no more tries once it is `enough`."""
    one, best = unit(row, folder), float("inf")
    for _ in range(TRIES):
        best = min(best, typed(row, folder).processor / one)
        if best <= enough:
            break
    return best


def check(folder: Path, rows: list[Row]) -> bool:
    """Print every row's ratio beside the recorded one; whether none is too large."""
    recorded, good = json.loads(RATIOS.read_text()), True
    for row in rows:
        limit = SLOWER * recorded[row.name]
        found = ratio(row, folder, limit)
        good = good and found <= limit
        says = "ok" if found <= limit else f"SLOWER than {SLOWER:g} x"
        print(f"{row.name}: {found:.1f}, recorded {recorded[row.name]:.1f}: {says}", flush=True)
    return good


def table(folder: Path, rows: list[Row], repeats: int) -> tuple[str, dict[str, Any]]:
    """Return the table and its numbers: medians of whole processes."""
    lines, data = [], {}
    for row in rows:
        found = [typed(row, folder) for _ in range(repeats)]
        seconds, processor, memory = (
            statistics.median(getattr(one, name) for one in found)
            for name in ("seconds", "processor", "memory")
        )
        wanted, most = ("" if bar is None else f"{bar:g}" for bar in (row.bar, row.most))
        lines.append(
            f"| {row.name} | `ropefit {row.typed}` | {seconds:.2f} | {processor:.2f} | {wanted} | "
            f"{memory:.0f} | {most} |"
        )
        data[row.name] = {"seconds": seconds, "processor_s": processor, "memory_mb": memory}
        print(lines[-1], file=sys.stderr, flush=True)
    load = os.getloadavg()[0]
    text = (
        f"What a person waits for: whole processes, median of {repeats}, compiled code cached, "
        f"{os.cpu_count()} processors\nof which {load:.1f} were busy at the end (others' work "
        "counts in the time, hardly in the processor time). Written by `python -m "
        "benchmarks.felt`.\n\n"
        "| what | typed | time [s] | processor time [s] | wanted [s] | memory [MB] "
        "| wanted [MB] |\n"
        "|---|---|---|---|---|---|---|\n"
    )
    return text + "\n".join(lines) + "\n", data


def main() -> None:
    """Prepare the runs, then check, record, or print the table."""
    p = parser(__doc__)
    p.add_argument("--repeats", type=int, default=5)
    p.add_argument("--only", default=".*", metavar="PATTERN", help="names of rows")
    p.add_argument("--folder", type=Path, default=ROOT / "build" / "felt")
    p.add_argument("--check", action="store_true", help="fail where a row got slower")
    p.add_argument("--record", action="store_true", help="write felt.json")
    options = p.parse_args()
    quick = options.check or options.record
    rows = [r for r in ROWS if re.search(options.only, r.name) and (r.checked or not quick)]
    if not REAL.is_dir():
        rows = [r for r in rows if not any(f"{run}_run" in r.typed for run in CLIPS)]
    folder = options.folder.absolute()
    prepare(folder, rows)
    if options.check:
        sys.exit(0 if check(folder, rows) else 1)
    if options.record:
        old = json.loads(RATIOS.read_text()) if RATIOS.exists() else {}
        for row in rows:
            old[row.name] = round(ratio(row, folder), 2)
            print(f"{row.name}: {old[row.name]}", flush=True)
        RATIOS.write_text(json.dumps(old, indent=2) + "\n")
        return
    publish(options, "felt", *table(folder, rows, options.repeats))


if __name__ == "__main__":
    main()
