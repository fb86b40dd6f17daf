"""The command line on bad runs and wrong usage: one line, the right exit code, nothing written."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import pytest

from tests.factories import edit
from tests.test_bad_input import (
    DATA,
    FAILED,
    USAGE,
    Spoil,
    contents,
    here,
    in_a_process,
    in_process,
    made,
    one_line,
)

__all__ = ["here", "made"]  # fixtures


def _truncate(where: Path) -> None:
    data = (where / "observations.h5").read_bytes()
    (where / "observations.h5").write_bytes(data[: len(data) // 2])


def _other_version(where: Path) -> None:
    with h5py.File(where / "observations.h5", "r+") as file:
        file.attrs["schema_version"] = 99


def _strangers(where: Path) -> None:
    for path in where.iterdir():
        path.unlink()
    (where / "thesis.txt").write_text("all of it")


def _file(where: Path) -> None:
    for path in where.iterdir():
        path.unlink()
    where.rmdir()
    where.write_text("a file")


def _nothing(where: Path) -> None:
    pass


def _without(name: str) -> Spoil:
    return lambda where: (where / name).unlink()


def _stale(where: Path) -> None:
    """The recording changed and was preprocessed again (--force: both are copies)."""
    from ropefit.cli import app

    edit(where.parent / "recording" / "markers.csv", "0,0.0,1,", "0,0.0,1,0")
    recording = str(where.parent / "recording")
    with pytest.raises(SystemExit):
        app(["preprocess", recording, "--run", str(where), "--quiet", "--force"])


RUNS: dict[str, tuple[Spoil, list[str], int, tuple[str, ...]]] = {
    "truncated": (_truncate, ["identify"], DATA, ("observations.h5", "make it anew")),
    "version": (_other_version, ["identify"], DATA, ("version 99", "observations.h5")),
    "version, report": (_other_version, ["report"], DATA, ("version 99",)),
    "other files": (_strangers, ["preprocess", "recording"], USAGE, ("thesis.txt",)),
    "other files, identify": (_strangers, ["identify"], FAILED, ("not a ropefit run",)),
    "a file": (_file, ["preprocess", "recording"], USAGE, ("is a file",)),
    "a file, identify": (_file, ["identify"], USAGE, ("is a file",)),
    "no observations": (
        _without("observations.h5"),
        ["identify"],
        FAILED,
        ("observations.h5", "ropefit preprocess RECORDING"),
    ),
    "no model": (_without("model.h5"), ["control"], FAILED, ("`ropefit identify --run run`",)),
    "stale": (_stale, ["control"], FAILED, ("stale", "`ropefit identify --run run`")),
    "stale, report": (_stale, ["report"], FAILED, ("stale", "`ropefit identify --run run`")),
    "inspect nothing": (_without("model.h5"), ["inspect", "run/model.h5"], DATA, ("no such",)),
}
THOMAS = ["identify", "--solver", "thomas"]
USAGES: dict[str, tuple[list[str], tuple[str, ...]]] = {
    "unknown parameter": ([*THOMAS, "--free", "eta_x"], ("eta_x", "eta_x_G")),
    "unknown rigidity": (["identify", "--free", "eta_x_G"], ("eta_x_G", "EI")),
    "unknown rigidity, searched": (
        ["identify", "--search", "gradient", "--free", "EJ"],
        ("EJ", "EI"),
    ),
    "unknown start": ([*THOMAS, "--start", "eta=1"], ("eta",)),
    "start out of bounds": ([*THOMAS, "--start", "eta_x_G=1e9"], ("bounds",)),
    "rigidity out of bounds": (["identify", "--start", "EI=1e9"], ("EI", "bounds")),
    "start no number": (["identify", "--start", "eta_x_G"], ("NAME=VALUE",)),
    "start nan": ([*THOMAS, "--start", "eta_x_G=nan"], ("eta_x_G",)),
    "rigidity nan": (["identify", "--start", "EI=nan"], ("EI", "bounds")),
    "inner control point": (["identify", "--control-at", "0.5"], ("--control-at", "thomas")),
    "least squares of weights": ([*THOMAS, "--search", "least-squares"], ("equilibrium",)),
    "weights from a run": ([*THOMAS, "--from", "run"], ("--from", "equilibrium")),
    "from weights": (["identify", "--from", "run"], ("--from run", "thomas", "equilibrium")),
    "device, least squares": (["identify", "--device", "cuda"], ("--device", "--search grid")),
    "device, weights": ([*THOMAS, "--device", "cuda"], ("--device", "--solver equilibrium")),
    "groups": (["identify", "--groups", "nonsense"], ("nonsense", "tension")),
    "groups without frames": (["identify", "--groups", "0-1,70-80"], ("70-80",)),
    "groups that overlap": (["identify", "--groups", "0-2,1-3"], ("overlaps",)),
    "two sides": ([*THOMAS, "--two-sided"], ("--control-at",)),
    "two sides in equilibrium": (["identify", "--two-sided"], ("--two-sided", "paper")),
    "steps": (["identify", "--steps", "0"], ("--steps",)),
    "holdout": (["identify", "--holdout", "1.5"], ("--holdout",)),
    "dt": (["identify", "--dt", "nan"], ("--dt",)),
    "nodes": (["preprocess", "recording", "--nodes", "1"], ("--nodes",)),
    "points": (["preprocess", "recording", "--most-points", "0"], ("--most-points",)),
    "evaluations": (["control", "--evaluations", "0"], ("--evaluations",)),
}


@pytest.mark.parametrize("as_json", [False, True], ids=["text", "json"])
@pytest.mark.parametrize("case", RUNS)
def test_run(here: Path, case: str, as_json: bool, capfd: pytest.CaptureFixture[str]) -> None:
    spoil, command, code, words = RUNS[case]
    spoil(here / "run")
    before = contents(here.parent)
    where = [] if command[0] == "inspect" else ["--run", "run"]
    result = in_process(capfd, *command, *where, *(["--json"] if as_json else []))
    one_line(result, code, *words)
    assert contents(here.parent) == before


@pytest.mark.parametrize("case", USAGES)
def test_wrong_usage(here: Path, case: str, capfd: pytest.CaptureFixture[str]) -> None:
    command, words = USAGES[case]
    before = contents(here.parent)
    one_line(in_process(capfd, *command), USAGE, *words)
    assert contents(here.parent) == before


def test_another_recording_is_refused(here: Path) -> None:
    """A run keeps its recording: files may change or move, another one needs --force."""
    shutil.copytree(here / "recording", here / "elsewhere")
    before = contents(here / "run")
    assert in_a_process("preprocess", "elsewhere", "--nodes", "6")[0] == 0  # the same, moved
    edit(here / "elsewhere" / "markers.csv", "0,0.0,1,", "0,0.0,1,0")
    edit(here / "elsewhere" / "recording.toml", '"tiny"', '"other"')
    for command in ("preprocess", "run"):
        result = in_a_process(command, "elsewhere")
        one_line(result, USAGE, "tiny", "recording", "other", "elsewhere", "--force", "--run")
        pictures = in_a_process(command, "elsewhere", "--debug-images", "pictures")
        one_line(pictures, USAGE, "--force")
        assert contents(here / "run") == before
    assert in_a_process("preprocess", "elsewhere", "--force", "--quiet")[0] == 0
    edit(here / "elsewhere" / "ends.csv", "0.7", "0.7001")
    assert in_a_process("preprocess", "elsewhere", "--quiet") == (0, "", "")  # changed: the same
    one_line(in_a_process("preprocess", "recording"), USAGE, "other", "tiny")


def test_no_such_device(
    here: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    result = in_process(capfd, "identify", "--search", "grid", "--device", "cuda")
    one_line(result, USAGE, "--device cuda", "--device cpu")


@pytest.mark.parametrize(
    "command",
    [
        ["identify", "--loss", "OBJ77"],
        ["identify", "--solver", "none"],
        ["identify", "--steps", "many"],
        ["preprocess", "--no-such-option"],
        ["simulate", "spec.toml"],
        ["nonsense"],
    ],
    ids=" ".join,
)
def test_usage_that_the_parser_refuses(
    here: Path, command: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    before = contents(here.parent)
    code, out, error = in_process(capfd, *command)
    assert (code, out) == (USAGE, "")
    assert any(word in error for word in (command[-1], command[-2:][0], "--out"))
    assert "Traceback" not in error
    assert contents(here.parent) == before


TARGETS = {
    "none": (None, "no such file"),
    "header": ("a,b\n1,2\n", "header"),
    "nan": ("x,y,z\n0,nan,0\n", "column y"),
    "beyond the rope": ("x,y,z,arc_length\n0,0,0,9\n", "arc_length"),
}


@pytest.mark.parametrize("case", TARGETS)
def test_targets(here: Path, case: str, capfd: pytest.CaptureFixture[str]) -> None:
    text, word = TARGETS[case]
    if text is not None:
        (here / "t.csv").write_text(text)
    before = contents(here.parent)
    one_line(in_process(capfd, "control", "--target", "t.csv"), DATA, "t.csv", word)
    assert contents(here.parent) == before


SPEC = 'format = "ropefit-simulation/1"\nname = "s"\n[rope]\nlength = 1\n[motion]\nframes = 2\n'
SPECS = {
    "none": (None, DATA, "no such file"),
    "no motion": (SPEC, DATA, "motion"),
    "unknown key": (f"{SPEC}speed = 1\nend0 = {{ path = [[0, 0, 0]] }}\n", DATA, "motion.speed"),
    "nan": (f"{SPEC}end0 = {{ path = [[0, nan, 0]] }}\n", DATA, "motion.end0.path"),
    "too far": (
        f"{SPEC}end0 = {{ path = [[0, 0, 0]] }}\nend1 = {{ path = [[2, 0, 0]] }}\n",
        DATA,
        "2 m apart",
    ),
}


@pytest.mark.parametrize("case", SPECS)
def test_simulate(here: Path, case: str, capfd: pytest.CaptureFixture[str]) -> None:
    text, code, word = SPECS[case]
    if text is not None:
        (here / "s.toml").write_text(text)
    before = contents(here.parent)
    one_line(in_process(capfd, "simulate", "s.toml", "--out", "out"), code, "s.toml", word)
    assert contents(here.parent) == before


def test_simulated_recording_can_be_read(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Names that TOML writes otherwise than JSON come back as they were."""
    from ropefit.recordings import open_recording

    text = SPEC.replace('"s"', '"a\\u007f\U0001f600 \\" \\\\ \\n"')
    text += "end0 = { path = [[0, 0, 0]] }\n[sensor]\npoints = 30\n[model]\nsteps = 1\n"
    (here / "s.toml").write_text(text, encoding="utf-8")
    code, out, _ = in_process(capfd, "simulate", "s.toml", "--out", "new/out", "--json")
    assert code == 0
    assert json.loads(out)["frames"] == 2
    assert open_recording(here / "new/out").name == 'a\x7f\U0001f600 " \\ \n'


