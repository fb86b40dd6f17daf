"""Which fields of a setup a change of it depends on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ropefit.rod.setup import Setup

FIELDS = frozenset(Setup._fields)


class Watched(Setup):
    """A setup that notes which of its fields are read."""

    reads: set[str]

    def __getattribute__(self, name: str) -> Any:
        if name in FIELDS:
            self.reads.add(name)
        elif name == "_asdict":
            self.reads.update(FIELDS)
        return super().__getattribute__(name)

    def _replace(self, **fields: Any) -> Watched:
        return _watched(super()._replace(**fields), self.reads)


def _watched(setup: Setup, reads: set[str]) -> Watched:
    out = Watched._make(setup)
    out.reads = reads
    return out


class Done(NamedTuple):
    """A change of a setup once made: the setup after it, the fields that it read, and those that it
    wrote."""

    change: Callable[[Setup], Setup]
    after: Setup
    reads: frozenset[str]
    writes: frozenset[str]

    def again(self, setup: Setup, moved: frozenset[str]) -> tuple[Setup, frozenset[str]]:
        """Return what the change makes of a setup of which only some fields have `moved`, and which
        fields of `after` have moved by it. What does not depend on them is not made again."""
        if self.reads & moved:
            out = self.change(setup)
            return out, differing(out, self.after)
        moved -= self.writes
        return self.after._replace(**{name: getattr(setup, name) for name in moved}), moved


def done(setup: Setup, change: Callable[[Setup], Setup]) -> Done:
    """Make a change of a setup, and note what it reads and writes."""
    reads: set[str] = set()
    out = Setup._make(change(_watched(setup, reads)))
    for p in out.potentials[len(setup.potentials) :]:
        with np.errstate(all="ignore"):  # anywhere will do
            p.energy(np.zeros((1, 3)))  # an energy may read a field only now
    return Done(change, out, frozenset(reads), differing(out, setup))


def differing(one: Setup, other: Setup) -> frozenset[str]:
    """Return the fields whose values are not the same objects."""
    pairs = zip(Setup._fields, one, other, strict=True)
    return frozenset(name for name, a, b in pairs if a is not b)
