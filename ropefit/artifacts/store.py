"""Artifacts on disk: HDF5, written atomically, hashed, and read back through their schema.

Layout of a file: the root carries `schema_name`, `schema_version` and `content_sha256`; every
array is a dataset with attributes `unit` and `dims`; every nested part is a group; everything else
is a dataset of JSON text of fixed length with attribute `encoding = "json"`. After the HDF5 data
comes a seal (seal.py), from which identity and hash are read. Nothing is ever pickled.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TypeVar, get_args, get_origin

import h5py
import numpy as np
from pydantic import BaseModel, ValidationError

from ropefit.artifacts.atomic import write_bytes, writing
from ropefit.artifacts.base import Artifact, array_spec
from ropefit.artifacts.migrations import migrated
from ropefit.artifacts.packing import Pieces
from ropefit.artifacts.probe import readable
from ropefit.artifacts.seal import SEAL_BYTES, Broken, Seal, claimed, end_of, opened, sealed
from ropefit.artifacts.tree import (
    MAX_BYTES,
    UNREADABLE,
    Source,
    entries,
    open_image,
    read_tree,
    read_value,
)
from ropefit.errors import BadInput, StageFailed

NOT_CONTENT = {"provenance/created", "provenance/seconds"}

A = TypeVar("A", bound=Artifact)
Leaf = tuple[str, "np.ndarray | Pieces | str", dict[str, Any]]
LARGE_ARRAYS = 32_000_000  # bytes of arrays that are not to be in memory once more as a file
PIECE = 1 << 20  # bytes that are hashed at once
SPARE = 4_000_000  # bytes that a large file may have besides its arrays


def leaves(part: BaseModel, prefix: str = "") -> Iterator[Leaf]:
    """Return (path, array or JSON text, attributes) of everything in the part, in the schema's
    order."""
    for name, field in type(part).model_fields.items():
        value, path = getattr(part, name), f"{prefix}{name}"
        if value is None:
            continue
        spec = array_spec(field.annotation, field.metadata)
        if spec is not None:
            yield path, value, {"unit": spec.unit, "dims": list(spec.dims)}
        elif isinstance(value, BaseModel):
            yield from leaves(value, f"{path}/")
        elif isinstance(value, dict) and _part_type(field.annotation):
            for key, item in value.items():
                yield from leaves(item, f"{path}/{key}/")
        else:
            extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
            text = json.dumps(value, sort_keys=True, default=BaseModel.model_dump)
            yield path, text, {"encoding": "json", **({"unit": extra["unit"]} if extra else {})}


def _part_type(annotation: Any) -> type[BaseModel] | None:
    """Return the pydantic model that an annotation holds: itself, `Model | None` or `dict[str,
    Model]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    args = get_args(annotation)
    candidates = args[1:] if get_origin(annotation) is dict else args
    return next((found for arg in candidates if (found := _part_type(arg))), None)


def content_sha256(artifact: Artifact) -> str:
    """Hash of everything the artifact says, apart from when and how long it took to write."""
    digest = hashlib.sha256(f"{artifact.schema_name}/{artifact.schema_version}".encode())
    for path, value, _ in sorted(leaves(artifact), key=lambda leaf: leaf[0]):
        if path in NOT_CONTENT:
            continue
        _add(digest, path, value)
    return digest.hexdigest()


def _add(digest: Any, path: str, value: np.ndarray | Pieces | str) -> None:
    """Add one entry of an artifact to its hash."""
    digest.update(path.encode())
    if isinstance(value, str):
        digest.update(value.encode())
    else:
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        for part in value if isinstance(value, Pieces) else [value]:
            digest.update(np.ascontiguousarray(part).reshape(-1).view(np.uint8))  # no copy


def write(path: Path, artifact: Artifact) -> str:
    """Write atomically: a kill at any instant leaves the old file or the new one. Returns the
    hash."""
    digest = content_sha256(artifact)
    try:
        seal = Seal(artifact.schema_name, artifact.schema_version, digest)
        size = sum(value.nbytes for _, value, _ in leaves(artifact) if not isinstance(value, str))
        if size > LARGE_ARRAYS:
            with writing(path, size + SPARE) as out:
                _fill(out, artifact, digest)
                out.seek(0)
                out.write(end_of(iter(lambda: out.read(PIECE), b""), seal))
        else:
            image = io.BytesIO()  # HDF5's own driver for memory makes a second copy
            _fill(image, artifact, digest)
            write_bytes(path, *sealed(image.getvalue(), seal))
    except (OSError, RuntimeError) as error:
        why = getattr(error, "strerror", None) or error
        raise StageFailed(
            f"cannot write {path}: {why}; the previous file is unchanged; free space or give "
            "another --run"
        )
    return digest


def _fill(image: BinaryIO, artifact: Artifact, digest: str) -> None:
    """Write the bytes of the file. There must be room for them: on a full disk HDF5 may end the
    process."""
    with h5py.File(image, "w", track_order=True) as file:
        file.attrs["schema_name"] = artifact.schema_name
        file.attrs["schema_version"] = artifact.schema_version
        file.attrs["content_sha256"] = digest
        for name, value, attributes in leaves(artifact):
            parent, _, leaf = name.rpartition("/")
            group = _group(file, parent) if parent else file
            if isinstance(value, Pieces):
                dataset, start = group.create_dataset(leaf, value.shape, value.dtype), 0
                for part in value:
                    dataset[start : start + len(part)] = part
                    start += len(part)
            else:
                dataset = group.create_dataset(
                    leaf, data=_fixed(value), **_compression(artifact, value)
                )
            dataset.attrs.update(attributes)


def _group(file: h5py.File, path: str) -> h5py.Group:
    """Return the group at a path, made with its parents; entries keep the order in which they were
    written."""
    group: h5py.Group = file
    for name in path.split("/"):
        group = group[name] if name in group else group.create_group(name, track_order=True)  # type: ignore[assignment]
    return group


def _fixed(value: np.ndarray | str) -> np.ndarray:
    """Return text as UTF-8 of fixed length: text of variable length lies in a heap of its own, and
    a damaged one keeps libhdf5 busy for ever."""
    if isinstance(value, str):
        data = value.encode()
        return np.array(data, dtype=h5py.string_dtype("utf-8", len(data)))
    return value


def _compression(artifact: Artifact, value: np.ndarray | str) -> dict[str, Any]:
    large = artifact.compressed and not isinstance(value, str) and value.nbytes > 65536
    return {"compression": "gzip", "shuffle": True} if large else {}


def read(path: Path, kind: type[A]) -> tuple[A, str]:
    """Return the artifact and its content hash.

    Raises BadInput when the file is truncated, of another schema or version, or altered.
    """
    fix = f"make it anew with the command that wrote it, or delete {path.name}"
    with _opened(path, fix) as (file, seal, source):
        name, version, stored = seal.schema_name, seal.schema_version, seal.content_sha256
        if name != kind.schema_name:
            raise BadInput(f"{path}: holds {name}, expected {kind.schema_name}; {fix}")
        if version == kind.schema_version:
            raw = _read_group(file, kind, source)
        else:
            raw = _read_old(file, kind, version, stored, source, fix)
    try:
        artifact = kind.model_validate(raw)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or kind.schema_name
        raise BadInput(f"{path}: {where}: {first['msg']}; {fix}")
    # An old file was checked as it is; its hash is what others know it by.
    digest = content_sha256(artifact) if version == kind.schema_version else stored
    if digest != stored:
        raise BadInput(f"{path}: contents do not match their hash (damaged or edited); {fix}")
    return artifact, digest


def _read_old(
    file: h5py.File, kind: type[Artifact], version: int, stored: str, source: Source, fix: str
) -> dict[str, Any]:
    """Return the tree of an earlier version, its hash checked, brought to the present one."""
    digest = hashlib.sha256(f"{kind.schema_name}/{version}".encode())
    contents = read_tree(file, source)
    for name, value in sorted(_flat(contents), key=lambda leaf: leaf[0]):
        if name not in NOT_CONTENT:
            _add(digest, name, value)
    tree = migrated(kind.schema_name, version, kind.schema_version, _parsed(contents))
    if tree is None:
        raise BadInput(
            f"{source}: is {kind.schema_name} version {version}, this ropefit reads up to version "
            f"{kind.schema_version}; {fix}"
        )
    if digest.hexdigest() != stored:
        raise BadInput(f"{source}: contents do not match their hash (damaged or edited); {fix}")
    return tree


def _flat(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, np.ndarray | str]]:
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}/")
        else:
            yield f"{prefix}{name}", value


def _parsed(tree: dict[str, Any]) -> dict[str, Any]:
    """Return the tree with its JSON texts read."""
    return {
        name: _parsed(value)
        if isinstance(value, dict)
        else json.loads(value)
        if isinstance(value, str)
        else value
        for name, value in tree.items()
    }


def _identity(file: h5py.File, path: Path) -> Seal:
    """Return what a file without a seal says that it is."""
    if "schema_name" not in file.attrs or "schema_version" not in file.attrs:
        raise BadInput(f"{path}: is HDF5 but not a ropefit artifact; give another file")
    name, version = str(file.attrs["schema_name"]), int(str(file.attrs["schema_version"]))
    return Seal(name, version, str(file.attrs.get("content_sha256", "")))


@contextmanager
def _opened(path: Path, fix: str) -> Iterator[tuple[h5py.File, Seal, Source]]:
    """Return a file whose bytes are known to be as written, or to be such that HDF5 comes to an end
    with them; what it is. Raises BadInput, also for what is raised while it is read."""
    try:
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > MAX_BYTES:
                raise BadInput(f"{path}: is larger than an artifact can be; {fix}")
            seal, image = opened(stream.read(max(size - SEAL_BYTES, 0)), stream.read(SEAL_BYTES))
        if seal is None and not readable(image):
            raise BadInput(f"{path}: damaged such that reading it never ends; {fix}")
        with open_image(image) as file:
            yield file, seal or _identity(file, path), Source(path, size, seal is not None)
    except Broken:
        raise BadInput(f"{path}: contents do not match their hash (damaged or edited); {fix}")
    except UNREADABLE as error:
        raise BadInput(f"{path}: not a readable HDF5 file ({_one_line(error)}); {fix}")


def identity(path: Path) -> tuple[str, int]:
    """Return (schema name, version) of a file without reading the rest."""
    with _opened(path, "make it anew") as (_, seal, _):
        return seal.schema_name, seal.schema_version


def stored_hash(path: Path) -> str:
    """Return the content hash that an artifact carries, unchecked; empty where there is none."""
    try:
        with path.open("rb") as stream:
            stream.seek(-min(SEAL_BYTES, os.fstat(stream.fileno()).st_size), os.SEEK_END)
            seal = claimed(stream.read())
        if seal is None:
            with _opened(path, "") as (_, seal, _):
                pass
    except (OSError, BadInput):
        return ""
    return seal.content_sha256


def _read_group(group: h5py.Group, kind: type[BaseModel], source: Source) -> dict[str, Any]:
    raw: dict[str, Any] = {}
    if not isinstance(group, h5py.Group):
        raise BadInput(f"{source}: {group.name} is a value where a group belongs; make it anew")
    for name, node in entries(group, source):
        field = kind.model_fields.get(name)
        if field is None:
            raise BadInput(f"{source}: unknown entry {node.name}; written by another ropefit?")
        if isinstance(node, h5py.Dataset):
            raw[name] = _read_dataset(node, source)
            continue
        part = _part_type(field.annotation)
        if part is None or not isinstance(node, h5py.Group):
            raise BadInput(f"{source}: {node.name} is a group where a value belongs; make it anew")
        if get_origin(field.annotation) is dict:
            raw[name] = {
                key: _read_group(item, part, source) for key, item in entries(node, source)
            }
        else:
            raw[name] = _read_group(node, part, source)
    # An empty dict[str, Part] has no group in the file; its default restores it.
    return raw


def _read_dataset(node: h5py.Dataset, source: Source) -> Any:
    value = read_value(node, source)
    return json.loads(value) if isinstance(value, str) else value


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:160]
