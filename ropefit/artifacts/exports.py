"""exports.h5: which simulators a rope was written for, and where it comes to rest in them."""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ropefit.artifacts.base import ArraySpec, Artifact, Part, quantity


class Check(Part):
    """The exported rope at rest in the simulator."""

    simulator: str = Field(description="name and version")
    x: Annotated[np.ndarray, ArraySpec(("pose", "node", "xyz"), "m", nan=True)]
    failures: list[str] = Field(description="of every pose, why it has no shape; empty if it has")

    @model_validator(mode="after")
    def _one_a_pose(self) -> "Check":
        if len(self.failures) != len(self.x):
            raise ValueError(f"{len(self.failures)} failures for {len(self.x)} poses")
        return self


class Export(Part):
    """One file, in poses of the recording."""

    file: str
    sha256: str = Field(description="of the file")
    frames: Annotated[np.ndarray, ArraySpec(("pose",), dtype="int64")]
    x: Annotated[np.ndarray, ArraySpec(("pose", "node", "xyz"), "m")]  # ropefit's own equilibrium
    other: Annotated[
        np.ndarray, ArraySpec(("pose",), "m", nan=True)
    ]  # how far away a second stable equilibrium is known; NaN: none
    effects: list[str] = Field(description="the effects of the diagnosis that are expressed")
    notes: list[str] = Field(description="what the target cannot express")
    check: Check | None = None

    @model_validator(mode="after")
    def _same_nodes(self) -> "Export":
        if self.check is not None and self.check.x.shape != self.x.shape:
            raise ValueError(f"checked {self.check.x.shape}, exported {self.x.shape}")
        return self


class Exports(Artifact):
    """The latest export to every target."""

    schema_name: ClassVar[str] = "ropefit-exports"
    schema_version: ClassVar[int] = 1
    file_name: ClassVar[str] = "exports.h5"

    length: float = quantity("m", gt=0)
    exports: dict[str, Export]


def deviation(export: Export, length: float) -> np.ndarray:
    """Return (pose,) largest distance of a node from where it belongs, in rope lengths; NaN: no
    shape."""
    if export.check is None:
        return np.full(len(export.frames), np.nan)
    away = np.linalg.norm(export.check.x - export.x, axis=-1)
    known = np.isfinite(away).any(axis=1)
    return np.where(known, np.nanmax(np.where(np.isfinite(away), away, -1.0), axis=1), np.nan) / (
        length
    )
