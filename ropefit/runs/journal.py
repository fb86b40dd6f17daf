"""What a long computation has found so far, so that one that is killed goes on where it was.

A computation that is repeated takes the same steps in the same order: a result is known by its name
and number, and where it was kept it is taken from there. What was kept of the parts of a result is
forgotten when the result itself is kept. Who keeps a journal (`keeping`) decides where it is saved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import BinaryIO

import numpy as np

from ropefit.runs.spilled import Spilled

LARGE_ARRAY = 1 << 12  # bytes of an array of a result that is put aside
MOST_BYTES = 16e6  # bytes of the parts of what is under way; saved, they are in memory four times

Arrays = dict[str, np.ndarray]
Entries = dict[str, dict[str, np.ndarray | Spilled]]


class Journal:
    """Results by name; a part of a result is named result/part. `save` is called with all of them
    whenever there is a new one; without it nothing is kept. aside: a file for large arrays of
    results, which are many in a diagnosis and asked for only where it goes on; the parts of what is
    under way stay in memory."""

    def __init__(
        self, entries: Entries | None = None, save: Callable[[Entries], None] | None = None,
        aside: BinaryIO | None = None,
    ):  # fmt: skip
        self.entries = entries or {}
        self._save, self._aside = save, aside
        self._count: Counter[str] = Counter()
        self._parts = {name: _size(e) for name, e in self.entries.items() if "/" in name}
        self._full: set[str] = set()

    def next(self, kind: str) -> str:
        """Return the name of the next result of a kind."""
        self._count[kind] += 1
        return f"{kind} {self._count[kind]}"

    def recall(self, name: str) -> Arrays | None:
        """Return what was kept under a name, or None."""
        entry = self.entries.get(name)
        if entry is None:
            return None
        return {key: v.load() if isinstance(v, Spilled) else v for key, v in entry.items()}

    def keep(self, name: str, make: Callable[[], Arrays]) -> None:
        """Keep what `make` gives, copied, and forget the parts of it.

        When the parts are too many no more are kept of that result: a computation goes on from the
        last that was.
        """
        whole = name.partition("/")[0]
        if self._save is None or (name != whole and whole in self._full):
            return
        entry = {key: np.array(value) for key, value in make().items()}
        if name == whole:
            for part in [key for key in self._parts if key.startswith(f"{name}/")]:
                del self.entries[part], self._parts[part]
            self.entries[name] = {key: self._put_aside(value) for key, value in entry.items()}
            self._save(self.entries)
            return
        if sum(self._parts.values()) + _size(entry) > MOST_BYTES:
            self._full.add(whole)
            return
        self._parts[name] = _size(entry)
        self.entries[name] = dict(entry)
        self._save(self.entries)

    def _put_aside(self, value: np.ndarray) -> np.ndarray | Spilled:
        if self._aside is None or value.nbytes < LARGE_ARRAY:
            return value
        try:
            return Spilled.of(value, self._aside)
        except OSError:  # no room
            return value


def _size(entry: Mapping[str, np.ndarray | Spilled]) -> int:
    return sum(value.nbytes for value in entry.values())


_current: ContextVar[Journal | None] = ContextVar("journal", default=None)


def journal() -> Journal:
    """Return the journal of the computation that is under way; one that keeps nothing if it has
    none."""
    return _current.get() or Journal()


@contextmanager
def keeping(kept: Journal) -> Iterator[Journal]:
    """Keep the results of the computations inside in this journal."""
    token = _current.set(kept)
    try:
        yield kept
    finally:
        _current.reset(token)
