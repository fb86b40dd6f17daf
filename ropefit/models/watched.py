"""Which fields of a setup a change of it depends on, of its properties each by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ropefit.rod.rod import Properties
from ropefit.rod.setup import Setup

OF_ROPE = tuple(f"properties.{name}" for name in Properties._fields)
OTHERS = tuple(name for name in Setup._fields if name != "properties")
FIELDS = frozenset((*OF_ROPE, *OTHERS))
OF_SETUP, OF_PROPERTIES = frozenset(OTHERS), frozenset(Properties._fields)


class WatchedProperties(Properties):
    """Properties that note which of them are read; taken apart as a tuple, all of them."""

    reads: set[str]

    def __getattribute__(self, name: str) -> Any:
        if name in OF_PROPERTIES:
            self.reads.add(f"properties.{name}")
        return super().__getattribute__(name)

    def __getitem__(self, index: Any) -> Any:
        self.reads.update(OF_ROPE)
        return super().__getitem__(index)

    def __iter__(self) -> Iterator[Any]:
        self.reads.update(OF_ROPE)
        return super().__iter__()

    def _replace(self, **fields: Any) -> WatchedProperties:
        return _watched_properties(_plain(self)._replace(**fields), self.reads)


class Watched(Setup):
    """A setup that notes which of its fields are read."""

    reads: set[str]

    def __getattribute__(self, name: str) -> Any:
        if name in OF_SETUP:
            self.reads.add(name)
        elif name == "_asdict":
            self.reads.update(FIELDS)
        value = super().__getattribute__(name)
        return _watched_properties(value, self.reads) if name == "properties" else value

    def _replace(self, **fields: Any) -> Watched:
        return _watched(super()._replace(**fields), self.reads)


def _watched(setup: Setup, reads: set[str]) -> Watched:
    out = Watched._make(setup)
    out.reads = reads
    return out


def _watched_properties(properties: Properties, reads: set[str]) -> WatchedProperties:
    out = WatchedProperties._make(_plain(properties))
    out.reads = reads
    return out


def _plain(properties: Properties) -> Properties:
    """Return properties that are not watched; this reads none of them."""
    return Properties._make(tuple.__iter__(properties))


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
    fields: dict[str, Any] = {name: getattr(other, name) for name in names & OF_SETUP}
    own = {
        name: getattr(other.properties, name)
        for name in OF_PROPERTIES
        if f"properties.{name}" in names
    }
    if own:
        fields["properties"] = one.properties._replace(**own)
    return one._replace(**fields) if fields else one


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
    out = out._replace(properties=_as_before(setup.properties, _plain(out.properties)))
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
    out = {name for name, a, b in zip(Setup._fields, one, other, strict=True) if a is not b}
    if "properties" in out:
        out.remove("properties")
        pairs = zip(OF_ROPE, one.properties, other.properties, strict=True)
        out.update(name for name, a, b in pairs if a is not b)
    return frozenset(out)


def _as_before(before: Properties, after: Properties) -> Properties:
    """Return properties after a change: the object before it, where none of them is another."""
    same = all(a is b for a, b in zip(before, after, strict=True))
    return before if same else after
