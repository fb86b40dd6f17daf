"""What a person sees on a terminal: 80 columns, no colour, completion, the answer, compilation."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ropefit.artifacts import write
from ropefit.cli.console import Session
from ropefit.cli.run import show_answer
from tests.conftest import ROOT
from tests.report_runs import observations

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def on_a_terminal(arguments: list[str], cwd, **more: str) -> str:
    """All that a command shows on a terminal of 80 columns."""
    main, side = pty.openpty()
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    env = {**os.environ, "PYTHONPATH": path, "COLUMNS": "80", "TERM": "xterm", **more}
    process = subprocess.Popen(
        [sys.executable, "-m", "ropefit", *arguments],
        cwd=cwd, env=env, stdin=side, stdout=side, stderr=side, close_fds=True,
    )  # fmt: skip
    os.close(side)
    shown = b""
    while True:
        try:
            part = os.read(main, 65536)
        except OSError:  # the other side is closed
            break
        if not part:
            break
        shown += part
    process.wait(timeout=60)
    os.close(main)
    return shown.decode()


@pytest.fixture
def run(tmp_path):
    """A run with observations only."""
    (tmp_path / "run").mkdir()
    write(tmp_path / "run" / "observations.h5", observations())
    return tmp_path


def test_eighty_columns_without_colour(run):
    lost = ["report", "--run", "no-run-of-this-name"]
    for command in (["inspect", "run"], ["report"], lost, ["--help"]):
        shown = on_a_terminal(command, run, NO_COLOR="1")
        assert shown.strip()
        assert not re.search(r"\x1b\[[0-9;]*3[0-7]m", shown), command
        for line in ESCAPE.sub("", shown).splitlines():
            assert len(line) <= 80, line
    # Words are not torn.
    failed = " ".join(ESCAPE.sub("", on_a_terminal(lost, run)).split())
    assert "run `ropefit preprocess RECORDING --run no-run-of-this-name`" in failed


def test_completion_of_commands_options_and_values(tmp_path):
    def completed(words: str) -> list[str]:
        env = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "_ROPEFIT_COMPLETE": "complete_bash",
            "COMP_WORDS": words,
            "COMP_CWORD": str(len(words.split(" ")) - 1),
        }
        code = "import sys; sys.argv = ['ropefit']; from ropefit.cli import main; main()"
        done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
        return done.stdout.split()

    assert completed("ropefit ide") == ["identify"]
    assert "--holdout" in completed("ropefit identify --ho")
    assert completed("ropefit export --to muj") == ["mujoco", "mujoco3"]


def test_formats_and_targets_offered_are_those_there_are():
    from ropefit.cli import options
    from ropefit.exporters import exporters
    from ropefit.importers import importers

    ours = {name for name, kind in importers().items() if kind.__module__.startswith("ropefit.")}
    assert set(options.FORMATS) == ours
    own = {name for name, kind in exporters().items() if kind.__module__.startswith("ropefit.")}
    assert set(options.TARGETS) == own


def test_the_answer_is_told_on_standard_output(run, capsys):
    sentences = show_answer(Session(), run / "run")
    out = capsys.readouterr().out
    assert len(sentences) == 2
    for sentence in sentences:
        assert sentence in out
    show_answer(Session(quiet=True), run / "run")
    show_answer(Session(json=True), run / "run")
    silent = capsys.readouterr()
    assert silent.out == silent.err == ""


def test_compilation_is_said_once_and_only_when_it_happens():
    import numba

    from ropefit.solvers.compiling import COMPILING, telling

    said: list[str] = []
    functions = [numba.njit(lambda x: x + 1), numba.njit(lambda x: x * 2)]
    with telling(said.append):
        assert [f(np.float64(3.0)) for f in functions] == [4.0, 6.0]
    assert said == [COMPILING]
    with telling(said.append):
        functions[0](np.float64(4.0))
    assert len(said) == 1


LOOPS = """
import sys
import numba, numpy as np
from ropefit.solvers.compiling import telling

@numba.njit(cache=True)
def one(x):
    return x + 1

@numba.njit
def double(x):
    return x * 2

@numba.njit(cache=True)
def two(x):
    return double(x)

for name in sys.argv[1:]:
    with telling(print):
        globals()[name](np.float64(3.0))
"""


def test_compilation_is_said_once_a_machine(tmp_path):
    """Not again by a later stage, nor by a later process that compiles other loops."""
    from ropefit.solvers.compiling import COMPILING

    (tmp_path / "loops.py").write_text(LOOPS)
    env = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def said(*names: str) -> list[str]:
        command = [sys.executable, str(tmp_path / "loops.py"), *names]
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
        return done.stdout.splitlines()

    assert said("one", "one") == [COMPILING]
    assert said("one", "two") == []
    assert list(tmp_path.glob("cache/*/*.nbc"))


LATE = """
import sys
from ropefit.solvers.compiling import telling

assert "numba" not in sys.modules
with telling(print):
    import numpy as np
    from ropefit.solvers.equilibrium.kernels.entries import source_key  # imports numba
    import numba
    numba.njit(lambda x: x + 1)(np.float64(3.0))
"""


def test_compilation_is_said_where_numba_is_imported_later():
    from ropefit.solvers.compiling import COMPILING

    done = subprocess.run(
        [sys.executable, "-c", LATE], env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.splitlines() == [COMPILING]


def test_solvers_in_all_folders_share_one_mark():
    """Each solver has its own folder of compiled code; the first of any says it for all."""
    from ropefit.solvers.compiling import PACKAGE, folder_beside

    folders = ("solvers/equilibrium/kernels", "solvers/xpbd/kernels", "inference")
    kept = {folder_beside(PACKAGE / folder / "__pycache__") for folder in folders}
    assert kept == {PACKAGE / "__pycache__"}
    assert folder_beside(Path("cache") / "kernels_1") == folder_beside(
        Path("cache") / "inference_2"
    )


def test_a_viewer_that_is_missing_is_one_line(run, monkeypatch):
    """Modules that cannot be imported stand for extras that are not installed."""
    blocked = run / "blocked"
    blocked.mkdir()
    for name in ("rerun", "viser", "matplotlib"):
        (blocked / f"{name}.py").write_text("raise ImportError('not here')")
    path = os.pathsep.join([str(blocked), str(ROOT)])
    for arguments, extra in (
        (["view"], "rerun"), (["view", "--serve"], "viser"), (["report", "--svg"], "figures"),
    ):  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-m", "ropefit", *arguments],
            cwd=run, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 1
        last = done.stderr.strip().splitlines()[-1]
        assert f"pip install 'ropefit[{extra}]'" in last
        assert "Traceback" not in done.stderr


def test_rerun_and_viser_show_every_frame(run):
    rerun = pytest.importorskip("rerun")
    viser = pytest.importorskip("viser")
    import threading

    from ropefit.adapters.contents import read_run
    from ropefit.viewing.rerun import write_rerun
    from ropefit.viewing.viser import serve_run

    contents = read_run(run / "run")
    path = write_rerun(contents, run / "new" / "v.rrd")
    assert path.read_bytes()[:3] == b"RRF"
    assert path.stat().st_size > 3000
    assert rerun
    assert not list(path.parent.glob(".*"))
    stop, said = threading.Event(), []

    def told(text: str) -> None:
        said.append(text)
        stop.set()

    serve_run(contents, 0, told, stop)
    assert re.match(r"view: http://127\.0\.0\.1:\d+", said[0])
    assert viser
