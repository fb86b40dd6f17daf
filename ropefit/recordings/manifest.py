"""recording.toml: the pydantic picture of DESIGN's recording format, version 1."""

from __future__ import annotations

import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from ropefit.errors import BadInput

FORMAT = "ropefit-recording/1"
MIN_MASS, MAX_MASS = 1e-9, 1e4  # kg
MAX_LENGTH = 100.0  # m; longer ropes are almost surely millimetres
MOST_FITTINGS = 100
COARSEST_DEPTH = 0.1  # m per unit of a depth image; above it was given the wrong way round
MAX_DIAMETER = 1.0  # m; so are thicker ones
Finite = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Sigma = Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]  # beyond: no prior at all


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class RopeTable(_Table):
    """What is known of the rope: SI units, all optional."""

    length: Positive | None = None
    diameter: Positive | None = None
    mass: Positive | None = None
    mass_per_length: Positive | None = None

    def whole_mass(self, length: float) -> float | None:
        """Return the mass [kg] of a rope of this length [m], None where it is not known."""
        return self.mass_per_length * length if self.mass_per_length else self.mass

    @property
    def mass_known(self) -> bool:
        return self.mass is not None or self.mass_per_length is not None

    @model_validator(mode="after")
    def _one_mass(self) -> RopeTable:
        if self.mass and self.mass_per_length:
            raise ValueError("give mass or mass_per_length, not both")
        return self

    @field_validator("length", "diameter")
    @classmethod
    def _metres(cls, value: float | None, info: ValidationInfo) -> float | None:
        most, what = (
            (MAX_LENGTH, "long") if info.field_name == "length" else (MAX_DIAMETER, "thick")
        )
        if value is not None and value > most:
            raise ValueError(
                f"a rope {value:g} m {what}; lengths are in metres, were millimetres given?"
            )
        return value

    @field_validator("mass")
    @classmethod
    def _kilograms(cls, value: float | None) -> float | None:
        if value is not None and not MIN_MASS <= value <= MAX_MASS:
            raise ValueError(f"a rope of {value:g} kg; the mass is in kilograms, of the whole rope")
        return value


class EndsTable(_Table):
    """Poses of the ends: a file, or the markers held at each end.

    arc_length [m]: where on the rope they are held, if there is rope beyond them.
    """

    file: str | None = None
    markers: tuple[list[int], list[int]] | None = None
    arc_length: tuple[NotNegative, NotNegative] | None = None

    @model_validator(mode="after")
    def _one_of(self) -> EndsTable:
        if (self.file is None) == (self.markers is None):
            raise ValueError("give either file or markers")
        if self.markers and any(len(held) > 2 for held in self.markers):
            raise ValueError("at most two held markers an end: the end itself and its neighbour")
        if self.arc_length and self.arc_length[0] >= self.arc_length[1]:
            raise ValueError("arc_length must increase from end 0 to end 1")
        return self


class CloudsTable(_Table):
    pattern: str
    viewpoint: tuple[Finite, Finite, Finite] | None = None
    crop: tuple[tuple[Finite, Finite, Finite], tuple[Finite, Finite, Finite]] | None = None

    @field_validator("crop")
    @classmethod
    def _box(cls, value: tuple[Any, Any] | None) -> tuple[Any, Any] | None:
        if value is not None and any(low >= high for low, high in zip(*value, strict=True)):
            raise ValueError("crop is [lowest corner, highest corner], in metres")
        return value


class Intrinsics(_Table):
    width: int = Field(gt=0, le=20000)
    height: int = Field(gt=0, le=20000)
    fx: Positive
    fy: Positive
    cx: Finite
    cy: Finite


class RgbdTable(_Table):
    color: str
    depth: str | None = None
    depth_scale: Positive = 0.001
    intrinsics: Intrinsics
    camera_pose: list[list[Finite]] = Field(default_factory=lambda: np.eye(4).tolist())

    @field_validator("depth_scale")
    @classmethod
    def _fine(cls, value: float) -> float:
        if value > COARSEST_DEPTH:
            raise ValueError(f"{value:g} m per unit; it is 0.001 where a unit is a millimetre")
        return value

    @field_validator("camera_pose")
    @classmethod
    def _rigid(cls, value: list[list[float]]) -> list[list[float]]:
        if len(value) != 4 or any(len(row) != 4 for row in value):
            raise ValueError("camera_pose must be 4 rows of 4 numbers")
        pose = np.array(value)
        rotation = pose[:3, :3]
        rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)
        if not rigid or np.linalg.det(rotation) < 0 or not np.allclose(pose[3], [0, 0, 0, 1]):
            raise ValueError("camera_pose is not a rigid transform (recording <- camera)")
        return value