def test_inspect_says_why_not(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    _truncate(here / "run")
    before = contents(here.parent)
    code, out, error = in_process(capfd, "inspect", "run", "--json")
    assert code in (FAILED, DATA)
    broken, stale = json.loads(out)["artifacts"]
    assert (broken["valid"], stale["valid"]) == (False, False)
    assert "observations.h5" in broken["problem"]
    assert error == f"ropefit: {broken['problem']}\n"
    assert contents(here.parent) == before


def test_simulate_does_not_write_over_anything(
    here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (here / "s.toml").write_text(f"{SPEC}end0 = {{ path = [[0, 0, 0]] }}\n")
    before = contents(here.parent)
    for out in ("recording", "s.toml", "s.toml/below"):
        one_line(in_process(capfd, "simulate", "s.toml", "--out", out), FAILED, out)
        assert contents(here.parent) == before


PROCESSES: dict[str, tuple[Spoil, list[str], int]] = {
    "no recording": (_nothing, ["preprocess", "none", "--json"], DATA),
    "no run": (_nothing, ["identify", "--run", "none"], FAILED),
    "truncated": (_truncate, ["identify", "--json"], DATA),
    "stale": (_stale, ["control"], FAILED),
    "groups": (_nothing, ["identify", "--groups", "nonsense", "--json"], USAGE),
    "nodes": (_nothing, ["preprocess", "recording", "--nodes", "1"], USAGE),
    "other files": (_strangers, ["run", "recording"], USAGE),
    "no spec": (_nothing, ["simulate", "none.toml", "--out", "out"], DATA),
    "inspect": (_nothing, ["inspect", "none", "--json"], DATA),
}


@pytest.mark.parametrize("case", PROCESSES)
def test_in_a_process_of_its_own(here: Path, case: str) -> None:
    spoil, command, code = PROCESSES[case]
    spoil(here / "run")
    before = contents(here.parent)
    one_line(in_a_process(*command), code)
    assert contents(here.parent) == before
