"""Which fields of a setup a change of it depends on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    wrote. reads_on, writes_on: by it and all changes after it."""

    change: Callable[[Setup], Setup]
    after: Setup
    reads: frozenset[str]
    writes: frozenset[str]
    reads_on: frozenset[str] = frozenset()
    writes_on: frozenset[str] = frozenset()

    def again(self, setup: Setup, moved: frozenset[str]) -> tuple[Setup, frozenset[str]]:
        """Return what the change makes of a setup of which only some fields have `moved`, and which
        fields of `after` have moved by it. What does not depend on them is not made again."""
        if self.reads & moved:
            out = self.change(setup)
            return out, differing(out, self.after)
        moved -= self.writes
        return with_fields(self.after, setup, moved), moved


def with_fields(one: Setup, other: Setup, names: frozenset[str]) -> Setup:
    """Return a setup with some fields of another."""
    return one._replace(**{name: getattr(other, name) for name in names})


def made_again(setup: Setup, moved: frozenset[str], later: Sequence[Done]) -> Setup:
    """Return what changes that were made of a setup one after the other make of it, of which only
    some fields have `moved`."""
    for one in later:
        if not moved & one.reads_on:
            return with_fields(later[-1].after, setup, moved - one.writes_on)
        setup, moved = one.again(setup, moved)
    return setup


def done(setup: Setup, change: Callable[[Setup], Setup]) -> Done:
    """Make a change of a setup, and note what it reads and writes."""
    reads: set[str] = set()
    out = Setup._make(change(_watched(setup, reads)))
    for p in out.potentials[len(setup.potentials) :]:
        with np.errstate(all="ignore"):  # anywhere will do
            p.energy(np.zeros((1, 3)))  # an energy may read a field only now
    return Done(change, out, frozenset(reads), differing(out, setup))


def followed(made: list[Done]) -> list[Done]:
    """Return changes made one after the other, each with what it and those after it read and
    write."""
    reads, writes, out = frozenset[str](), frozenset[str](), []
    for one in reversed(made):
        reads, writes = reads | one.reads, writes | one.writes
        out.append(one._replace(reads_on=reads, writes_on=writes))
    return out[::-1]


def differing(one: Setup, other: Setup) -> frozenset[str]:
    """Return the fields whose values are not the same objects."""
    pairs = zip(Setup._fields, one, other, strict=True)
    return frozenset(name for name, a, b in pairs if a is not b)