class MarkersTable(_Table):
    file: str
    arc_length: list[Finite] | None = None
    offset: Sigma | None = None  # m: one sigma of how far they lie off the rope's axis

    @field_validator("arc_length")
    @classmethod
    def _increasing(cls, value: list[float] | None) -> list[float] | None:
        if value is not None and any(b <= a for a, b in pairwise(value)):
            raise ValueError("arc_length must increase from end 0 to end 1")
        return value


class FittingTable(_Table):
    """A rigid piece on the rope: an end piece, a gland, a clip; without a length, a point."""

    arc_length: float = Field(ge=0, allow_inf_nan=False)  # m, of its middle
    length: float = Field(default=0.0, ge=0, allow_inf_nan=False)
    mass: float = Field(default=0.0, ge=0, le=MAX_MASS)  # kg, besides the rope's


class PriorsTable(_Table):
    """One-sigma uncertainty of the set-up; degrees, metres, seconds, kilograms."""

    camera_rotation: Sigma | None = None
    camera_translation: Sigma | None = None
    scale: Sigma | None = None
    depth_gain: Sigma | None = None
    gravity: Sigma | None = None
    end_position: Sigma | None = None
    end_orientation: Sigma | None = None
    time_lag: Sigma | None = None
    length: Sigma | None = None
    mass: Sigma | None = None
    marker_noise: Sigma | None = None  # per coordinate; measured from the markers if not given


class Manifest(_Table):
    """The whole of recording.toml."""

    format: Literal["ropefit-recording/1"]
    name: str = Field(min_length=1, max_length=200)
    gravity: tuple[Finite, Finite, Finite] = (0.0, 0.0, -9.81)
    rope: RopeTable = RopeTable()
    ends: EndsTable | None = None
    clouds: CloudsTable | None = None
    rgbd: RgbdTable | None = None
    markers: MarkersTable | None = None
    fittings: list[FittingTable] = Field(default_factory=list, max_length=MOST_FITTINGS)
    priors: PriorsTable = PriorsTable()

    @model_validator(mode="after")
    def _has_data(self) -> Manifest:
        if not (self.clouds or self.rgbd or self.markers):
            raise ValueError("no [clouds], [rgbd] or [markers]: at least one is needed")
        if np.linalg.norm(self.gravity) > 1000:
            raise ValueError("gravity beyond 1000 m/s^2; it is in m/s^2")
        if self.ends and self.ends.markers and not self.markers:
            raise ValueError("[ends] markers needs a [markers] table")
        if any(f.mass for f in self.fittings) and not self.rope.mass_known:
            raise ValueError("the mass of [[fittings]] needs that of the rope ([rope] mass)")
        length = self.rope.length
        held = self.ends and self.ends.arc_length
        if held and (length is None or held[1] > 1.001 * length):
            raise ValueError("[ends] arc_length needs [rope] length, and lies on the rope")
        if length and any(f.arc_length + 0.5 * f.length > 1.001 * length for f in self.fittings):
            raise ValueError(f"[[fittings]] reach beyond the rope's end at {length:g} m")
        return self


def read_manifest(directory: Path) -> Manifest:
    """Read and check recording.toml. Raises BadInput with the key at fault."""
    path = directory / "recording.toml"
    if not directory.is_dir():
        raise BadInput(f"{directory}: no such recording directory; give one with a recording.toml")
    if not path.exists():
        raise BadInput(f"{directory}: has no recording.toml; see docs/recording-format.md")
    try:
        return Manifest.model_validate(read_toml(path))
    except ValidationError as error:
        raise BadInput(f"{path}: {describe(error)}")


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file. Raises BadInput."""
    try:
        if path.stat().st_size > 1 << 20:
            raise BadInput(f"{path}: larger than 1 MB, not a description in TOML")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BadInput(f"{path}: no such file; correct its name")
    except (
        OSError,
        ValueError,
        RecursionError,
    ) as error:  # TOML and Unicode errors are ValueErrors
        raise BadInput(f"{path}: not readable as TOML ({error}); correct it")


def describe(error: ValidationError) -> str:
    """Return the first problem of a pydantic error in one line: key, what is wrong."""
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"]) or "file"
    if first["type"] == "extra_forbidden":
        return f"unknown key {where}; remove it or correct its spelling"
    if where == "format":
        return f"format must be {FORMAT!r}, got {str(first['input'])[:60]!r}"
    message = first["msg"].removeprefix("Value error, ")
    return f"{where}: {message}"


def inside(directory: Path, name: str) -> Path:
    """Return the path of a file named by a recording; it must lie inside the recording's
    directory."""
    path = directory / name
    try:
        outside = not path.resolve().is_relative_to(directory.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # links in a circle, NUL in a name
        raise BadInput(f"{directory}: {name!r} names no file ({error}); correct it")
    if outside or Path(name).is_absolute():
        raise BadInput(f"{directory}: {name} lies outside the recording; copy the file into it")
    return path
