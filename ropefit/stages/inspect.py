"""inspect: what an artifact or a run holds, valid or why not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from ropefit.artifacts import ARTIFACTS, Artifact, identity, read
from ropefit.artifacts.store import leaves
from ropefit.errors import BadInput, RopefitError
from ropefit.runs.loading import load
from ropefit.runs.run_directory import PRODUCERS, existing_run


def inspect_path(path: Path) -> dict[str, Any]:
    """Return {"path", "artifacts": [{file, schema, version, valid, problem, entries}]}. Raises
    BadInput."""
    if not path.exists():
        raise BadInput(f"{path}: no such file or directory; give an artifact or a run")
    if path.is_file():
        return {"path": str(path), "artifacts": [_describe(path, path.parent)]}
    run = existing_run(path)
    present = [run / name for name in PRODUCERS if (run / name).exists()]
    return {"path": str(path), "artifacts": [_describe(item, run) for item in present]}


def _describe(path: Path, run: Path) -> dict[str, Any]:
    schema, version = "?", 0
    try:
        schema, version = identity(path)
        kind = next((k for k in ARTIFACTS if k.schema_name == schema), None)
        if kind is None:
            raise BadInput(f"{path}: unknown schema {schema}; written by another ropefit?")
        if path.name == kind.file_name and path.name in PRODUCERS:
            artifact, digest = load(run, kind)
        else:
            artifact, digest = read(path, kind)
    except RopefitError as error:
        return {
            "file": path.name,
            "schema": schema,
            "version": version,
            "valid": False,
            "problem": str(error),
            "exit_code": error.exit_code,
            "entries": [],
        }
    return {
        "file": path.name,
        "schema": schema,
        "version": version,
        "valid": True,
        "problem": "",
        "sha256": digest,
        "entries": entries(artifact),
    }


def entries(artifact: Artifact | BaseModel) -> list[dict[str, str]]:
    """Return one row an entry: name, shape with dimension names, unit, value or range."""
    rows = []
    for name, value, attributes in leaves(artifact):
        if isinstance(value, str):
            shape, text = "", value if len(value) <= 60 else value[:57] + "..."
        else:
            dims = attributes["dims"]
            shape = " x ".join(f"{d} {n}" for d, n in zip(dims, value.shape, strict=True))
            text = _range(np.asarray(value))
        unit = attributes.get("unit", "")
        rows.append({"name": name, "shape": shape, "unit": unit, "value": text})
    return rows


def _range(value: np.ndarray) -> str:
    if value.size == 0:
        return "empty"
    if value.dtype.kind == "b":
        return f"{int(value.sum())} of {value.size} true"
    finite = value[np.isfinite(value)]
    if finite.size == 0:
        return "all NaN"
    text = f"{finite.min():.4g} .. {finite.max():.4g}"
    missing = value.size - finite.size
    return f"{text}, {missing} NaN" if missing else text
