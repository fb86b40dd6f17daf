"""CSV tables of a recording: header checked, every entry a number, the line at fault named."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput


def read_table(
    path: Path, required: list[str], optional: list[str] | None = None, nan: bool = False
) -> dict[str, np.ndarray]:
    """Return columns of a CSV file as float64 arrays (rows,).

    Optional columns are missing from the result when the file lacks them; an empty cell in one
    reads as NaN. NaN in a required column is an error unless `nan`. Raises BadInput.
    """
    optional = optional or []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = [cell.strip() for cell in next(reader, [])]
            if len(set(header)) < len(header):
                raise BadInput(f"{path}: header names a column twice: {','.join(header)[:200]}")
            missing = [name for name in required if name not in header]
            unknown = [name for name in header if name not in required + optional]
            if missing or unknown:
                what = f"lacks {', '.join(missing)}" if missing else f"unknown {', '.join(unknown)}"
                raise BadInput(f"{path}: header {what}; expected {','.join(required + optional)}")
            rows = [_numbers(path, reader.line_num, header, row, required) for row in reader if row]
    except FileNotFoundError:
        raise BadInput(f"{path}: no such file; correct its name or add it")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: not readable as CSV ({error})")
    if not rows:
        raise BadInput(f"{path}: has no rows")
    columns = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    for name, column in columns.items():
        may_miss = nan or name not in required
        bad = np.isinf(column) if may_miss else ~np.isfinite(column)
        if bad.any():
            raise BadInput(f"{path}: column {name}, row {int(np.argmax(bad)) + 2}: not a number")
    return columns


def _numbers(
    path: Path, line: int, header: list[str], row: list[str], required: list[str]
) -> list[float]:
    if len(row) != len(header):
        raise BadInput(f"{path}: line {line} has {len(row)} cells, the header {len(header)}")
    values = []
    for name, cell in zip(header, row, strict=True):
        try:
            values.append(float(cell) if cell.strip() or name in required else float("nan"))
        except ValueError:
            raise BadInput(f"{path}: line {line}, column {name}: {cell[:40]!r} is not a number")
    return values


def whole(path: Path, name: str, column: np.ndarray) -> np.ndarray:
    """Return a column as int64; raises BadInput where an entry is no whole number."""
    bad = (column != np.round(column)) | (np.abs(column) > 2**53)
    if bad.any():
        raise BadInput(f"{path}: column {name}, row {int(np.argmax(bad)) + 2}: not a whole number")
    return column.astype(np.int64)
