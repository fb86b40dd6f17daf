"""model.h5: identified parameters with their uncertainty, and the simulation they give."""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ropefit.artifacts.base import ArraySpec, Artifact, Part, quantity
from ropefit.artifacts.causes import Cause

Verdict = Literal[
    "fixed", "determined", "trade-off", "flat direction", "dead", "at bound", "not converged"
]


class Parameter(Part):
    """One identified number. It never stands alone: interval and verdict belong to it."""

    meaning: str
    unit: str = "1"
    initial: float
    value: float
    lower: float
    upper: float
    free: bool
    verdict: Verdict
    ci95: tuple[float, float] | None = Field(
        default=None, description="Student-t interval; null when fixed or infinite"
    )
    below: float | None = Field(
        default=None, description="95 % upper limit, where no lower one is determined"
    )
    trades_with: list[str] = Field(default_factory=list)


class ParameterGroup(Part):
    """One parameter set and the frames that it was fitted to and is used for."""

    frames: Annotated[np.ndarray, ArraySpec(("member",), dtype="int64")]
    parameters: dict[str, Parameter]
    free_names: list[str]
    correlation: Annotated[
        np.ndarray, ArraySpec(("free", "free_"), nan=True)
    ]  # NaN along directions the data do not determine
    condition: float | None = Field(
        default=None,
        description="condition number of the scaled sensitivity matrix; null when singular",
    )
    loss_before: float
    loss_after: float
    loss_unit: Literal["m", "chi-square"] = "m"
    evaluations: int
    converged: bool
    stop_reason: str


class Iterated(Part):
    """How far a solver of the paper got: sampled along its iterations."""

    steps: int
    iterations: int
    dt: float = quantity("s")
    compliance: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="alpha of shear, bend [1] and distance [m^2]"
    )
    iteration: Annotated[np.ndarray, ArraySpec(("sample",), dtype="int64")]
    distance_violation: Annotated[np.ndarray, ArraySpec(("frame", "sample"), "m")]
    length_error: Annotated[np.ndarray, ArraySpec(("frame", "sample"))]  # relative
    drift: Annotated[np.ndarray, ArraySpec(("frame",))]  # of length, if iterated twice as long
    drift_allowed: float = quantity("1", "median drift up to which the solver counts as converged")


class Calibration(Part):
    """An error of the set-up, fitted along with the rope under its prior."""

    unit: str
    prior: float = Field(description="one sigma that was assumed")
    value: float
    sd: float


class Balance(Part):
    """How the equilibria were found, and whether they are stable."""

    segments: int = Field(description="of the rod that was solved; nodes are some of its nodes")
    newton: Annotated[np.ndarray, ArraySpec(("frame",), dtype="int64")]  # iterations
    residual: Annotated[np.ndarray, ArraySpec(("frame",))]  # of moments and length, relative
    converged: Annotated[np.ndarray, ArraySpec(("frame",), dtype="bool")]
    stability: Annotated[np.ndarray, ArraySpec(("frame",), "N", nan=True)]  # smallest eigenvalue
    other: Annotated[np.ndarray, ArraySpec(("frame",), "m", nan=True)]  # distance of another state
    mass_known: bool = Field(description="false: rigidities are those of 1 kg/m, ratios only")
    bending_length: float = quantity("m", "(EI / weight per length)^(1/3)")
    calibration: dict[str, Calibration] = Field(default_factory=dict)
    correlated_noise: float = quantity("m", "sd of the part correlated along the rope", default=0.0)
    correlation_length: float = quantity("m", default=0.0)


class Stepped(Part):
    """How the rope in motion was simulated: clip by clip, open loop from its first two frames."""

    segments: int = Field(description="of the rod that was solved; nodes are some of its nodes")
    clips: int
    clip: Annotated[np.ndarray, ArraySpec(("frame",), dtype="int64")]  # -1: too short a clip
    newton: Annotated[np.ndarray, ArraySpec(("frame",), dtype="int64")]  # iterations of a step
    mass_known: bool = Field(description="false: all is stated over the weight per length")
    bending_length: float = quantity("m", "(EI / weight per length)^(1/3)")
    calibration: dict[str, Calibration] = Field(default_factory=dict)


class FittedModel(Part):
    """A model of the rope: how it was solved and fitted, and its state in every frame."""

    solver: str
    loss: str
    search: str
    control_node: int
    fixed_nodes: list[int]
    two_sided: bool
    groups: dict[str, ParameterGroup]
    laws: dict[str, Cause] = Field(
        default_factory=dict, description="that were asked for, fitted along with the parameters"
    )

    heldout: Annotated[np.ndarray, ArraySpec(("frame",), dtype="bool")]
    x: Annotated[np.ndarray, ArraySpec(("frame", "node", "xyz"), "m")]
    q: Annotated[np.ndarray, ArraySpec(("frame", "segment", "wxyz"))]
    x_initial: Annotated[np.ndarray, ArraySpec(("frame", "node", "xyz"), "m")]
    residual: Annotated[np.ndarray, ArraySpec(("frame", "node"), "m", nan=True)]
    rms: Annotated[np.ndarray, ArraySpec(("frame",), "m")]  # point to line, 3D
    rms_initial: Annotated[np.ndarray, ArraySpec(("frame",), "m")]
    rms_px: Annotated[np.ndarray, ArraySpec(("frame",), "px")]

    solver_converged: bool
    iterated: Iterated | None = Field(default=None, description="solvers of the paper")
    balance: Balance | None = Field(default=None, description="the equilibrium solver")
    stepped: Stepped | None = Field(default=None, description="the dynamics")
    trace: Annotated[np.ndarray, ArraySpec(("step",))]  # loss [m] or chi-square along the search

    rms_fit: float = quantity("m")
    rms_heldout: float | None = quantity("m", default=None)


class Model(Artifact):
    """All models of one rope; "nominal" is the rod without effects."""

    schema_name: ClassVar[str] = "ropefit-model"
    schema_version: ClassVar[int] = 4
    file_name: ClassVar[str] = "model.h5"

    recording: str
    length: float = quantity("m", gt=0)
    frames: Annotated[np.ndarray, ArraySpec(("frame",), dtype="int64")]
    models: dict[str, FittedModel]

    @model_validator(mode="after")
    def _has_nominal(self) -> Self:
        if "nominal" not in self.models:
            raise ValueError('models holds no "nominal"')
        return self

    @property
    def nominal(self) -> FittedModel:
        return self.models["nominal"]
