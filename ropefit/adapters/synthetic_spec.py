"""What a synthetic recording is made of: the tables of SPEC.toml."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ropefit.models.weights import ETA, RANGES

Point = tuple[float, float, float]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RopeSpec(_Table):
    """length, diameter [m], mass [kg], particles."""

    length: float = Field(gt=0, le=100)
    diameter: float = Field(default=0.008, gt=0, le=1)
    mass: float | None = Field(default=None, gt=0)
    nodes: int = Field(default=20, ge=4, le=400)


class EndSpec(_Table):
    """Waypoints [m] that an end passes, evenly in time; tangents (not normalised) clamp it."""

    path: list[Point] = Field(min_length=1)
    tangents: list[Point] | None = None


class MotionSpec(_Table):
    """frames at `interval` [s]; an end that is not given is free."""

    frames: int = Field(ge=1, le=100_000)
    interval: float = Field(default=1.0, gt=0)
    end0: EndSpec | None = None
    end1: EndSpec | None = None

    @model_validator(mode="after")
    def _held(self) -> MotionSpec:
        if self.end0 is None and self.end1 is None:
            raise ValueError("give at least one of end0, end1: a rope with two free ends falls")
        return self


class ModelSpec(_Table):
    """The paper's model: solver, weights, steps x iterations; or the rope of a run, with the laws
    and causes that were found. run: its folder, from where the description is."""

    solver: Literal["jacobi", "thomas"] = "thomas"
    run: str = ""
    eta: dict[str, float] = Field(default_factory=dict)
    steps: int = Field(default=50, ge=1, le=1000)
    iterations: int = Field(default=20, ge=1, le=100_000)
    dt: float = Field(default=0.1, gt=0)

    @model_validator(mode="after")
    def _known(self) -> ModelSpec:
        for name, value in self.eta.items():
            if name not in ETA:
                raise ValueError(f"unknown weight {name}; one of {', '.join(ETA)}")
            _, low, high = RANGES[name]
            if not low <= value <= high:
                raise ValueError(f"{name} = {value:g} is outside {low:g}..{high:g}")
        if self.run and self.model_fields_set != {"run"}:
            raise ValueError("run: a fitted rope is simulated by its own solver; give nothing else")
        return self


class SensorSpec(_Table):
    """clouds: `points` a frame on the tube's surface that faces `viewpoint`; markers: `points`
    evenly.

    noise, end_noise [m]; outliers: share of points; occluded: arc-length intervals [m] never seen.
    """

    kind: Literal["clouds", "markers"] = "clouds"
    points: int = Field(default=1000, ge=2, le=1_000_000)
    noise: float = Field(default=0.001, ge=0)
    end_noise: float = Field(default=0.0, ge=0)
    outliers: float = Field(default=0.0, ge=0, lt=0.5)
    occluded: list[tuple[float, float]] = Field(default_factory=list)
    viewpoint: Point | None = None
    seed: int = 0


class SimulationSpec(_Table):
    """The whole of SPEC.toml."""

    format: Literal["ropefit-simulation/1"]
    name: str = Field(min_length=1, max_length=200)
    gravity: Point = (0.0, 0.0, -9.81)
    rope: RopeSpec | None = None
    motion: MotionSpec
    model: ModelSpec = ModelSpec()
    sensor: SensorSpec = SensorSpec()

    @property
    def matter(self) -> RopeSpec:
        """Return the rope that is described, or that of the run once it is filled in."""
        assert self.rope is not None
        return self.rope

    @model_validator(mode="after")
    def _one_rope(self) -> SimulationSpec:
        if self.model.run and ({"rope", "gravity"} & self.model_fields_set):
            raise ValueError("rope and gravity are those of model.run: leave them out")
        if not self.model.run and self.rope is None:
            raise ValueError("give [rope], or the folder of a run: [model] run")
        return self
