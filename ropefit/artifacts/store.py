"""Artifacts on disk: HDF5, written atomically, hashed, and read back through their schema.

Layout of a file: the root carries `schema_name`, `schema_version` and `content_sha256`; every
array is
a dataset with attributes `unit` and `dims`; every nested part is a group; everything else is a
dataset of JSON text with attribute `encoding = "json"`. Nothing is ever pickled.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import h5py
import numpy as np
from pydantic import BaseModel, ValidationError

from ropefit.artifacts.base import Artifact, array_spec
from ropefit.errors import BadInput, StageFailed

MAX_BYTES = 4 << 30  # an artifact that declares more than this is refused before allocation
MAX_RATIO = 2000  # gzip does not reach it: an array that declares more than its data can hold
# What h5py raises for a file that is truncated, damaged or not as a schema says.
UNREADABLE = (OSError, KeyError, RuntimeError, TypeError, ValueError, MemoryError)
NOT_CONTENT = {"provenance/created", "provenance/seconds"}

A = TypeVar("A", bound=Artifact)
Leaf = tuple[str, "np.ndarray | str", dict[str, Any]]


def leaves(part: BaseModel, prefix: str = "") -> Iterator[Leaf]:
    """(path, array or JSON text, attributes) of everything in the part, in the schema's order."""
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
    """The pydantic model that an annotation holds: itself, `Model | None` or `dict[str, Model]`."""
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
        digest.update(path.encode())
        if isinstance(value, str):
            digest.update(value.encode())
        else:
            digest.update(f"{value.dtype.str}{value.shape}".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()


def write(path: Path, artifact: Artifact) -> str:
    """Write atomically: a kill at any instant leaves the old file or the new one. Returns the
    hash."""
    digest = content_sha256(artifact)
    try:
        handle, temporary = tempfile.mkstemp(
            prefix=f".{path.name}.", suffix=".tmp", dir=path.parent
        )
    except OSError as error:
        raise StageFailed(f"cannot write {path}: {error.strerror}; free or choose another --run")
    try:
        os.close(handle)
        with h5py.File(temporary, "w", track_order=True) as file:
            file.attrs["schema_name"] = artifact.schema_name
            file.attrs["schema_version"] = artifact.schema_version
            file.attrs["content_sha256"] = digest
            for name, value, attributes in leaves(artifact):
                parent, _, leaf = name.rpartition("/")
                group = _group(file, parent) if parent else file
                dataset = group.create_dataset(leaf, data=value, **_compression(value))
                dataset.attrs.update(attributes)
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:  # HDF5 reports a full disk as either
        raise StageFailed(f"cannot write {path}: {error}; the previous file is unchanged")
    finally:
        Path(temporary).unlink(missing_ok=True)
    return digest


def _group(file: h5py.File, path: str) -> h5py.Group:
    """The group at a path, made with its parents; entries keep the order in which they were
    written."""
    group: h5py.Group = file
    for name in path.split("/"):
        group = group[name] if name in group else group.create_group(name, track_order=True)  # type: ignore[assignment]
    return group


def _compression(value: np.ndarray | str) -> dict[str, Any]:
    large = not isinstance(value, str) and value.nbytes > 65536
    return {"compression": "gzip", "shuffle": True} if large else {}


def read(path: Path, kind: type[A]) -> tuple[A, str]:
    """The artifact and its content hash.

    Raises BadInput when the file is truncated, of another schema or version, or altered.
    """
    fix = f"make it anew with the command that wrote it, or delete {path.name}"
    try:
        with h5py.File(path, "r") as file:
            name, version = _identity(file, path)
            if name != kind.schema_name:
                raise BadInput(f"{path}: holds {name}, expected {kind.schema_name}; {fix}")
            if version != kind.schema_version:
                raise BadInput(
                    f"{path}: is {name} version {version}, this ropefit reads version "
                    f"{kind.schema_version}; {fix}"
                )
            stored = str(file.attrs.get("content_sha256", ""))
            raw = _read_group(file, kind, path)
    except UNREADABLE as error:
        raise BadInput(f"{path}: not a readable HDF5 file ({_one_line(error)}); {fix}")
    try:
        artifact = kind.model_validate(raw)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or kind.schema_name
        raise BadInput(f"{path}: {where}: {first['msg']}; {fix}")
    digest = content_sha256(artifact)
    if digest != stored:
        raise BadInput(f"{path}: contents do not match their hash (damaged or edited); {fix}")
    return artifact, digest


def _identity(file: h5py.File, path: Path) -> tuple[str, int]:
    if "schema_name" not in file.attrs or "schema_version" not in file.attrs:
        raise BadInput(f"{path}: is HDF5 but not a ropefit artifact; give another file")
    return str(file.attrs["schema_name"]), int(str(file.attrs["schema_version"]))


def identity(path: Path) -> tuple[str, int]:
    """(schema name, version) of a file without reading the rest."""
    try:
        with h5py.File(path, "r") as file:
            return _identity(file, path)
    except UNREADABLE as error:
        raise BadInput(f"{path}: not a readable HDF5 file ({_one_line(error)}); make it anew")


def _read_group(group: h5py.Group, kind: type[BaseModel], path: Path) -> dict[str, Any]:
    raw: dict[str, Any] = {}
    if not isinstance(group, h5py.Group):
        raise BadInput(f"{path}: {group.name} is a value where a group belongs; make it anew")
    for name, node in _entries(group, path):
        field = kind.model_fields.get(name)
        if field is None:
            raise BadInput(f"{path}: unknown entry {node.name}; written by another ropefit?")
        if isinstance(node, h5py.Dataset):
            raw[name] = _read_dataset(node, path)
            continue
        part = _part_type(field.annotation)
        if part is None or not isinstance(node, h5py.Group):
            raise BadInput(f"{path}: {node.name} is a group where a value belongs; make it anew")
        if get_origin(field.annotation) is dict:
            raw[name] = {key: _read_group(item, part, path) for key, item in _entries(node, path)}
        else:
            raw[name] = _read_group(node, part, path)
    # An empty dict[str, Part] has no group in the file; its default restores it.
    return raw


def _entries(group: h5py.Group, path: Path) -> Iterator[tuple[str, Any]]:
    """(name, group or dataset) in the order of writing; links are refused, never followed."""
    for name in map(str, group):
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise BadInput(f"{path}: {group.name}/{name} is a link; artifacts hold their own data")
        yield name, group[name]


def _read_dataset(node: h5py.Dataset, path: Path) -> Any:
    if node.is_virtual or node.external:
        raise BadInput(
            f"{path}: {node.name} is kept in another file; artifacts hold their own data"
        )
    if node.dtype.hasobject:
        if node.shape != ():
            raise BadInput(f"{path}: {node.name} is not a single text; make it anew")
        return json.loads(str(node.asstr()[()]))
    size = MAX_BYTES + 1 if node.size is None else node.size * node.dtype.itemsize
    if size > min(MAX_BYTES, MAX_RATIO * node.id.get_storage_size()):
        raise BadInput(f"{path}: {node.name} declares {node.shape} entries, more than it can hold")
    return node[()]


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:160]
