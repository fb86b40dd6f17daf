"""The settings of preprocess and diagnose; those of identify and control have files of their own.

They stand apart from the stages' work so that they can be checked without loading a solver.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

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


# Under which a stage is given what the nominal run has besides its model.
NOMINAL_DIAGNOSIS, NOMINAL_OBSERVATIONS = "nominal_diagnosis", "nominal_observations"


class DiagnoseSettings(StageSettings):
    """seed of the replicates; most_frames used, evenly spread; evaluations of the model at rest,
    after which a search ends; nominal: another run's rope; calibration: another run's camera and
    gravity; simulation: shapes of another simulator."""

    seed: int = 0
    most_frames: int = Field(default=48, ge=4)
    evaluations: int = Field(default=1200, ge=1)
    nominal: bool = False
    calibration: bool = False
    simulation: bool = False
