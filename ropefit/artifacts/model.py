"""model.h5: identified parameters with their uncertainty, and the simulation they give."""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ropefit.artifacts.base import ArraySpec, Artifact, Part, quantity

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
    loss_before: float = quantity("m")
    loss_after: float = quantity("m")
    evaluations: int
    converged: bool
    stop_reason: str


class FittedModel(Part):
    """A model of the rope: how it was solved and fitted, and its state in every frame."""

    solver: str
    loss: str
    search: str
    steps: int
    iterations: int
    dt: float = quantity("s")
    compliance: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="alpha of shear, bend [1] and distance [m^2]"
    )
    control_node: int
    fixed_nodes: list[int]
    two_sided: bool
    groups: dict[str, ParameterGroup]

    heldout: Annotated[np.ndarray, ArraySpec(("frame",), dtype="bool")]
    x: Annotated[np.ndarray, ArraySpec(("frame", "node", "xyz"), "m")]
    q: Annotated[np.ndarray, ArraySpec(("frame", "segment", "wxyz"))]
    x_initial: Annotated[np.ndarray, ArraySpec(("frame", "node", "xyz"), "m")]
    residual: Annotated[np.ndarray, ArraySpec(("frame", "node"), "m", nan=True)]
    rms: Annotated[np.ndarray, ArraySpec(("frame",), "m")]  # point to line, 3D
    rms_initial: Annotated[np.ndarray, ArraySpec(("frame",), "m")]
    rms_px: Annotated[np.ndarray, ArraySpec(("frame",), "px")]

    # How far the solver got: sampled along its iterations.
    iteration: Annotated[np.ndarray, ArraySpec(("sample",), dtype="int64")]
    distance_violation: Annotated[np.ndarray, ArraySpec(("frame", "sample"), "m")]
    length_error: Annotated[np.ndarray, ArraySpec(("frame", "sample"))]  # relative
    drift: Annotated[np.ndarray, ArraySpec(("frame",))]  # of length, if iterated twice as long
    drift_allowed: float = quantity("1", "median drift up to which the solver counts as converged")
    solver_converged: bool
    trace: Annotated[np.ndarray, ArraySpec(("step",), "m")]  # loss after every step of the search

    rms_fit: float = quantity("m")
    rms_heldout: float | None = quantity("m", default=None)


class Model(Artifact):
    """All models of one rope; "nominal" is the rod without effects."""

    schema_name: ClassVar[str] = "ropefit-model"
    schema_version: ClassVar[int] = 1
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
