"""Which recordings a batch is of, and what their runs are called."""

from __future__ import annotations

import os
from pathlib import Path

from ropefit.errors import BadInput, WrongUsage

MANIFEST = "recording.toml"


def find_recordings(given: list[Path]) -> dict[str, Path]:
    """Return {name of the run: recording}, in order.

    A folder that is no recording stands for all recordings below it; their runs are named by their
    place in it ("session/take"), that of a recording by its folder. Links are not followed down.
    Raises BadInput where there is none, WrongUsage when two runs would have one name.
    """
    found: dict[str, Path] = {}
    for path in given:
        for name, recording in _below(path):
            if name in found and found[name].resolve() == recording.resolve():
                continue
            if name in found:
                raise WrongUsage(
                    f"{found[name]} and {recording}: two runs would be called {name}; batch them "
                    "into different --runs, or give the folder above both"
                )
            found[name] = recording
    for name in found:
        above = next((str(p) for p in Path(name).parents if str(p) in found), None)
        if above:
            raise WrongUsage(
                f"{found[name]}: its run {name} would lie inside the run of {found[above]}"
            )
    return found


def _below(path: Path) -> list[tuple[str, Path]]:
    if not path.is_dir():
        raise BadInput(f"{path}: no such recording directory; give one with a {MANIFEST}")
    if (path / MANIFEST).exists():
        return [(path.resolve().name, path)]
    found = []
    for folder, below, files in os.walk(path):
        below.sort()
        if MANIFEST in files:
            found.append((Path(folder).relative_to(path).as_posix(), Path(folder)))
            below.clear()
    if not found:
        raise BadInput(f"{path}: has no {MANIFEST}, and no folder below it has")
    return found
