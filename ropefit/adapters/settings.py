"""The settings of preprocess, diagnose and control; those of identify are in their own file.

They stand apart from the stages' work so that they can be checked without loading a solver.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from ropefit.losses.names import LossName
from ropefit.runs.protocol import StageSettings


class PreprocessSettings(StageSettings):
    """nodes: K, the number of particles and segment boundaries. project: onto the hanging plane.

    Of pictures: color (r, g, b) of the rope; roi (u, v, width, height) [px] that it is in; mask: a
    folder of masks.
    """

    nodes: int = Field(default=20, ge=4, le=400)
    project: Literal["auto", "yes", "no"] = "auto"
    most_points: int = Field(default=400, ge=20, le=20_000)
    color: tuple[int, int, int] | None = None
    roi: tuple[int, int, int, int] | None = None
    mask: str | None = None


NOMINAL_DIAGNOSIS = "nominal_diagnosis"  # under which a stage is given that of the nominal run


class DiagnoseSettings(StageSettings):
    """seed of the replicates; most_frames used, evenly spread; nominal: another run's rope;
    calibration: another run's camera and gravity; simulation: shapes of another simulator."""

    seed: int = 0
    most_frames: int = Field(default=48, ge=4)
    nominal: bool = False
    calibration: bool = False
    simulation: bool = False


class ControlSettings(StageSettings):
    """loss for an estimate; key: arc lengths [m] of key points to predict; turn: also the
    orientation."""

    loss: LossName = "OBJ1"
    key: list[float] = Field(default_factory=list)
    turn: bool | None = None  # None: not in an estimate, yes in shape control
    evaluations: int = Field(default=200, ge=1)
    target: bool = False

    def used(self) -> dict[str, Any]:
        """Return the settings that the output depends on: a target replaces loss and key points."""
        return {
            name: value
            for name, value in super().used().items()
            if not (self.target and name in ("loss", "key"))
        }
