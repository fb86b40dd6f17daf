"""Records of arrays as named arrays, and back."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from ropefit.runs.journal import Arrays

R = TypeVar("R")


def as_arrays(record: Any, prefix: str) -> Arrays:
    """Return the fields of a dataclass or named tuple, but those that are None; the prefix ends in
    a dot."""
    found = {name: getattr(record, name) for name in record.__annotations__}
    return {f"{prefix}{name}": np.asarray(v) for name, v in found.items() if v is not None}


def from_arrays(kind: type[R], prefix: str, arrays: Arrays) -> R:
    """Return the record again; fields are arrays or numbers as they are annotated."""
    fields: dict[str, Any] = {}
    for name, annotation in kind.__annotations__.items():
        value = arrays.get(f"{prefix}{name}")
        if value is not None:
            value = value.copy()  # the journal's own stay as they were
            fields[name] = value.item() if str(annotation).startswith("float") else value
    return kind(**fields)


def within(prefix: str, arrays: Arrays) -> Arrays:
    """Return those whose names begin with the prefix, without it."""
    size = len(prefix)
    return {name[size:]: value for name, value in arrays.items() if name.startswith(prefix)}
