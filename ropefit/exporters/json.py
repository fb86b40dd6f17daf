"""Neutral JSON: everything an exporter is given, for simulators that have no exporter yet."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any, ClassVar

import numpy as np

from ropefit.exporters.base import Exporter, ExportResult
from ropefit.exporters.description import RopeDescription

FORMAT = "ropefit-rope/1"
UNITS = {
    "length": "m", "rest_lengths": "m", "EA": "N", "GA": "N", "EI": "N m^2", "GJ": "N m^2",
    "rest_curvature": "1/m", "rest_twist": "1/m", "masses": "kg", "diameter": "m",
    "gravity": "m/s^2", "end_positions": "m", "x": "m",
    "end_orientations": "quaternion w x y z, R(q) e3 = tangent from end 0 to end 1",
}  # fmt: skip


class Json(Exporter):
    """One JSON object; a number that is not there or not finite (NaN, inf) is null."""

    target: ClassVar[str] = "json"
    suffix: ClassVar[str] = ".json"

    def export(self, rope: RopeDescription) -> ExportResult:
        data: dict[str, Any] = {"format": FORMAT, "units": UNITS}
        for field in fields(rope):
            data[field.name] = _plain(getattr(rope, field.name))
        data["effects"] = [
            {"kind": type(effect).__name__, **_plain(vars(effect))} for effect in rope.effects
        ]
        return ExportResult(json.dumps(data, indent=1, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
