"""An experiment as a file: which recordings are made, and which commands ropefit is given on them.

`pipelines/*.toml`; unknown keys are refused.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Angles = tuple[float, float]  # degrees: pitch above the horizontal, yaw


class Strict(BaseModel):
    """Refuses what it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class RopeTable(Strict):
    """The true rope; SI units. EA [N] of infinity does not stretch."""

    length: float = Field(gt=0)
    diameter: float = Field(gt=0)
    mass: float = Field(gt=0)
    EI: float = Field(gt=0)
    EA: float = Field(default=float("inf"), gt=0)
    color: tuple[float, float, float] = (0.90, 0.38, 0.08)


class SweepTable(Strict):
    """End 0 goes away from end 1 and comes back on another way: distances [m], angles [degrees].

    gripper, post: mean pitch and yaw of the rope's direction at end 0 and end 1, from end 0 to end
    1; without them the rope pivots there. swing: how far the gripper turns to each side.
    """

    kind: Literal["sweep"]
    frames: int = Field(ge=4)
    distance: tuple[float, float]
    elevation: float = 0.0
    azimuth: float = 0.0
    gripper: Angles | None = None
    swing: Angles = (0.0, 0.0)
    post: Angles | None = None


class MiddleTable(Strict):
    """Both ends pinned `span` [m] apart; a gripper holds the rope at arc length `at` [m].

    It holds the rope level and moves around `centre` [m], by `reach` [m] to each side, from end 0.
    """

    kind: Literal["middle"]
    frames: int = Field(ge=4)
    span: float
    at: float
    centre: tuple[float, float, float]
    reach: tuple[float, float, float]


Motion = Annotated[SweepTable | MiddleTable, Field(discriminator="kind")]


class CameraTable(Strict):
    """Where the depth camera stands and looks [m]."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]


class Rendered(Strict):
    """A rope moved by a simulator and seen by a depth camera; without a camera only the truth is
    kept. tell_clamps: the recording gives the orientations of ends that are held; marks: arc
    lengths [m] of red bands."""

    kind: Literal["rendered"]
    simulator: Literal["mujoco", "elastica"]
    rope: RopeTable
    motion: Motion
    camera: CameraTable | None = None
    tell_clamps: bool = False
    marks: list[float] = Field(default_factory=list)
    seed: int = 0


class Derived(Strict):
    """A recording made of what a run holds: "shapes", a fitted model's particles as markers;
    "points", the observed points as clouds; "side0" and "side1", those on one side of the gripper.

    where: only frames whose ends are at most this many rope lengths apart. tell_clamps: give the
    orientations that the ends had.
    """

    kind: Literal["shapes", "points", "side0", "side1"]
    run: str
    where: float | None = None
    tell_clamps: bool = False


class RunTable(Strict):
    """Options of each stage on a recording; a stage that is not given is not run. fails: a stage
    whose failure is a result."""

    recording: str
    preprocess: str = ""
    identify: str | None = None
    diagnose: str | None = None
    control: dict[str, str] = Field(default_factory=dict)
    fails: Literal["identify", "diagnose"] | None = None


class TargetTable(Strict):
    """Target shapes: points at arc lengths `at` [m] in some frames of a recording, known to `noise`
    [m] for each axis."""

    recording: str
    frames: list[int]
    at: list[float]
    noise: float


class Experiment(Strict):
    """One experiment of the paper."""

    experiment: Literal["baxter", "dvrk", "shape-control"]
    recordings: dict[str, Annotated[Rendered | Derived, Field(discriminator="kind")]]
    runs: dict[str, RunTable]
    targets: dict[str, TargetTable] = Field(default_factory=dict)


def read(path: Path) -> Experiment:
    """Return the experiment in a file. Raises ValueError with the place of a mistake."""
    return Experiment.model_validate(tomllib.loads(path.read_text()))
