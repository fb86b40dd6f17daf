"""Whatever a file holds, a reader gives a valid result or one of ropefit's own failures."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ropefit.adapters.targets import read_targets
from ropefit.artifacts import Observations, identity, read, write
from ropefit.errors import BadInput
from ropefit.recordings import fingerprint, open_recording
from ropefit.recordings.clouds import read_cloud
from ropefit.stages.simulate import _read_spec
from tests.factories import (
    cloud_recording,
    example,
    image_recording,
    marker_recording,
    resealed,
    rope_points,
    write_manifest,
)

few = settings(max_examples=60, derandomize=True, deadline=None)
SPEC = """format = "ropefit-simulation/1"
name = "spec"
gravity = [0.0, 0.0, -9.81]
[rope]
length = 1.0
diameter = 0.008
mass = 0.05
nodes = 8
[motion]
frames = 4
interval = 0.5
end0 = { path = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], tangents = [[0.0, 0.0, -1.0]] }
end1 = { path = [[0.6, 0.0, 0.0]] }
[model]
solver = "thomas"
eta = { eta_x_G = 0.05 }
steps = 3
iterations = 5
dt = 0.1
[sensor]
kind = "markers"
points = 6
noise = 0.001
occluded = [[0.2, 0.4]]
viewpoint = [0.0, -2.0, 0.0]
"""
TARGETS = "x,y,z,arc_length,target\n0.1,0,-0.2,0.3,0\n0.3,0,-0.3,,0\n0.2,0,-0.1,0.5,1\n"


def open_all(directory: Path) -> None:
    """Read everything that a recording holds; what comes back must be sound."""
    recording = open_recording(directory)
    fingerprint(recording)
    assert recording.frames == sorted(set(recording.frames))
    assert all(np.isfinite(time) for time in recording.source.time.values())
    for end in recording.ends or ():
        assert all(np.isfinite(value).all() for value in end.position.values())
        for quaternion in end.orientation.values():
            assert np.linalg.norm(quaternion) == pytest.approx(1)
    for frame in recording.frames[:2]:
        sight = recording.source.sight(frame)
        if sight.points is not None:
            assert sight.points.shape[1:] == (3,)
            assert not np.isinf(sight.points).any()
        if sight.depth is not None:
            assert np.isfinite(sight.depth).all()


def _npz(directory: Path) -> Path:
    directory.mkdir()
    write_manifest(directory, '[markers]\nfile = "m.npz"', ends="markers = [[0, 1], [-1]]")
    positions = np.stack([rope_points(frame, 4) for frame in range(3)])
    np.savez(directory / "m.npz", positions=positions, time=np.arange(3.0), arc_length=np.arange(4))
    return directory


def _cloud(kind: str) -> Callable[[Path], Path]:
    def make(directory: Path) -> Path:
        import open3d as o3d

        directory.mkdir()
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(rope_points(0, 20)))
        cloud.colors = o3d.utility.Vector3dVector(np.full((20, 3), 0.5))
        packed = {"write_ascii": kind.startswith("ascii"), "compressed": kind.startswith("lzf")}
        assert o3d.io.write_point_cloud(str(directory / kind), cloud, **packed)
        return directory

    return make


def _single(name: str, text: str) -> Callable[[Path], Path]:
    def make(directory: Path) -> Path:
        directory.mkdir()
        (directory / name).write_text(text)
        return directory

    return make


def _artifact(directory: Path) -> Path:
    directory.mkdir()
    write(directory / "observations.h5", example(Observations))
    return directory


def _read_artifact(directory: Path) -> None:
    path = directory / "observations.h5"
    path.write_bytes(resealed(path.read_bytes()))  # else nothing spoiled comes past the seal
    read(path, Observations)
    identity(path)


def _read_one(name: str, reader: Callable[..., Any], *more: Any) -> Callable[[Path], Any]:
    return lambda directory: reader(directory / name, *more)


CLOUDS = ("ascii.ply", "binary.ply", "ascii.pcd", "binary.pcd", "lzf.pcd")
Case = tuple[Callable[[Path], Path], str, Callable[[Path], Any]]
# How to make a valid directory, which of its files is spoiled, how it is read.
CASES: dict[str, Case] = {
    "recording.toml": (cloud_recording, "recording.toml", open_all),
    "recording.toml of images": (image_recording, "recording.toml", open_all),
    "ends.csv": (cloud_recording, "ends.csv", open_all),
    "markers.csv": (marker_recording, "markers.csv", open_all),
    "markers.npz": (_npz, "m.npz", open_all),
    "colour": (image_recording, "color/0.png", open_all),
    "depth": (image_recording, "depth/1.png", open_all),
    "targets": (_single("t.csv", TARGETS), "t.csv", _read_one("t.csv", read_targets, 1.0)),
    "SPEC.toml": (_single("s.toml", SPEC), "s.toml", _read_one("s.toml", _read_spec)),
    "observations.h5": (_artifact, "observations.h5", _read_artifact),
    **{kind: (_cloud(kind), kind, _read_one(kind, read_cloud)) for kind in CLOUDS},
}
TEXTS = [name for name in CASES if name.endswith((".toml", ".csv", "images", "targets"))]


@cache
def valid(name: str) -> tuple[TemporaryDirectory[str], bytes]:
    """A valid directory, made once, and the bytes of the file to spoil."""
    holder = TemporaryDirectory()
    where = CASES[name][0](Path(holder.name) / "r")
    return holder, (where / CASES[name][1]).read_bytes()


def survives(name: str, data: bytes) -> str | None:
    """Read with the file replaced: the failure's text, or None when it was accepted."""
    holder, _ = valid(name)
    where = Path(holder.name) / "r"
    _, file, reader = CASES[name]
    (where / file).write_bytes(data)
    with warnings.catch_warnings(action="error"):
        try:
            reader(where)
        except BadInput as error:
            told = str(error)
        else:
            return None
    assert str(where) in told
    return told


