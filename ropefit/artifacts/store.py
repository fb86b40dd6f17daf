"""Artifacts on disk: HDF5, written atomically, hashed, and read back through their schema.

Layout of a file: the root carries `schema_name`, `schema_version` and `content_sha256`; every
array is a dataset with attributes `unit` and `dims`; every nested part is a group; everything else
is a dataset of JSON text with attribute `encoding = "json"`. Nothing is ever pickled.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import h5py
import numpy as np
from pydantic import BaseModel, ValidationError

from ropefit.artifacts.atomic import write_bytes
from ropefit.artifacts.base import Artifact, array_spec
from ropefit.artifacts.migrations import migrated
from ropefit.errors import BadInput, StageFailed

MAX_BYTES = 4 << 30  # an artifact that declares more than this is refused before allocation
MAX_ENTRIES = 100_000
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
        _add(digest, path, value)
    return digest.hexdigest()


def _add(digest: Any, path: str, value: np.ndarray | str) -> None:
    """One entry of an artifact into its hash."""
    digest.update(path.encode())
    if isinstance(value, str):
        digest.update(value.encode())
    else:
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())


def write(path: Path, artifact: Artifact) -> str:
    """Write atomically: a kill at any instant leaves the old file or the new one. Returns the
    hash."""
    digest = content_sha256(artifact)
    try:
        write_bytes(path, _image(artifact, digest))
    except (OSError, RuntimeError) as error:
        why = getattr(error, "strerror", None) or error
        raise StageFailed(
            f"cannot write {path}: {why}; the previous file is unchanged; free space or give "
            "another --run"
        )
    return digest


def _image(artifact: Artifact, digest: str) -> bytes:
    """The bytes of the file. HDF5 makes them in memory: on a full disk it may end the process."""
    with h5py.File("image", "w", driver="core", backing_store=False, track_order=True) as file:
        file.attrs["schema_name"] = artifact.schema_name
        file.attrs["schema_version"] = artifact.schema_version
        file.attrs["content_sha256"] = digest
        for name, value, attributes in leaves(artifact):
            parent, _, leaf = name.rpartition("/")
            group = _group(file, parent) if parent else file
            dataset = group.create_dataset(leaf, data=value, **_compression(value))
            dataset.attrs.update(attributes)
        file.flush()
        return file.id.get_file_image()


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
    source = _Source(path)
    try:
        with h5py.File(path, "r") as file:
            name, version = _identity(file, path)
            if name != kind.schema_name:
                raise BadInput(f"{path}: holds {name}, expected {kind.schema_name}; {fix}")
            stored = str(file.attrs.get("content_sha256", ""))
            if version == kind.schema_version:
                raw = _read_group(file, kind, source)
            else:
                raw = _read_old(file, kind, version, stored, source, fix)
    except UNREADABLE as error:
        raise BadInput(f"{path}: not a readable HDF5 file ({_one_line(error)}); {fix}")
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
    file: h5py.File, kind: type[Artifact], version: int, stored: str, source: _Source, fix: str
) -> dict[str, Any]:
    """The tree of an earlier version, its hash checked, brought to the present one."""
    digest = hashlib.sha256(f"{kind.schema_name}/{version}".encode())
    contents = _read_any(file, source)
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


def _read_any(group: h5py.Group, source: _Source) -> dict[str, Any]:
    """{name: array, JSON text or tree} of whatever a group holds."""
    return {
        name: _read_value(node, source)
        if isinstance(node, h5py.Dataset)
        else _read_any(node, source)
        for name, node in _entries(group, source)
    }


def _flat(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, np.ndarray | str]]:
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}/")
        else:
            yield f"{prefix}{name}", value


def _parsed(tree: dict[str, Any]) -> dict[str, Any]:
    """The tree with its JSON texts read."""
    return {
        name: _parsed(value)
        if isinstance(value, dict)
        else json.loads(value)
        if isinstance(value, str)
        else value
        for name, value in tree.items()
    }


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


def _read_group(group: h5py.Group, kind: type[BaseModel], source: _Source) -> dict[str, Any]:
    raw: dict[str, Any] = {}
    if not isinstance(group, h5py.Group):
        raise BadInput(f"{source}: {group.name} is a value where a group belongs; make it anew")
    for name, node in _entries(group, source):
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
                key: _read_group(item, part, source) for key, item in _entries(node, source)
            }
        else:
            raw[name] = _read_group(node, part, source)
    # An empty dict[str, Part] has no group in the file; its default restores it.
    return raw


class _Source:
    """A file that is read, and how much of it: links may show one entry under many names."""

    def __init__(self, path: Path):
        self.path, self.entries, self.bytes = path, 0, 0

    def __str__(self) -> str:
        return str(self.path)

    def take(self, node: Any, size: int) -> None:
        """Count an entry of a size [bytes]. Raises BadInput beyond what an artifact may hold."""
        self.entries += 1
        self.bytes += size
        if self.entries > MAX_ENTRIES or self.bytes > MAX_BYTES:
            raise BadInput(f"{self}: declares more than it can hold, at {node.name}")


def _entries(group: h5py.Group, source: _Source) -> Iterator[tuple[str, Any]]:
    """(name, group or dataset) in the order of writing; links are refused, never followed."""
    for name in map(str, group):
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise BadInput(
                f"{source}: {group.name}/{name} is a link; artifacts hold their own data"
            )
        source.take(group, 0)
        yield name, group[name]


def _read_dataset(node: h5py.Dataset, source: _Source) -> Any:
    value = _read_value(node, source)
    return json.loads(value) if isinstance(value, str) else value


def _read_value(node: h5py.Dataset, source: _Source) -> np.ndarray | str:
    """An array or a JSON text; refused before anything is allocated that is not there."""
    if node.is_virtual or node.external:
        raise BadInput(
            f"{source}: {node.name} is kept in another file; artifacts hold their own data"
        )
    if node.dtype.hasobject:
        if node.shape != ():
            raise BadInput(f"{source}: {node.name} is not a single text; make it anew")
        return str(node.asstr()[()])
    size = MAX_BYTES + 1 if node.size is None else node.size * node.dtype.itemsize
    if size > min(MAX_BYTES, MAX_RATIO * node.id.get_storage_size()):
        raise BadInput(
            f"{source}: {node.name} declares {node.shape} entries, more than it can hold"
        )
    source.take(node, size)
    return node[()]


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:160]
