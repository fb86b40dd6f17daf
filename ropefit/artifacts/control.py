"""control.h5: where the gripper was (estimate) or where it must go (shape)."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ropefit.artifacts.base import ArraySpec, Artifact, quantity


class Control(Artifact):
    """Control-point poses, the ropes they give, and their deviations.

    In an estimate a case is a frame; in shape control a case is a target shape.
    """

    schema_name: ClassVar[str] = "ropefit-control"
    schema_version: ClassVar[int] = 1
    file_name: ClassVar[str] = "control.h5"

    kind: Literal["estimate", "shape"]
    loss_name: str
    solver: str
    control_node: int
    moves_orientation: bool
    cases: Annotated[np.ndarray, ArraySpec(("case",), dtype="int64")]
    start: Annotated[np.ndarray, ArraySpec(("case", "xyz"), "m")]
    position: Annotated[np.ndarray, ArraySpec(("case", "xyz"), "m")]
    orientation: Annotated[np.ndarray, ArraySpec(("case", "wxyz"), nan=True)]
    reference: Annotated[
        np.ndarray, ArraySpec(("case", "xyz"), "m", nan=True)
    ]  # recorded control point; NaN where none is known
    deviation: Annotated[np.ndarray, ArraySpec(("case",), "m", nan=True)]
    deviation_px: Annotated[np.ndarray, ArraySpec(("case",), "px", nan=True)]
    loss: Annotated[np.ndarray, ArraySpec(("case",))]
    obj1: Annotated[np.ndarray, ArraySpec(("case",), "m", nan=True)]  # the paper's common yardstick
    position_sd: Annotated[np.ndarray, ArraySpec(("case", "xyz"), "m", nan=True)]
    converged: Annotated[np.ndarray, ArraySpec(("case",), dtype="bool")]
    x: Annotated[np.ndarray, ArraySpec(("case", "node", "xyz"), "m")]
    q: Annotated[np.ndarray, ArraySpec(("case", "segment", "wxyz"))]
    length_error: Annotated[np.ndarray, ArraySpec(("case",))]

    # Key points: places on the rope that are predicted but not fitted (estimate), or targets
    # (shape).
    key_arc: Annotated[np.ndarray, ArraySpec(("case", "key"), "m", nan=True)]
    key_position: Annotated[np.ndarray, ArraySpec(("case", "key", "xyz"), "m", nan=True)]
    key_reference: Annotated[np.ndarray, ArraySpec(("case", "key", "xyz"), "m", nan=True)]
    key_deviation: Annotated[np.ndarray, ArraySpec(("case", "key"), "m", nan=True)]
    key_deviation_px: Annotated[np.ndarray, ArraySpec(("case", "key"), "px", nan=True)]

    length: float = quantity("m", gt=0)
    notes: list[str] = Field(default_factory=list)
