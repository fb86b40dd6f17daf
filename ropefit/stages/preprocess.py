"""preprocess: a recording becomes ordered, segmented, projected observations with a measured
noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ropefit.artifacts import DroppedFrame, Observations, View
from ropefit.errors import BadInput
from ropefit.perception.assemble import assemble
from ropefit.perception.trace import FrameRejected
from ropefit.perception.tracing import Tracer
from ropefit.recordings import Recording
from ropefit.stages.stage import Context, Stage, StageSettings


class PreprocessSettings(StageSettings):
    """nodes: K, the number of particles and segment boundaries. project: onto the hanging plane."""

    nodes: int = Field(default=20, ge=4, le=400)
    project: Literal["auto", "yes", "no"] = "auto"
    most_points: int = Field(default=400, ge=20, le=20_000)


def compute(
    inputs: dict[str, Any], settings: PreprocessSettings, context: Context
) -> dict[str, Any]:
    """The contents of observations.h5. Raises BadInput when no frame is usable."""
    recording: Recording = context.external["recording"]
    tracer = Tracer(recording, most_points=settings.most_points)
    traces, frames, dropped = [], [], []
    for count, frame in enumerate(recording.frames):
        context.progress(count / len(recording.frames), f"frame {frame}")
        try:
            traces.append(tracer.trace(frame))
            frames.append(frame)
        except FrameRejected as reason:
            dropped.append(DroppedFrame(frame=frame, reason=str(reason)))
    if not frames:
        raise BadInput(
            f"{recording.path}: no usable frame of {len(dropped)}; the first: {dropped[0].reason}"
        )
    if len(dropped) > len(frames):
        context.say(
            f"warning: {len(dropped)} of {len(dropped) + len(frames)} frames dropped; "
            f"the first: {dropped[0].reason}"
        )
    content = assemble(tracer, traces, np.array(frames), settings.nodes, settings.project)
    rope = recording.manifest.rope
    if rope.length and content["length_source"] == "estimated":
        context.say(
            f"the recording says {rope.length:g} m of rope, {content['length']:.4g} m are seen "
            "between the assumed ends: these count; give [ends] to use the whole rope"
        )
    return {
        "recording": recording.name,
        "recording_path": str(Path(recording.path).resolve()),
        "source": recording.source.table,
        "gravity": recording.gravity,
        "diameter": rope.diameter,
        "mass": rope.mass,
        "priors": recording.manifest.priors.model_dump(),
        "frames": np.array(frames),
        "time": np.array([recording.source.time[frame] for frame in frames]),
        "dropped": dropped,
        "end_kind": tracer.end_kind,
        "ends_assumed": recording.ends is None,
        "end_twist_known": not (recording.manifest.ends and recording.manifest.ends.markers),
        "view": View(**vars(content.pop("camera"))),
        **content,
    }


STAGE = Stage(
    name="preprocess",
    reads=(),
    writes=Observations,
    compute=compute,
)
