"""diagnosis.h5: what the nominal model left out, how sure that is, and what else it could be."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ropefit.artifacts.base import ArraySpec, Artifact, Part, quantity
from ropefit.artifacts.causes import Cause, Size
from ropefit.artifacts.model import Calibration
from ropefit.artifacts.observations import DroppedFrame


class Candidate(Part):
    """An effect in the score scan of the nominal model, before any was fitted."""

    name: str
    variant: str
    log_factor: float = Field(description="nats; log Bayes factor, averaged over places")
    score: float = Field(description="signal to noise after nominal and calibration")
    place: Annotated[np.ndarray, ArraySpec(("tried", "where"), "m")]
    by_place: Annotated[np.ndarray, ArraySpec(("tried",))]  # nats


class Region(Part):
    """A stretch of rope and frames in which data and nominal model differ beyond noise."""

    arc_length: tuple[float, float] = quantity("m")
    frames: tuple[int, int]
    rms: float = quantity("m")
    direction: tuple[float, float, float]


class Detectable(Part):
    """The smallest size that would have been found."""

    value: float
    unit: str
    topic: str = Field(default="", description="what `sentence` is about: weight, linearity")
    sentence: str = Field(default="", description="what it means where nothing was found")


class Simulation(Part):
    """A simulation of the recording's motion: which rope it is, and what it does besides."""

    name: str
    verdict: Literal["none", "found", "unknown"]
    effects: dict[str, Cause] = Field(default_factory=dict)
    rope: dict[str, Size] = Field(description="of the rope that is most like it")
    refused: list[str]
    missing: list[str] = Field(
        default_factory=list, description="effects of the recording that the simulation lacks"
    )
    differences: list[str] = Field(
        default_factory=list, description="parameters and effects that both have, in other sizes"
    )
    x: Annotated[np.ndarray, ArraySpec(("frame", "node", "xyz"), "m", nan=True)]
    rms: float = quantity("m", "of the recording's points from the simulation")
    rms_converged: float = quantity("m", "of the recording from its own rope, held-out frames")
    rms_of_rope: float = quantity("m", "of the simulation from that rope, held-out frames")
    rms_explained: float = quantity("m", "the same with the effects")


class Diagnosis(Artifact):
    """Verdict, causes and evidence."""

    schema_name: ClassVar[str] = "ropefit-diagnosis"
    schema_version: ClassVar[int] = 6
    file_name: ClassVar[str] = "diagnosis.h5"

    recording: str
    verdict: Literal["none", "found", "unknown"]
    causes: dict[str, Cause] = Field(default_factory=dict)
    known: dict[str, Cause] = Field(
        default_factory=dict,
        description="causes of the nominal run that belong to the rope, as fitted here",
    )
    scan: dict[str, Candidate] = Field(default_factory=dict)
    mismatch: list[Region]
    refused: list[str] = Field(description="what is not accepted, or cannot be determined, and why")
    dropped: list[DroppedFrame] = Field(
        default_factory=list, description="what the diagnosis does not compare, beside preprocess"
    )
    threshold: float = Field(description="nats an effect needs, from this recording's own noise")
    noise_white: float = quantity("m", "of one point, over all components that count")
    noise_repeated: float | None = quantity(
        "m", "of a marker at rest, from neighbouring poses: without what is missed", default=None
    )
    noise_correlated: float = quantity("m")
    correlation_length: float = quantity("m")
    rms_before: float = quantity("m", "held-out blocks of frames, nominal model")
    rms_after: float = quantity("m", "held-out blocks of frames, with the causes")
    detectable: dict[str, Detectable]
    segments: int = Field(default=0, description="of the rod that was solved; 0: as in model.h5")
    rope: dict[str, Size] = Field(
        default_factory=dict, description="the rope's own parameters, fitted together with causes"
    )
    calibration: dict[str, Calibration] = Field(default_factory=dict)
    simulation: Simulation | None = None
    motion: str = Field(description="the motion that would distinguish the leading candidates")
    separates: list[str]
    # What the two of `separates` predict in that motion.
    motion_x: Annotated[np.ndarray, ArraySpec(("candidate", "pose", "node", "xyz"), "m")] | None = (
        None
    )
    # Probability integral transform of held-out data: uniform where intervals are honest.
    pit: Annotated[np.ndarray, ArraySpec(("residual",))] | None = None
    frames: Annotated[np.ndarray, ArraySpec(("frame",), dtype="int64")]
    node_arc: Annotated[np.ndarray, ArraySpec(("node",), "m")]
    x_before: Annotated[np.ndarray, ArraySpec(("frame", "node", "xyz"), "m")]
    x_after: Annotated[np.ndarray, ArraySpec(("frame", "node", "xyz"), "m")]
    station_arc: Annotated[np.ndarray, ArraySpec(("station",), "m")]
    misfit_before: Annotated[np.ndarray, ArraySpec(("frame", "station"), "m", nan=True)]
    misfit_after: Annotated[np.ndarray, ArraySpec(("frame", "station"), "m", nan=True)]
    force_arc: Annotated[np.ndarray, ArraySpec(("knot",), "m")]
    force: Annotated[np.ndarray, ArraySpec(("frame", "knot", "xyz"), "N/m")]
    force_sd: Annotated[np.ndarray, ArraySpec(("frame", "knot", "xyz"), "N/m")]
    force_evidence: float
    force_threshold: float

    def unseen(self, topic: str) -> str:
        """Return what could be there undetected, about one topic; empty where an effect was
        found or nothing is known of it."""
        sentences = (item.sentence for item in self.detectable.values() if item.topic == topic)
        return "" if self.causes else next(sentences, "")
