"""checkpoint of a stage that is not done: one that is killed goes on where it was."""

from typing import Annotated, ClassVar

import numpy as np

from ropefit.artifacts.base import ArraySpec, Artifact, Part


class KeptArray(Part):
    """One array of a result, and where it lies in the data: from `start`, as long as its shape and
    type say."""

    result: str
    name: str
    dtype: str
    shape: list[int]
    start: int


class Checkpoint(Artifact):
    """What a stage has found so far; `key` names the code, inputs and settings it belongs to."""

    schema_name: ClassVar[str] = "ropefit-checkpoint"
    schema_version: ClassVar[int] = 2
    file_name: ClassVar[str] = "identify.checkpoint.h5"  # of a stage; others begin with its name
    compressed: ClassVar[bool] = False  # written often, read once

    key: str
    arrays: list[KeptArray]
    data: Annotated[np.ndarray, ArraySpec(("byte",), dtype="uint8")]
