"""What an HDF5 file holds, as a tree {name: array, text or tree}; what it may not hold is refused
before anything is followed or allocated."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ropefit.errors import BadInput

MAX_BYTES = 4 << 30  # an artifact that declares more than this is refused before allocation
MAX_ENTRIES = 100_000
MAX_RATIO = 2000  # gzip does not reach it: an array that declares more than its data can hold
# What h5py raises for a file that is truncated, damaged or not as a schema says.
UNREADABLE = (OSError, KeyError, RuntimeError, TypeError, ValueError, MemoryError)


class Source:
    """A file that is read, and how much of it: links may show one entry under many names.

    size: of the file [bytes]. fixed: its texts must be of fixed length, as a sealed file's are:
    libhdf5 may never return from those of variable length, which it keeps in a heap.
    """

    def __init__(self, path: Path, size: int, fixed: bool):
        self.path, self.size, self.fixed = path, size, fixed
        self.entries, self.bytes = 0, 0

    def __str__(self) -> str:
        return str(self.path)

    def take(self, node: Any, size: int) -> None:
        """Count an entry of a size [bytes]. Raises BadInput beyond what an artifact may hold."""
        self.entries += 1
        self.bytes += size
        if self.entries > MAX_ENTRIES or self.bytes > MAX_BYTES:
            raise BadInput(f"{self}: declares more than it can hold, at {node.name}")


def open_image(image: bytes) -> h5py.File:
    """Open HDF5 in memory, to read: what was checked is what is read. Raises one of UNREADABLE."""
    return h5py.File(h5py.h5f.open_file_image(image))


def entries(group: h5py.Group, source: Source) -> Iterator[tuple[str, Any]]:
    """Return (name, group or dataset) in the order of writing; links are refused, never
    followed."""
    for name in map(str, group):
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise BadInput(
                f"{source}: {group.name}/{name} is a link; artifacts hold their own data"
            )
        source.take(group, 0)
        yield name, group[name]


def read_tree(group: h5py.Group, source: Source) -> dict[str, Any]:
    """Return {name: array, text or tree} of whatever a group holds."""
    return {
        name: read_value(node, source)
        if isinstance(node, h5py.Dataset)
        else read_tree(node, source)
        for name, node in entries(group, source)
    }


def read_value(node: h5py.Dataset, source: Source) -> np.ndarray | str:
    """Return an array or a text. Raises BadInput."""
    if node.is_virtual or node.external:
        raise BadInput(
            f"{source}: {node.name} is kept in another file; artifacts hold their own data"
        )
    kind = node.dtype
    if kind.hasobject and source.fixed:
        raise BadInput(f"{source}: {node.name} is of variable length; make it anew")
    text = kind.hasobject or kind.kind == "S"
    if text and node.shape != ():
        raise BadInput(f"{source}: {node.name} is not a single text; make it anew")
    if kind.hasobject:
        return str(node.asstr()[()])
    size = MAX_BYTES + 1 if node.size is None else node.size * kind.itemsize
    if size > min(MAX_BYTES, MAX_RATIO * min(node.id.get_storage_size(), source.size)):
        raise BadInput(
            f"{source}: {node.name} declares {node.shape} entries, more than it can hold"
        )
    source.take(node, size)
    return node[()].decode() if text else node[()]
