"""LeRobot data sets as versions 2 and 3 lay them out, written by PyArrow and PyAV."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ropefit.errors import BadInput, WrongUsage
from ropefit.importers.lerobot import Lerobot
from tests.test_importers import brought

av = pytest.importorskip("av")
pa = pytest.importorskip("pyarrow")

RATE, POSES, STILL, ON_THE_WAY = 10, 4, 5, 2
EACH = STILL + ON_THE_WAY
COUNT = POSES * EACH  # frames of an episode
CAMERA = "observation.images.front"
WAYS = {
    2: "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    3: "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
}
TABLES = {
    2: "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
    3: "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
}


def image(episode: int, frame: int) -> np.ndarray:
    """A bright bar that stays for STILL frames and then goes on."""
    pose, since = divmod(frame, EACH)
    at = 10 + 20 * pose + 20 * max(since - STILL + 1, 0) // (ON_THE_WAY + 1)
    picture = np.full((64, 96, 3), 40 + 60 * episode, dtype=np.uint8)
    picture[10:50, at : at + 6] = 250
    return picture


def state(episode: int, frame: int) -> list[float]:
    """A joint, then the hand's place."""
    return [99.0, 0.1 * episode + 0.01 * (frame // EACH), 0.2, 0.3]


def written(folder: Path, version: int) -> Path:
    """Two episodes; in version 3 both in one table and one film."""
    from pyarrow import parquet

    def save(name: str, columns: dict) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pa.table(columns), path)

    def films(name: str, frames: list[np.ndarray]) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(path), "w") as file:
            stream = file.add_stream("mpeg4", rate=RATE)
            stream.width, stream.height, stream.bit_rate = 96, 64, 4_000_000
            for one in frames:
                file.mux(stream.encode(av.VideoFrame.from_ndarray(one, format="rgb24")))
            file.mux(stream.encode())

    def rows(episode: int) -> dict:
        return {
            "observation.state": [state(episode, t) for t in range(COUNT)],
            "timestamp": [t / RATE for t in range(COUNT)],
            "episode_index": [episode] * COUNT,
            "task": ["hang it"] * COUNT,
        }

    whole = {0: rows(0), 1: rows(1)}
    shown = {e: [image(e, t) for t in range(COUNT)] for e in whole}
    if version == 2:
        for e in whole:
            numbers = {"episode_chunk": 0, "episode_index": e, "video_key": CAMERA}
            save(TABLES[2].format(**numbers), whole[e])
            films(WAYS[2].format(**numbers), shown[e])
    else:
        numbers = {"chunk_index": 0, "file_index": 0, "video_key": CAMERA}
        save(TABLES[3].format(**numbers), {k: whole[0][k] + whole[1][k] for k in whole[0]})
        films(WAYS[3].format(**numbers), shown[0] + shown[1])
        both, own = [0, 1], f"videos/{CAMERA}"
        episodes = {"episode_index": both, "data/chunk_index": [0, 0], "data/file_index": [0, 0]}
        episodes |= {f"{own}/chunk_index": [0, 0], f"{own}/file_index": [0, 0]}
        episodes[f"{own}/from_timestamp"] = [0.0, COUNT / RATE]
        episodes[f"{own}/to_timestamp"] = [COUNT / RATE, 2 * COUNT / RATE]
        save("meta/episodes/chunk-000/file-000.parquet", episodes)
    info = {
        "codebase_version": {2: "v2.1", 3: "v3.0"}[version], "fps": RATE, "total_episodes": 2,
        "chunks_size": 1000, "data_path": TABLES[version], "video_path": WAYS[version],
        "features": {
            CAMERA: {"dtype": "video", "shape": [64, 96, 3], "names": ["height", "width", "c"]},
            "observation.state": {
                "dtype": "float32", "shape": [4], "names": {"motors": ["joint", "x", "y", "z"]},
            },
        },
    }  # fmt: skip
    (folder / "meta").mkdir(exist_ok=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return folder


OPTIONS = {"frames": POSES, "fov": 60, "end0": "observation.state:1,2,3"}


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("episode", [0, 1])
def test_an_episode_with_the_hand_that_holds_end_0(version: int, episode: int, tmp_path: Path):
    source = written(tmp_path / "set", version)
    entries = {entry.name: entry.kind for entry in Lerobot().contents(source)}
    assert entries[CAMERA] == "film"
    assert entries["observation.state (joint, x, y, z)"] == "float32"
    recording = brought(source, "lerobot", episode=episode, **OPTIONS)
    assert len(recording.frames) == POSES
    assert recording.ends is not None
    for k, frame in enumerate(recording.frames):
        assert frame // EACH == k  # one of each pose, while it is still
        sight = recording.source.sight(frame)
        assert sight.color is not None
        assert np.abs(sight.color.astype(int) - image(episode, frame)).mean() < 6
        np.testing.assert_allclose(recording.ends[0].position[frame], state(episode, frame)[1:])
    assert recording.ends[1].kind == "free"


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"episode": 7}, BadInput, "no such file|no episode 7"),
        ({"camera": "side"}, WrongUsage, f"one of {CAMERA}"),
        ({"end0": "action"}, WrongUsage, "one of observation.state"),
        ({"end0": "observation.state:1,2"}, WrongUsage, "three of its 4 numbers"),
        ({"end0": "observation.state:1,2,9"}, WrongUsage, "three of its 4 numbers"),
    ],
)
@pytest.mark.parametrize("version", [2, 3])
def test_what_is_not_in_it_is_refused(version: int, given, error, words: str, tmp_path: Path):
    source = written(tmp_path / "set", version)
    with pytest.raises(error, match=words):
        brought(source, "lerobot", **(OPTIONS | given))


def test_files_outside_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    source = written(tmp_path / "set", 2)
    info = source / "meta" / "info.json"
    good = info.read_text()
    info.write_text(good.replace('"data/chunk', '"../data/chunk'))
    with pytest.raises(BadInput, match="outside"):
        brought(source, "lerobot", **OPTIONS)
    info.write_text(good.replace("{episode_chunk:03d}", "{nothing}"))
    with pytest.raises(BadInput, match="pattern of file names"):
        brought(source, "lerobot", **OPTIONS)
    info.write_text(good)
    table = next(source.glob("data/*/*000000.parquet"))
    table.write_bytes(table.read_bytes()[:200])
    with pytest.raises(BadInput, match="not readable as Parquet"):
        brought(source, "lerobot", **OPTIONS)
    info.write_text("{}")
    with pytest.raises(BadInput, match="no features"):
        brought(source, "lerobot", **OPTIONS)
