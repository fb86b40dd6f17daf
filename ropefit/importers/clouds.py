"""A folder of point clouds: .ply and .pcd files, one a frame, in the order of their names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

from ropefit.errors import BadInput
from ropefit.importers.base import Entry, Importer, Options, exists, thinned
from ropefit.importers.draft import Draft
from ropefit.importers.numbers import vector
from ropefit.recordings.clouds import read_cloud


class CloudOptions(Options):
    """scale: metres per unit. viewpoint: x,y,z [m] of the camera. ends: a table as ends.csv, by
    the clouds' numbers from 0."""

    scale: float = 1.0
    viewpoint: str | None = None
    ends: Path | None = None


class Clouds(Importer):
    """Numbers in names count as numbers: frame_9 comes before frame_10."""

    format: ClassVar[str] = "clouds"
    options: ClassVar[type[Options]] = CloudOptions

    def contents(self, source: Path) -> list[Entry]:
        kinds: dict[str, int] = {}
        for path in _files(source):
            kinds[path.suffix.lower()] = kinds.get(path.suffix.lower(), 0) + 1
        return [Entry(f"*{suffix}", "point clouds", count) for suffix, count in kinds.items()]

    def read(self, source: Path, options: CloudOptions, draft: Draft) -> None:
        paths = thinned(_files(source), options, source)
        for frame, path in enumerate(paths):
            draft.progress(frame / len(paths), path.name)
            draft.cloud(frame, read_cloud(path) * options.scale, path)
        if options.ends is not None:
            draft.ends_of(options.ends)
        else:
            draft.note("no --set ends: those visible in the clouds will be taken as pinned")
        viewpoint = None if options.viewpoint is None else vector("viewpoint", options.viewpoint)
        draft.clouds_table(viewpoint)


def _files(source: Path) -> list[Path]:
    exists(source)
    if not source.is_dir():
        raise BadInput(f"{source}: not a folder of .ply or .pcd files")
    found = [p for p in source.iterdir() if p.suffix.lower() in (".ply", ".pcd") and p.is_file()]
    if not found:
        raise BadInput(f"{source}: holds no .ply or .pcd file")
    return sorted(found, key=_key)


def _key(path: Path) -> list[tuple[int, int, str]]:
    parts = re.split(r"([0-9]+)", path.name)
    return [(1, int(part), "") if part.isdigit() else (0, 0, part) for part in parts if part]
