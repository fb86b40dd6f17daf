"""The last bytes of an artifact: what it is, and a hash of every byte before them.

libhdf5 can be busy for ever with a damaged file. A file whose bytes are those that were written is
not damaged, and that can be checked without libhdf5. To HDF5 what follows the end of its data is
nothing: any HDF5 program reads a sealed file, and one that writes to it takes the seal away.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass

SEAL_BYTES = 256  # bytes, padded with spaces
MARK = b"ropefit-seal/"
LINE = re.compile(rb"(ropefit-seal/1 ([a-z-]{1,60}) (\d{1,9}) ([0-9a-f]{64})) ([0-9a-f]{64}) *\n")


class Broken(ValueError):
    """There is a seal, and the bytes before it are others."""


@dataclass(frozen=True)
class Seal:
    """Schema name and version of an artifact, and the hash of its contents."""

    schema_name: str
    schema_version: int
    content_sha256: str


def sealed(image: bytes, seal: Seal) -> tuple[bytes, bytes]:
    """Return the two parts of a file: an HDF5 image and its seal."""
    return image, end_of([image], seal)


def end_of(image: Iterable[bytes], seal: Seal) -> bytes:
    """Return the seal of an HDF5 image, given in parts, as the last bytes of a file."""
    line = f"ropefit-seal/1 {seal.schema_name} {seal.schema_version} {seal.content_sha256}".encode()
    return (line + b" " + _hash(image, line)).ljust(SEAL_BYTES - 1) + b"\n"


def opened(image: bytes, end: bytes) -> tuple[Seal | None, bytes]:
    """Return (the seal, or None where there is none; the HDF5 image), from a file's last
    `SEAL_BYTES` and those before. Raises Broken."""
    found = LINE.fullmatch(end)
    if found and _hash([image], found[1]) == found[5]:
        return _seal(found), image
    if found or MARK in end:  # also one that is cut off
        raise Broken
    return None, image + end


def claimed(end: bytes) -> Seal | None:
    """Return the seal at the end of a file, from its last SEAL_BYTES bytes alone: unchecked."""
    found = LINE.fullmatch(end)
    return _seal(found) if found else None


def _seal(found: re.Match[bytes]) -> Seal:
    return Seal(found[2].decode(), int(found[3]), found[4].decode())


def _hash(image: Iterable[bytes], line: bytes) -> bytes:
    digest = hashlib.sha256()
    for part in image:
        digest.update(part)
    digest.update(line)
    return digest.hexdigest().encode()
