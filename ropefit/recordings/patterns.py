"""File-name patterns such as "clouds/{frame:06d}.ply": which frames are there."""

from __future__ import annotations

import re
from pathlib import Path

from ropefit.errors import BadInput
from ropefit.recordings.manifest import inside

FIELD = re.compile(r"\{frame(?::0?[0-9]?d)?\}")


def list_frames(directory: Path, pattern: str, key: str) -> dict[int, Path]:
    """Return {frame: path} of the files that match the pattern, in order. Raises BadInput if
    none."""
    parts = FIELD.split(Path(pattern).name)
    if (
        len(parts) != 2
        or len(FIELD.findall(pattern)) != 1
        or set("{}") & set(FIELD.sub("", pattern))
    ):
        raise BadInput(
            f"{directory}: {key} = {pattern!r} needs one {{frame}} or {{frame:06d}} in its name"
        )
    inside(directory, FIELD.sub("0", pattern))
    name = re.compile(re.escape(parts[0]) + r"([0-9]{1,9})" + re.escape(parts[1]))
    folder = directory / Path(pattern).parent
    found = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else []:
        match = name.fullmatch(path.name)
        if match:
            frame = int(match.group(1))
            relative = Path(pattern).parent / path.name
            if pattern_name(pattern, frame) == relative.as_posix():
                found[frame] = inside(directory, str(relative))
    if not found:
        raise BadInput(
            f"{directory}: no file matches {key} = {pattern!r}; correct it or add the files"
        )
    return dict(sorted(found.items()))


def pattern_name(pattern: str, frame: int) -> str:
    """Return the file name of one frame."""
    return Path(pattern.format(frame=frame)).as_posix()
