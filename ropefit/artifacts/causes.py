"""Effects as models and diagnoses have them: sizes with intervals, the place, a law's curve."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ropefit.artifacts.base import ArraySpec, Part, quantity


class Size(Part):
    """A number of an effect, with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]


class Curve(Part):
    """A law as a function, with its 95 % band."""

    x: Annotated[np.ndarray, ArraySpec(("value",))]
    y: Annotated[np.ndarray, ArraySpec(("value",))]
    low: Annotated[np.ndarray, ArraySpec(("value",))]
    high: Annotated[np.ndarray, ArraySpec(("value",))]
    unit_x: str
    unit_y: str
    name_x: str
    name_y: str
    visited: tuple[float, float] = Field(description="range of x in the data")


class Law(Part):
    """An unknown function that was found, and what its form is or may be."""

    form: str = Field(description="empty: none is so much better than the others")
    forms: list[str] = Field(description="that remain, best first")
    parameters: dict[str, Size] = Field(  # HDF5 keeps no empty ones
        default_factory=dict, description="constants of the best of them"
    )
    curve: Curve | None = None
    no_curve: str = Field(default="", description="why there is none")


class Cause(Part):
    """An effect that was accepted."""

    name: str
    kind: Literal["physics", "measurement", "solver"]
    variant: str = Field(description="class of the effect in the catalogue")
    end: int | None = None
    arc_length: tuple[float, float] | None = quantity("m", "where it acts", default=None)
    frames: Annotated[np.ndarray, ArraySpec(("member",), dtype="int64")]
    parameters: dict[str, Size]
    values: Annotated[np.ndarray, ArraySpec(("value",))]  # as the effect takes them, SI
    # Of the values, in SI; None in a diagnosis of an earlier version.
    covariance: Annotated[np.ndarray, ArraySpec(("value", "other"))] | None = None
    value_names: list[str]
    equivalent_to: list[str]
    log_evidence: float = Field(description="nats over the model without it")
    p_value: float
    heldout_gain: Annotated[np.ndarray, ArraySpec(("block",))]  # nats
    sentence: str
    law: Law | None = None
