"""The command line on bad input: one line, the right exit code, nothing written."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.factories import (
    cloud_recording,
    edit,
    image_recording,
    marker_recording,
    rope_points,
    write_ends,
    write_manifest,
)

FAILED, USAGE, DATA = 1, 2, 3
Spoil = Callable[[Path], object]
MARKERS = np.stack([rope_points(frame, 9) for frame in range(3)])


def contents(directory: Path) -> dict[str, str]:
    """{path: hash or kind} of everything below a directory."""
    return {
        str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else "directory"
        for path in sorted(directory.rglob("*"))
    }


def in_process(capfd: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """(exit code, stdout, stderr) of the command line, file descriptors included."""
    from ropefit.cli import app

    capfd.readouterr()
    with pytest.raises(SystemExit) as caught:
        app([str(argument) for argument in arguments])
    out, error = capfd.readouterr()
    return int(caught.value.code or 0), out, error


def in_a_process(*arguments: str | Path) -> tuple[int, str, str]:
    """The same through a process of its own."""
    command = [sys.executable, "-m", "ropefit", *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return result.returncode, result.stdout, result.stderr


def one_line(result: tuple[int, str, str], code: int, *words: str) -> None:
    """Exit code, an empty standard output, and one line on standard error that says `words`."""
    found, out, error = result
    assert error.startswith("ropefit: "), error
    assert error.count("\n") == 1, error
    assert error.endswith("\n")
    assert "bug" not in error
    assert (found, out) == (code, ""), error
    for word in words:
        assert word in error


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with observations and a model, made once; tests copy it."""
    from ropefit.cli import app

    base = tmp_path_factory.mktemp("made")
    marker_recording(base / "recording", frames=4)
    run = ["--run", str(base / "run"), "--quiet"]
    fast = ["--solver", "thomas", "--steps", "2", "--iterations", "2", "--evaluations", "1"]
    for command in (
        ["preprocess", str(base / "recording"), "--nodes", "6", *run],
        ["identify", *fast, *run],
    ):
        with pytest.raises(SystemExit) as caught:
            app(command)
        assert not caught.value.code
    return base


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a copy of the run and of its recording."""
    shutil.copytree(made, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def _line(name: str, number: int, text: str) -> Spoil:
    def change(where: Path) -> None:
        lines = (where / name).read_text().splitlines()
        lines[number] = text
        (where / name).write_text("\n".join(lines) + "\n")

    return change


def _toml(old: str, new: str) -> Spoil:
    return lambda where: edit(where / "recording.toml", old, new)


def _held(markers: str) -> Spoil:
    return _toml('file = "ends.csv"', f"markers = {markers}")


def _write(name: str, text: str) -> Spoil:
    return lambda where: (where / name).write_text(text)


def _npz(**arrays: np.ndarray) -> Spoil:
    def change(where: Path) -> None:
        write_manifest(where, '[markers]\nfile = "m.npz"')
        sound = {"positions": np.zeros((3, 4, 3)), "time": np.arange(3.0)}
        np.savez(where / "m.npz", **{**sound, **arrays})

    return change


def _link(name: str) -> Spoil:
    def change(where: Path) -> None:
        outside = where.parent / "outside"
        shutil.move(where / name, outside)
        (where / name).symlink_to(outside)

    return change


def _millimetres(rope: str, ends: bool) -> Spoil:
    def change(where: Path) -> None:
        shutil.rmtree(where)
        cloud_recording(where, rope=rope, scale=1000.0)
        if not ends:
            edit(where / "recording.toml", '[ends]\nfile = "ends.csv"\n', "")

    return change


def _mixed(rope: str) -> Spoil:
    """Points in millimetres, ends in metres."""

    def change(where: Path) -> None:
        _millimetres(rope, True)(where)
        write_ends(where)

    return change


def _other_suffix(where: Path) -> None:
    shutil.move(where / "clouds/000.ply", where / "clouds/000.txt")
    edit(where / "recording.toml", "{frame:03d}.ply", "{frame:03d}.txt")


def _damaged_image(where: Path) -> None:
    data = bytearray((where / "color/0.png").read_bytes())
    data[len(data) // 2] ^= 255
    (where / "color/0.png").write_bytes(data)


Make = Callable[[Path], Path]
RECORDINGS: dict[str, tuple[Make, Spoil, tuple[str, ...]]] = {
    "none": (cloud_recording, shutil.rmtree, ("no such recording", "recording.toml")),
    "no toml": (cloud_recording, lambda w: (w / "recording.toml").unlink(), ("recording.toml",)),
    "no ends": (cloud_recording, lambda w: (w / "ends.csv").unlink(), ("ends.csv", "no such")),
    "no markers": (marker_recording, lambda w: (w / "markers.csv").unlink(), ("markers.csv",)),
    "no clouds": (cloud_recording, lambda w: shutil.rmtree(w / "clouds"), ("clouds.pattern",)),
    "no depth": (image_recording, lambda w: (w / "depth/1.png").unlink(), ("frame 1", "depth")),
    "ends of other frames": (
        cloud_recording,
        _write("ends.csv", "frame,time,end,x,y,z\n77,0,0,0,0,0\n"),
        ("end 0", "0..2"),
    ),
    "unknown key": (cloud_recording, _toml("[rope]", "[rope]\nlenght = 1"), ("rope.lenght",)),
    "wrong format": (cloud_recording, _toml("recording/1", "recording/9"), ("recording/9",)),
    "not toml": (cloud_recording, _toml("[rope]", "[rope"), ("recording.toml", "TOML")),
    "nan in ends": (cloud_recording, _line("ends.csv", 2, "0,0,1,nan,0,0"), ("ends.csv", "row 3")),
    "text in ends": (cloud_recording, _line("ends.csv", 2, "0,0,1,a,0,0"), ("line 3", "'a'")),
    "third end": (cloud_recording, _line("ends.csv", 2, "0,0,2,0,0,0"), ("ends.csv", "0 (control")),
    "two rows": (cloud_recording, _line("ends.csv", 2, "0,0,0,0,0,0"), ("two rows",)),
    "shape": (marker_recording, _npz(positions=np.zeros((3, 4))), ("m.npz", "(3, 4)")),
    "shape of time": (marker_recording, _npz(time=np.zeros(2)), ("m.npz", "time")),
    "one marker": (marker_recording, _npz(positions=np.zeros((3, 1, 3))), ("m.npz", "at least 2")),
    "pickle": (marker_recording, _npz(time=np.array([{}] * 3)), ("m.npz", "pickle")),
    "ends too far apart": (
        cloud_recording,
        _line("ends.csv", 2, "0,0,1,7,0,0"),
        ("frame 0", "7 m apart", "1 m long"),
    ),
    "length 0": (cloud_recording, _toml("length = 1.0", "length = 0"), ("rope.length",)),
    "length -1": (cloud_recording, _toml("length = 1.0", "length = -1"), ("rope.length",)),
    "length nan": (cloud_recording, _toml("length = 1.0", "length = nan"), ("rope.length",)),
    "length in mm": (cloud_recording, _toml("= 1.0", "= 1000"), ("rope.length", "millimetres")),
    "diameter in mm": (cloud_recording, _toml("= 1.0", "= 1\ndiameter = 8"), ("millimetres",)),
    "points in mm": (cloud_recording, _millimetres("", True), ("metres",)),
    "points in mm, no ends": (cloud_recording, _millimetres("", False), ("metres",)),
    "points in mm, length": (cloud_recording, _millimetres("length = 1", True), ("metres",)),
    "clouds in mm": (cloud_recording, _mixed("length = 1"), ("000.ply", "1 m long", "metres")),
    "clouds in mm, no length": (cloud_recording, _mixed(""), ("000.ply", "metres")),
    "markers in mm": (marker_recording, _npz(positions=1e3 * MARKERS), ("m.npz", "in metres")),
    "parent": (cloud_recording, _toml('"ends.csv"', '"../ends.csv"'), ("lies outside",)),
    "absolute": (cloud_recording, _toml('"ends.csv"', '"/etc/passwd"'), ("lies outside",)),
    "parent pattern": (cloud_recording, _toml('"clouds/', '"../r/../clouds/'), ("lies outside",)),
    "link": (cloud_recording, _link("ends.csv"), ("lies outside",)),
    "linked folder": (cloud_recording, _link("clouds"), ("lies outside",)),
    "linked frame": (cloud_recording, _link("clouds/001.ply"), ("lies outside",)),
    "other kind of cloud": (cloud_recording, _other_suffix, (".ply or .pcd",)),
    "folder as file": (cloud_recording, _toml('"ends.csv"', '"clouds"'), ("not readable",)),
    "folder as frame": (cloud_recording, lambda w: (w / "clouds/003.ply").mkdir(), ("003.ply",)),
    "not a cloud": (
        cloud_recording,
        lambda w: (w / "clouds/001.ply").write_text("x"),
        ("001.ply",),
    ),
    "damaged image": (image_recording, _damaged_image, ("color/0.png",)),
    "depth scale": (image_recording, _toml("= 0.001", "= 1000"), ("rgbd.depth_scale", "1000 m")),
    "other size": (image_recording, _toml("width = 24", "width = 25"), ("24x16", "25x16")),
    "both ends free": (
        marker_recording,
        _toml('file = "ends.csv"', "markers = [[], []]"),
        ("free",),
    ),
    "inner marker": (marker_recording, _held("[[3], []]"), ("[3]",)),
}


@pytest.mark.parametrize("as_json", [False, True], ids=["text", "json"])
@pytest.mark.parametrize("case", RECORDINGS)
def test_recording(here: Path, case: str, as_json: bool, capfd: pytest.CaptureFixture[str]) -> None:
    make, spoil, words = RECORDINGS[case]
    spoil(make(here / "r"))
    before = contents(here.parent)
    flags = ["--json"] if as_json else []
    for run in ("run", "new"):  # an existing run stays as it is; a new one is not begun
        replaces = ["--force"] if run == "run" else []  # it holds another recording
        result = in_process(capfd, "preprocess", "r", "--run", run, *flags, *replaces)
        one_line(result, DATA, *words)
        assert contents(here.parent) == before


def test_frame_without_an_end_is_dropped_and_told(
    here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    import json

    write_ends(cloud_recording(here / "r"), frames=2)
    code, out, _ = in_process(capfd, "preprocess", "r", "--run", "new", "--json")
    assert code == 0
    assert json.loads(out)["dropped"] == [{"frame": 2, "reason": "end 0 has no pose"}]
