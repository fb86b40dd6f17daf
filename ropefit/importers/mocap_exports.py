"""Tables as Motive, Qualisys Track Manager and Vicon Nexus export them: headers of several rows
before the numbers, Motive's with Y up, Qualisys' in millimetres."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from ropefit.errors import BadInput
from ropefit.importers.tables import Table

UNITS = {
    "m": 1.0, "meters": 1.0, "metres": 1.0, "cm": 0.01, "centimeters": 0.01, "mm": 0.001,
    "millimeters": 0.001, "millimetres": 0.001,
}  # fmt: skip
AXIS = re.compile(r"([xyz])(?: ?[\[(](m|cm|mm)[\])])?", re.IGNORECASE)
MOTIVE_MARKERS = {"", "marker"}  # types of columns; others are rigid bodies and bones


class Capture(NamedTuple):
    """Markers (F, M, 3) by name in the file's unit, time (F,) [s] or None where the file has none.

    scale: metres per unit; up: the axis that points up, where the exporter is known.
    """

    names: list[str]
    time: np.ndarray | None
    positions: np.ndarray
    scale: float = 1.0
    up: str = "z"


def exported(table: Table) -> Capture | None:
    """Return the markers of an export with a header of several rows; None where it is none.

    Raises BadInput where it is one but not whole.
    """
    keys = {row[0].upper(): row[1:] for row in table.rows}
    if "MARKER_NAMES" in keys:
        return _qualisys(table, keys)
    for number, row in enumerate(table.rows[1:], 1):
        if sum(bool(AXIS.fullmatch(cell)) for cell in row) >= 3:
            return _axes_below_names(table, number)
    return None


def _axes_below_names(export: Table, at: int) -> Capture:
    """Return markers whose names stand in a row above X, Y, Z in row `at` (Motive, Vicon, ...)."""
    source, rows = export.source, export.rows
    axes, above = rows[at], rows[:at]
    motive = bool(rows[0]) and rows[0][0].lower() == "format version"
    header = dict(zip(rows[0][::2], rows[0][1::2], strict=False)) if motive else {}
    table = [row + [""] * (len(axes) - len(row)) for row in above[1 if motive else 0 :]]
    kinds, what = [""] * len(axes), [""] * len(axes)
    if motive:  # type, name, id, (parent,) rotation or position
        kinds = next((row for row in table if "Marker" in row), kinds)
        what = next((row for row in table if "Position" in row), what)
        table = [row for row in table if row is not kinds and row is not what]
    table = [row for row in table if any(row[1:])]  # not Vicon's title and rate
    if not table:
        raise BadInput(f"{source}: no row with names above the row {','.join(axes)[:80]}")
    names_row = table[0]
    units: set[str] = set()
    found: dict[str, dict[str, int]] = {}
    name = ""
    for column, cell in enumerate(axes):
        name = names_row[column] or name
        match = AXIS.fullmatch(cell)
        kind = kinds[column].lower()
        if not match or kind not in MOTIVE_MARKERS or what[column] not in ("", "Position"):
            continue
        if kind == "" and motive:
            continue
        if match.group(1).lower() in found.setdefault(name, {}):
            raise BadInput(f"{source}: marker {name or '(without a name)'} occurs twice")
        found[name][match.group(1).lower()] = column
        units |= {match.group(2).lower()} if match.group(2) else set()
    below = {cell.lower() for cell in rows[at + 1] if cell} if len(rows) > at + 1 else set()
    if below and below <= {*UNITS, "s"}:  # a row of units (Vicon)
        units, at = units | below - {"s"}, at + 1
    whole = {key: axes for key, axes in found.items() if len(axes) == 3}
    if not whole:
        raise BadInput(f"{source}: a header of several rows, but no marker with X, Y and Z in it")
    data = export.numbers(at + 1, len(axes))
    positions = np.stack([data[:, [a["x"], a["y"], a["z"]]] for a in whole.values()], axis=1)
    unit = header.get("Length Units", next(iter(units), "m")).lower()
    if unit not in UNITS:
        raise BadInput(f"{source}: lengths in {unit!r}, which is no unit known here")
    return Capture(
        list(whole), _clock(above, axes, data), positions, UNITS[unit], "y" if motive else "z"
    )


def _clock(above: list[list[str]], axes: list[str], data: np.ndarray) -> np.ndarray | None:
    """Return time (F,) [s]: a column named so in any row of the header, or by the rate that Vicon
    writes in its second row; None where there is neither."""
    for row in [axes, *above]:
        named = [c for c, cell in enumerate(row) if cell.lower().startswith("time")]
        if named and named[0] < data.shape[1] and np.isfinite(data[:, named[0]]).all():
            return data[:, named[0]]
    vicon = len(above) > 1 and above[0][:1] == ["Trajectories"]
    if vicon and _is_number(above[1][0]) and float(above[1][0]) > 0:
        return np.arange(len(data)) / float(above[1][0])
    return None


def _qualisys(export: Table, keys: dict[str, list[str]]) -> Capture:
    """Return the markers of a Qualisys TSV: keys, names, then numbers; 0, 0, 0 is not seen."""
    rows = export.rows
    names = [name for name in keys["MARKER_NAMES"] if name]
    start = next((n for n, row in enumerate(rows) if _is_number(row[0])), len(rows))
    before = [cell.lower() for cell in rows[start - 1][:2]] if start else []
    lead = sum(cell in ("frame", "time") for cell in before)
    data = export.numbers(start, lead + 3 * len(names))
    positions = data[:, lead:].reshape(len(data), len(names), 3)
    positions[(positions == 0).all(axis=2)] = np.nan
    time = None
    if "time" in before:
        time = data[:, before.index("time")]
    elif keys.get("FREQUENCY") and _is_number(keys["FREQUENCY"][0]):
        time = np.arange(len(data)) / float(keys["FREQUENCY"][0])
    return Capture(names, time, positions, 0.001)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
