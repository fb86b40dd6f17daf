"""What other packages add: found by their entry points, never by a list kept here."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
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
