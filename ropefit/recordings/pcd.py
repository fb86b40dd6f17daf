"""PCD point clouds, version 0.7: ascii, binary or compressed; the positions and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.points import columns_of, from_records, from_text, number

KINDS = {b"F": "f", b"I": "i", b"U": "u"}
SIZES = {"f": (4, 8), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8)}
LONGEST_HEADER = 65536


def read_pcd(path: Path, data: bytes) -> np.ndarray:
    """Return (N, 3) [m] of the points. Raises BadInput."""
    header, body = _header(path, data)
    record = _record(path, header)
    names = list(record.names or ())
    if len(header.get(b"POINTS", [])) != 1:
        raise BadInput(f"{path}: PCD header lacks POINTS")
    count = number(path, header[b"POINTS"][0], "POINTS")
    kind = header[b"DATA"]
    if kind == [b"ascii"]:
        widths = [record[name].shape[0] if record[name].shape else 1 for name in names]
        first = np.concatenate([[0], np.cumsum(widths)]).astype(int)
        table = from_text(path, body, count, int(first[-1]))
        return table[:, [first[names.index(axis)] for axis in "xyz"]]
    if kind == [b"binary"]:
        return columns_of(from_records(path, body, count, record), ("x", "y", "z"))
    if kind == [b"binary_compressed"]:
        return _compressed(path, body, count, record)
    raise BadInput(f"{path}: DATA is ascii, binary or binary_compressed")


def _header(path: Path, data: bytes) -> tuple[dict[bytes, list[bytes]], bytes]:
    """Return {keyword: words} down to DATA, and what follows."""
    header: dict[bytes, list[bytes]] = {}
    at = 0
    while b"DATA" not in header:
        newline = data.find(b"\n", at, LONGEST_HEADER)
        if newline < 0:
            raise BadInput(f"{path}: has no PCD header")
        words = data[at:newline].split()
        if words and not words[0].startswith(b"#"):
            header[words[0]] = words[1:]
        at = newline + 1
    return header, data[at:]


def _record(path: Path, header: dict[bytes, list[bytes]]) -> np.dtype:
    """Return the type of one point; fields other than x, y, z are distinguished by their place."""
    names = [name.decode("latin-1") for name in header.get(b"FIELDS", [])]
    sizes, kinds = header.get(b"SIZE", []), header.get(b"TYPE", [])
    counts = header.get(b"COUNT", [b"1"] * len(names))
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise BadInput(f"{path}: FIELDS, SIZE, TYPE and COUNT differ in length")
    fields = []
    for place, (name, size, letter, repeat) in enumerate(
        zip(names, sizes, kinds, counts, strict=True)
    ):
        kind, bytes_each = KINDS.get(letter, ""), number(path, size, "SIZE", 8)
        times = number(path, repeat, "COUNT", 65536)
        if bytes_each not in SIZES.get(kind, ()) or (name in ("x", "y", "z") and times != 1):
            raise BadInput(f"{path}: field {name[:40]!r} has no readable TYPE, SIZE or COUNT")
        label = name if name in ("x", "y", "z") else f"{place} {name}"
        fields.append((label, f"<{kind}{bytes_each}", () if times == 1 else (times,)))
    if sorted(name for name in names if name in ("x", "y", "z")) != ["x", "y", "z"]:
        raise BadInput(f"{path}: needs the fields x, y, z once each")
    return np.dtype(fields)


def _compressed(path: Path, body: bytes, count: int, record: np.dtype) -> np.ndarray:
    """Return the values of LZF-compressed data, one field after the other."""
    if len(body) < 8:
        raise BadInput(f"{path}: truncated: no compressed data")
    packed, size = (int(n) for n in np.frombuffer(body, "<u4", 2))
    if size != count * record.itemsize or packed > len(body) - 8:
        raise BadInput(f"{path}: truncated or damaged: compressed data of another size")
    data = _unpack_lzf(path, body[8 : 8 + packed], size)
    at, columns = 0, np.empty(count, [(axis, float) for axis in ("x", "y", "z")])
    for name in record.names or ():
        if name in ("x", "y", "z"):
            with np.errstate(all="ignore"):  # a signalling NaN becomes a quiet one
                columns[name] = np.frombuffer(data, record[name], count, at)
        at += count * record[name].itemsize
    return columns_of(columns, ("x", "y", "z"))


def _unpack_lzf(path: Path, packed: bytes, size: int) -> bytes:
    """Undo LZF: runs of literal bytes and references back into what was unpacked."""
    out = bytearray()
    at = 0
    try:
        while at < len(packed) and len(out) <= size:
            control = packed[at]
            at += 1
            if control < 32:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - packed[at] - 1
            at += 1
            length += 2
            if start < 0:
                break
            while length > 0:  # a reference may overlap what it writes
                piece = out[start : start + length]
                out += piece
                start, length = start + len(piece), length - len(piece)
    except IndexError:
        pass
    if len(out) != size:
        raise BadInput(f"{path}: damaged: compressed data do not unpack to their size")
    return bytes(out)
