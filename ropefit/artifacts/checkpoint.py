"""checkpoint of a search that is not done: a killed identify goes on where it was."""

from typing import Annotated, ClassVar

import numpy as np

from ropefit.artifacts.base import ArraySpec, Artifact


class Checkpoint(Artifact):
    """Everything a batched search knows; `key` names the inputs and settings it belongs to."""

    schema_name: ClassVar[str] = "ropefit-checkpoint"
    schema_version: ClassVar[int] = 1
    file_name: ClassVar[str] = "identify.checkpoint.h5"

    key: str
    u: Annotated[np.ndarray, ArraySpec(("row_", "unknown"), nan=True)]
    loss: Annotated[np.ndarray, ArraySpec(("row_",), nan=True)]
    gradient: Annotated[np.ndarray, ArraySpec(("row_", "unknown"), nan=True)]
    inverse: Annotated[np.ndarray, ArraySpec(("row_", "unknown", "unknown"), nan=True)]
    status: Annotated[np.ndarray, ArraySpec(("row_",), dtype="int64")]
    calm: Annotated[np.ndarray, ArraySpec(("row_",), dtype="int64")]
    evaluations: int
    trace: Annotated[np.ndarray, ArraySpec(("step", "row_"), nan=True)]
