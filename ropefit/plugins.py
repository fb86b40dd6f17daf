"""What other packages add: found by their entry points, never by a list kept here."""

from __future__ import annotations

import traceback
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from ropefit.errors import StageFailed

T = TypeVar("T")
# The groups of entry points that are asked for.
GROUPS = (
    "ropefit.effects", "ropefit.exporters", "ropefit.importers", "ropefit.losses", "ropefit.solvers"
)  # fmt: skip
EFFECTS, EXPORTERS, IMPORTERS, LOSSES, SOLVERS = GROUPS


def concrete(base: type[T], group: str) -> list[type[T]]:
    """Return every class below `base` that can be made, those of installed packages included.

    A class is known once its module is imported. Modules of other packages are imported when
    they declare an entry point in `group`. Raises StageFailed when one cannot be imported.
    """
    for entry in entry_points(group=group):
        _loaded(entry)
    found: list[type[T]] = []
    waiting = [base]
    while waiting:
        kind = waiting.pop(0)
        waiting += kind.__subclasses__()
        if not getattr(kind, "__abstractmethods__", None):
            found.append(kind)
    return found


def names(group: str) -> list[str]:
    """Return the names that other packages declare in a group, without importing them."""
    return sorted(entry_points(group=group).names)


def named(group: str, name: str) -> Any:
    """Return what another package declares under a name of `names`. Raises StageFailed when it
    cannot be imported."""
    (entry,) = entry_points(group=group, name=name)
    return _loaded(entry)


def _loaded(entry: EntryPoint) -> Any:
    try:
        return entry.load()
    except Exception as error:  # another package's import may raise anything
        raise StageFailed(f"{entry.value}: an add-on that does not import ({error}); remove it")


def add_ons() -> set[Path]:
    """Return the files of the modules that other packages declare as entry points of ours."""
    found = set()
    for entry in (entry for group in GROUPS for entry in entry_points(group=group)):
        try:
            spec = find_spec(entry.module)
        except (ImportError, ValueError):  # whoever needs it says that it does not import
            continue
        if spec is not None and spec.origin is not None:
            found.add(Path(spec.origin))
    return found


def add_on_line(error: BaseException) -> str:
    """Return the innermost line of an add-on in the traceback of an exception, or ""."""
    files = {str(path) for path in add_ons()}
    lines = [f for f in traceback.extract_tb(error.__traceback__) if f.filename in files]
    return f"{Path(lines[-1].filename).name}:{lines[-1].lineno}" if lines else ""
