"""LeRobot data sets, version 2 and 3: an episode's film by one camera, and poses of the ends.

The tables are Parquet, read by PyArrow, the films MP4; LeRobot itself is not needed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from ropefit.errors import BadInput, StageFailed, WrongUsage
from ropefit.importers.base import Entry, Importer, exists, readable
from ropefit.importers.draft import Draft
from ropefit.importers.video import FilmOptions, film
from ropefit.recordings.manifest import inside

LARGEST_INFO = 10_000_000  # bytes
WHAT = "a LeRobot data set"
EARLY = 1e-3  # s: rounding of times in a film


class LerobotOptions(FilmOptions):
    """episode: its number. camera: a film, if there are several. end0, end1: FEATURE:I,J,K, where
    x,y,z [m] of an end stand, in the recording's frame (FEATURE alone: its first three). Others: as
    of video."""

    episode: int = Field(default=0, ge=0)
    camera: str | None = None
    end0: str | None = None
    end1: str | None = None


class Film(NamedTuple):
    """A film and the times [s] in it at which an episode begins and ends."""

    path: Path
    start: float
    stop: float


class Lerobot(Importer):
    """A folder with meta/info.json. The stillest frames of an episode are taken, as of a video."""

    format: ClassVar[str] = "lerobot"
    options: ClassVar[type[LerobotOptions]] = LerobotOptions

    def contents(self, source: Path) -> list[Entry]:
        info = _info(source)
        with readable(source, WHAT):
            found = [Entry("episodes", "recordings", int(info.get("total_episodes", 0)))]
            for name, feature in info["features"].items():
                kind = "film" if feature.get("dtype") == "video" else str(feature.get("dtype"))
                names = _names(feature)
                label = name + (f" ({', '.join(names)})" if names else "")
                found.append(Entry(label, kind, len(names)))
            return found

    def read(self, source: Path, options: LerobotOptions, draft: Draft) -> None:
        info = _info(source)
        with readable(source, WHAT):
            _read(source, info, options, draft)


def _read(source: Path, info: dict[str, Any], options: LerobotOptions, draft: Draft) -> None:
    table = _table(source, info, options.episode)
    of = _film(source, info, options.episode, _camera(source, info, options.camera))
    rate = float(info.get("fps") or 0)
    if not 0 < rate < np.inf:
        raise BadInput(f"{source}: meta/info.json has no frame rate (fps)")
    first = round(of.start * rate)
    count = len(table["episode_index"])
    last = min(first + count, round((of.stop + EARLY) * rate)) if of.stop < np.inf else count
    taken = film(of.path, options, draft, range(first, last))
    for end, where in enumerate((options.end0, options.end1)):
        if where is not None:
            places = _columns(table, where)
            for frame in taken:
                draft.end(frame, frame / rate, end, places[frame], None)
    if options.end0 is None or options.end1 is None:
        draft.note("ends without --set end0= and end1= (columns of x,y,z in metres) are free")


def _info(source: Path) -> dict[str, Any]:
    exists(source)
    path = source / "meta" / "info.json"
    if not path.is_file() or path.stat().st_size > LARGEST_INFO:
        raise BadInput(f"{source}: no LeRobot data set (no meta/info.json in it)")
    with readable(path, "JSON"):
        info = json.loads(path.read_text())
    if not isinstance(info, dict) or not isinstance(info.get("features"), dict):
        raise BadInput(f"{path}: no LeRobot data set (no features in it)")
    return info


def _names(feature: dict[str, Any]) -> list[str]:
    """Return the names of a feature's numbers; of images none."""
    names = feature.get("names")
    if isinstance(names, dict):  # {"motors": [...]}
        names = next(iter(names.values()), None)
    known = feature.get("dtype") not in ("video", "image") and isinstance(names, list)
    return [str(name) for name in names or []] if known else []


def _camera(source: Path, info: dict[str, Any], given: str | None) -> str:
    films = [name for name, f in info["features"].items() if f.get("dtype") == "video"]
    if given is None and len(films) == 1:
        return films[0]
    if given is None or given not in films:
        raise WrongUsage(f"{source}: --set camera=NAME, one of {', '.join(films) or 'none'}")
    return given


