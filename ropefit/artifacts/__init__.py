"""Schemas of everything a run holds, and the store that keeps them."""

from ropefit.artifacts.base import Artifact, Part, Provenance
from ropefit.artifacts.checkpoint import Checkpoint
from ropefit.artifacts.control import Control
from ropefit.artifacts.diagnosis import Diagnosis
from ropefit.artifacts.exports import Exports
from ropefit.artifacts.model import (
    Balance,
    Calibration,
    FittedModel,
    Iterated,
    Model,
    Parameter,
    ParameterGroup,
    Stepped,
)
from ropefit.artifacts.observations import DroppedFrame, Observations, View
from ropefit.artifacts.store import content_sha256, identity, read, write

ARTIFACTS: tuple[type[Artifact], ...] = (
    Observations,
    Model,
    Diagnosis,
    Control,
    Exports,
    Checkpoint,
)

__all__ = [
    "ARTIFACTS",
    "Artifact",
    "Balance",
    "Calibration",
    "Checkpoint",
    "Control",
    "Diagnosis",
    "DroppedFrame",
    "Exports",
    "FittedModel",
    "Iterated",
    "Model",
    "Observations",
    "Parameter",
    "ParameterGroup",
    "Part",
    "Provenance",
    "Stepped",
    "View",
    "content_sha256",
    "identity",
    "read",
    "write",
]
