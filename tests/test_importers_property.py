"""Whatever a damaged source holds, an import gives a recording or one of ropefit's own failures."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ropefit.errors import RopefitError
from ropefit.importers import About
from ropefit.recordings import open_recording
from ropefit.stages.importing import import_recording, list_source
from tests import sources
from tests.test_mocap_exports import motive, qualisys

ROS = {"clouds": "/points", "frame": "world", "end0": "tf:gripper", "end1": "/far", "axis1": "+x"}
IMAGES = {"color": "/color", "depth": "/depth", "info": "/info", "frame": "world"}
TUM = {"intrinsics": "200,200,80,60"}
LEROBOT = {"frames": "4", "fov": "60", "end0": "observation.state:1,2,3"}
Case = tuple[Callable[[Path], Path], str, str, dict[str, str]]


def _in(name: str, make: Callable[[Path], Path]) -> Callable[[Path], Path]:
    return lambda directory: make(directory / name)


def lerobot(folder: Path) -> Path:
    from tests.test_lerobot import written  # skips where its libraries are missing

    return written(folder, 3)


# How to make a source, its format, which of its files is spoiled (glob), the options.
CASES: dict[str, Case] = {
    "ros1": (_in("b.bag", lambda p: sources.bag(p, 1)), "ros", "b.bag", ROS),
    "ros1 images": (_in("b.bag", lambda p: sources.bag(p, 1)), "ros", "b.bag", IMAGES),
    "ros2 sqlite3": (_in("b", lambda p: sources.bag(p, 2)), "ros", "b/*.db3", ROS),
    "ros2 metadata": (_in("b", lambda p: sources.bag(p, 2)), "ros", "b/metadata.yaml", ROS),
    "ros2 mcap": (_in("b", lambda p: sources.bag(p, 2, "mcap")), "ros", "b/*.mcap", ROS),
    "tum list": (_in("t", sources.tum), "tum", "t/rgb.txt", TUM),
    "tum poses": (_in("t", sources.tum), "tum", "t/groundtruth.txt", TUM),
    "tum depth": (_in("t", sources.tum), "tum", "t/depth/*1*.png", TUM),
    "c3d": (_in("a.c3d", sources.c3d), "c3d", "a.c3d", {}),
    "csv": (_in("a.csv", sources.wide_csv), "mocap", "a.csv", {}),
    "motive": (_in("t.csv", motive), "mocap", "t.csv", {}),
    "qualisys": (_in("t.tsv", lambda p: qualisys(p, True)), "mocap", "t.tsv", {}),
    "lerobot info": (_in("l", lerobot), "lerobot", "l/meta/info.json", LEROBOT),
    "lerobot episodes": (_in("l", lerobot), "lerobot", "l/meta/episodes/*/*.parquet", LEROBOT),
    "lerobot table": (_in("l", lerobot), "lerobot", "l/data/*/*.parquet", LEROBOT),
    "lerobot film": (_in("l", lerobot), "lerobot", "l/videos/*/*/*.mp4", LEROBOT),
    "clouds": (_in("c", sources.cloud_folder), "clouds", "c/scan_9.ply", {}),
}
SLOW = ("c3d", "ros2 metadata", "lerobot film")  # a process each; YAML in pure Python; films


def few(name: str) -> settings:
    return settings(max_examples=8 if name in SLOW else 40, derandomize=True, deadline=None)


@cache
def valid(name: str) -> tuple[TemporaryDirectory[str], Path, Path, bytes]:
    """A valid source, made once; the file to spoil and what it holds."""
    holder = TemporaryDirectory()
    make, _, pattern, _ = CASES[name]
    source = make(Path(holder.name))
    spoiled = sorted(Path(holder.name).glob(pattern))[0]
    return holder, source, spoiled, spoiled.read_bytes()


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A damaged C3D file may keep its reader busy for ever."""
    monkeypatch.setattr("ropefit.importers.c3d.PATIENCE", 4.0)


def survives(name: str, data: bytes) -> str | None:
    """Import with the file replaced: the failure's text, or None when it was accepted."""
    holder, source, spoiled, _ = valid(name)
    _, format, _, options = CASES[name]
    out = Path(holder.name) / "out"
    shutil.rmtree(out, ignore_errors=True)
    spoiled.write_bytes(data)
    told = None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", ResourceWarning)
        try:
            import_recording(source, format, out, options, About("damaged"))
        except RopefitError as error:
            told = str(error)
        with suppress(RopefitError):
            list_source(source, format)
    left = sorted(path.name for path in Path(holder.name).iterdir())
    if told is None:
        recording = open_recording(out)
        for frame in recording.frames:
            recording.source.sight(frame)
    else:
        assert "out" not in left
        assert len(told) < 3000
    assert not [item for item in left if item.startswith(".")]
    return told


@pytest.mark.parametrize("name", CASES)
def test_unspoiled(name: str) -> None:
    assert survives(name, valid(name)[3]) is None


@pytest.mark.parametrize("name", CASES)
def test_arbitrary_bytes(name: str) -> None:
    @few(name)
    @given(data=st.binary(max_size=300), keep=st.sampled_from([0, 3, 2]))
    def check(data: bytes, keep: int) -> None:
        original = valid(name)[3]
        survives(name, (original[: len(original) // keep] if keep else b"") + data)

    check()


@pytest.mark.parametrize("name", CASES)
def test_mutated_bytes(name: str) -> None:
    original = valid(name)[3]

    @few(name)
    @given(data=st.data())
    def check(data: st.DataObject) -> None:
        spoiled = bytearray(original)
        last = len(spoiled) - 1
        # Headers come first and indices last: most changes are made there.
        places = st.one_of(
            st.integers(0, min(600, last)),
            st.integers(0, last),
            st.integers(max(0, last - 400), last),
        )
        for place in data.draw(st.lists(places, min_size=1, max_size=6)):
            spoiled[place] = data.draw(st.integers(0, 255))
        survives(name, bytes(spoiled))

    check()


@pytest.mark.parametrize(
    "name", ["tum list", "tum poses", "csv", "motive", "lerobot info", "ros2 metadata"]
)
def test_mutated_words(name: str) -> None:
    tokens = ["nan", "inf", "-1e400", "", "..", "\0", "9" * 400, "[" * 2000, "x", "/", "\n", ","]

    @few(name)
    @given(data=st.data())
    def check(data: st.DataObject) -> None:
        words = valid(name)[3].decode().replace(",", " , ").replace("\n", " \n ").split(" ")
        for _ in range(data.draw(st.integers(1, 3))):
            words[data.draw(st.integers(0, len(words) - 1))] = data.draw(st.sampled_from(tokens))
        survives(name, " ".join(words).replace(" , ", ",").replace(" \n ", "\n").encode())

    check()