def _named(source: Path, pattern: Any, **values: Any) -> Path:
    """Return a file of the data set whose name is written with places for numbers."""
    with readable(source / "meta" / "info.json", "a pattern of file names"):
        name = str(pattern).format(**values)
    path = inside(source, name)
    if not path.is_file():
        raise BadInput(f"{path}: no such file, though meta/info.json names it")
    return path


def _table(source: Path, info: dict[str, Any], episode: int) -> dict[str, np.ndarray]:
    """Return the columns (F, ...) of an episode, by name."""
    if info.get("codebase_version", "").startswith("v3"):
        row = _episode(source, episode)
        numbers = {k: row[f"data/{k}"] for k in ("chunk_index", "file_index")}
    else:
        chunk = episode // max(int(info.get("chunks_size", 1000)), 1)
        numbers = {"episode_chunk": chunk, "episode_index": episode}
    path = _named(source, info.get("data_path"), **numbers)
    table = _parquet(path)
    mine = np.flatnonzero(table["episode_index"] == episode)
    if not len(mine):
        raise BadInput(f"{path}: has no episode {episode}")
    return {name: column[mine] for name, column in table.items()}


def _film(source: Path, info: dict[str, Any], episode: int, camera: str) -> Film:
    if info.get("codebase_version", "").startswith("v3"):
        row = _episode(source, episode)
        own = f"videos/{camera}"
        numbers = {k: row[f"{own}/{k}"] for k in ("chunk_index", "file_index")}
        path = _named(source, info.get("video_path"), video_key=camera, **numbers)
        return Film(path, float(row[f"{own}/from_timestamp"]), float(row[f"{own}/to_timestamp"]))
    chunk = episode // max(int(info.get("chunks_size", 1000)), 1)
    numbers = {"episode_chunk": chunk, "episode_index": episode, "video_key": camera}
    return Film(_named(source, info.get("video_path"), **numbers), 0.0, np.inf)


def _episode(source: Path, episode: int) -> dict[str, Any]:
    """Return what a data set of version 3 says of an episode: where its table and films are."""
    for path in sorted((source / "meta" / "episodes").glob("chunk-*/file-*.parquet")):
        table = _parquet(path)
        mine = np.flatnonzero(table["episode_index"] == episode)
        if len(mine):
            return {
                name: column[mine[0]].item() for name, column in table.items() if column.ndim == 1
            }
    raise BadInput(f"{source}: meta/episodes tells of no episode {episode}")


def _parquet(path: Path) -> dict[str, np.ndarray]:
    """Return the columns (F,) or (F, n) of numbers of a Parquet file; others are left out."""
    try:
        from pyarrow import parquet, types
    except ImportError:
        raise StageFailed("LeRobot's tables need PyArrow; run pip install 'ropefit[lerobot]'")
    with readable(path, "Parquet"):
        table = parquet.read_table(path)
    out = {}
    for name in table.column_names:
        column = table.column(name).combine_chunks()
        lists = types.is_list(column.type) or types.is_fixed_size_list(column.type)
        if lists and types.is_primitive(column.type.value_type) and len(column):
            flat = column.flatten().to_numpy(zero_copy_only=False)
            if flat.size % len(column) == 0:
                out[name] = flat.reshape(len(column), -1)
        elif types.is_primitive(column.type):
            out[name] = column.to_numpy(zero_copy_only=False)
    if "episode_index" not in out:
        raise BadInput(f"{path}: has no column episode_index")
    return out


def _columns(table: dict[str, np.ndarray], where: str) -> np.ndarray:
    """Return (F, 3) [m] the columns that FEATURE or FEATURE:I,J,K names."""
    name, _, numbers = where.partition(":")
    column = table.get(name)
    if column is None or column.ndim != 2:
        known = ", ".join(sorted(k for k, v in table.items() if v.ndim == 2))
        raise WrongUsage(f"{name}: no column with several numbers; one of {known or 'none'}")
    which = [n for n in numbers.split(",") if n.isdigit() and int(n) < column.shape[1]]
    which = which if numbers else ["0", "1", "2"][: column.shape[1]]
    if len(which) != 3:
        raise WrongUsage(f"{where}: give three of its {column.shape[1]} numbers, as FEATURE:0,1,2")
    return column[:, [int(n) for n in which]].astype(float)