@pytest.mark.parametrize("name", CASES)
def test_unspoiled(name: str) -> None:
    assert survives(name, valid(name)[1]) is None


@pytest.mark.parametrize("name", CASES)
@given(data=st.binary(max_size=300))
@few
def test_arbitrary_bytes(name: str, data: bytes) -> None:
    survives(name, data)
    original = valid(name)[1]
    survives(name, original[: len(original) // 3] + data)


@pytest.mark.parametrize("name", CASES)
@given(data=st.data())
@few
def test_mutated_bytes(name: str, data: st.DataObject) -> None:
    spoiled = bytearray(valid(name)[1])
    # Headers come first: most changes are made there.
    places = st.one_of(st.integers(0, min(400, len(spoiled) - 1)), st.integers(0, len(spoiled) - 1))
    for place in data.draw(st.lists(places, min_size=1, max_size=4)):
        spoiled[place] = data.draw(st.integers(0, 255))
    survives(name, bytes(spoiled[: data.draw(st.one_of(st.none(), places))]))


TOKENS = ["nan", "inf", "-inf", "0", "1e30", "-1", "", "1e400", "x", "9" * 5000, "[" * 3000, '"a"']
TOKENS += ["{frame}", "..", "\0", '"\\u0000"', "\n", ",", "=", "true", "1979-05-27", "99999999"]


@pytest.mark.parametrize("name", [*TEXTS, "ascii.ply", "ascii.pcd", "binary.pcd", "lzf.pcd"])
@given(data=st.data())
@few
def test_mutated_words(name: str, data: st.DataObject) -> None:
    """Words of a text (or of a header) replaced, dropped or doubled."""
    text = valid(name)[1].decode("latin-1")
    words = _split(text)
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(words) - 1))
        words[place] = data.draw(st.sampled_from([*TOKENS, words[place] * 2]))
    survives(name, "".join(words).encode("latin-1"))


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "0", "1e30", "-1"])
@pytest.mark.parametrize("name", [*TEXTS, "ascii.ply", "ascii.pcd"])
def test_every_number_in_turn(name: str, value: str) -> None:
    text = valid(name)[1].decode("latin-1")
    words = _split(text)
    numbers = [at for at, word in enumerate(words) if _is_number(word)]
    assert numbers
    for at in numbers[:40]:
        spoiled = "".join([*words[:at], value, *words[at + 1 :]])
        told = survives(name, spoiled.encode("latin-1"))
        if name in ("ends.csv", "targets") and value in ("inf", "-inf"):
            assert told is not None, words[at]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, 1e30, -1.0])
@pytest.mark.parametrize("name", ["positions", "time", "arc_length"])
def test_every_number_of_an_npz(name: str, value: float, tmp_path: Path) -> None:
    where = _npz(tmp_path / "r")
    arrays = {key: array.astype(float) for key, array in np.load(where / "m.npz").items()}
    arrays[name].flat[1] = value
    np.savez(where / "m.npz", **arrays)
    try:
        open_all(where)
    except BadInput:
        return
    assert np.isfinite(value) or (name == "positions" and np.isnan(value))


def _split(text: str) -> list[str]:
    """Words and what is between them."""
    words, last = [], ""
    for letter in text:
        if (letter in " ,=[]{}\n\r\t") != (last in " ,=[]{}\n\r\t") or not words:
            words.append("")
        words[-1] += letter
        last = letter
    return words


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
