"""PLY point clouds: ascii or binary; the positions of the vertices and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.points import columns_of, from_records, from_text, number

TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
ORDERS = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
LONGEST_HEADER = 65536


def read_ply(path: Path, data: bytes) -> np.ndarray:
    """Return (N, 3) [m] of the vertices. Raises BadInput."""
    lines, body = _header(path, data)
    order: str | None = None
    skip_bytes = skip_words = 0
    element, count = b"", 0
    fields: list[tuple[str, str]] = []
    for line in lines:
        match line.split():
            case [b"format", name, _] if name in ORDERS:
                order = ORDERS[name]
            case [b"element", name, size]:
                if element == b"vertex":
                    break  # what follows the vertices is not read
                skip_bytes += count * np.dtype(fields).itemsize
                skip_words += count * len(fields)
                element, count, fields = name, number(path, size, "element"), []
            case [b"property", kind, name] if kind.decode("latin-1") in TYPES:
                entry = (name.decode("latin-1"), (order or "<") + TYPES[kind.decode("latin-1")])
                if entry[0] in dict(fields):
                    raise BadInput(f"{path}: property {entry[0][:40]!r} is declared twice")
                fields.append(entry)
            case [b"comment" | b"obj_info" | b"ply", *_] | []:
                pass
            case _:
                raise BadInput(f"{path}: cannot read header line {line[:60].decode('latin-1')!r}")
    names = [name for name, _ in fields]
    if order is None or element != b"vertex" or not {"x", "y", "z"} <= set(names):
        raise BadInput(f"{path}: PLY header lacks a format, or vertices with x, y, z")
    if order == "":
        table = from_text(path, body, count, len(fields), skip_words)
        return table[:, [names.index(axis) for axis in "xyz"]]
    return columns_of(
        from_records(path, body, count, np.dtype(fields), skip_bytes), ("x", "y", "z")
    )


def _header(path: Path, data: bytes) -> tuple[list[bytes], bytes]:
    """Return lines between `ply` and `end_header`, and what follows."""
    head = data[:LONGEST_HEADER]
    end = head.find(b"end_header")
    newline = head.find(b"\n", end)
    if not head.startswith(b"ply") or end < 0 or newline < 0:
        raise BadInput(f"{path}: has no PLY header")
    return head[:end].splitlines(), data[newline + 1 :]
