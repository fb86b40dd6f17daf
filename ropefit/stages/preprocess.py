"""preprocess: a recording becomes ordered, segmented, projected observations with a measured
noise."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ropefit.adapters.settings import PreprocessSettings
from ropefit.artifacts import DroppedFrame, View
from ropefit.artifacts.observations import Fitting
from ropefit.errors import BadInput
from ropefit.perception.album import Album
from ropefit.perception.assemble import assemble
from ropefit.perception.segment import Looked
from ropefit.perception.trace import FrameRejected, Trace
from ropefit.perception.tracing import Tracer
from ropefit.recordings import Masks, Recording
from ropefit.runs.arrays import as_arrays, from_arrays
from ropefit.runs.journal import Arrays, journal
from ropefit.runs.protocol import Context
from ropefit.runs.threads import threads

MOST_GAPS = 0.2  # of the frames: more are no gaps but steps


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads only wait
def compute(
    inputs: dict[str, Any], settings: PreprocessSettings, context: Context
) -> dict[str, Any]:
    """Return the contents of observations.h5. Raises BadInput when no frame is usable."""
    recording: Recording = context.external["recording"]
    masks = Masks(Path(settings.mask)) if settings.mask else None
    looked = Looked(color=settings.color, roi=settings.roi)
    tracer = Tracer(recording, settings.most_points, looked, masks)
    album = Album(recording, tracer, context.external.get("debug_images"))
    tracer.learn_looks()
    traces, frames = [], []
    dropped = _missing(recording)
    for count, (frame, trace) in enumerate(_traced(tracer, album, recording.frames)):
        context.progress((count + 1) / len(recording.frames), f"frame {frame}")
        if isinstance(trace, Trace):
            traces.append(trace)
            frames.append(frame)
        else:
            dropped.append(DroppedFrame(frame=frame, reason=trace))
    if not frames:
        raise BadInput(
            f"{recording.path}: no usable frame of {len(dropped)}; the first: {dropped[0].reason}"
        )
    if len(dropped) > len(frames):
        context.say(
            f"warning: {len(dropped)} of {len(dropped) + len(frames)} frames dropped; "
            f"the first: {dropped[0].reason}"
        )
    if tracer.several:
        some = ", ".join(map(str, sorted(tracer.several)[:5]))
        context.say(
            f"several ropes are seen in {len(tracer.several)} frames ({some}): the one most like a "
            "rope was taken; say which with --roi, --mask, --color or [ends]"
        )
    content = assemble(tracer, traces, np.array(frames), settings.nodes, settings.project)
    for warning in tracer.warnings:  # only now: a refusal is one line
        context.say(f"warning: {warning}")
    rope = recording.manifest.rope
    if rope.length and content["length_source"] == "estimated":
        context.say(
            f"the recording says {rope.length:g} m of rope, {content['length']:.4g} m are seen "
            "between the assumed ends: these count; give [ends] to use the whole rope"
        )
    grips, pieces = tracer.grips, recording.manifest.fittings
    mass = rope.whole_mass(content["length"])
    if grips is not None:
        mass = mass and (mass if rope.mass_per_length else mass * grips.length / grips.whole)
        pieces = [
            piece.model_copy(update={"arc_length": piece.arc_length - grips.first})
            for piece in pieces
            if grips.first <= piece.arc_length <= grips.last
        ]
        context.say(
            f"only the rope between the grips, {grips.first:g} to {grips.last:g} m, is used: what "
            "hangs beyond a grip does not change it; arc lengths count from the grip of end 0"
        )
    return {
        "recording": recording.name,
        "recording_path": str(Path(recording.path).resolve()),
        "source": recording.source.table,
        "gravity": recording.gravity,
        "diameter": rope.diameter,
        "mass": mass,
        "marker_offset": (recording.manifest.markers and recording.manifest.markers.offset) or 0.0,
        "fittings": {f"fitting_{k}": Fitting(**one.model_dump()) for k, one in enumerate(pieces)},
        "priors": recording.manifest.priors.model_dump(exclude={"marker_noise"}),
        "frames": np.array(frames),
        "time": recording.times(frames),
        "dropped": dropped,
        "end_kind": tracer.end_kind,
        "ends_assumed": recording.ends is None,
        "end_twist_known": all(end.roll_known for end in recording.ends or ()),
        "view": View(**vars(content.pop("camera"))),
        **album.pictures(),
        **content,
    }


def _traced(tracer: Tracer, album: Album, frames: list[int]) -> Iterator[tuple[int, Trace | str]]:
    """Return each frame's trace, or why there is none; several at a time, given back in order, and
    kept in the journal."""
    kept = journal()
    drawn = album.folder is not None  # pictures of every step: drawn anew, into this folder

    def one(frame: int) -> tuple[Trace | str, bool]:
        known = None if drawn else kept.recall(f"frame {frame}")
        if known:
            return restored(frame, known, album), True
        try:
            return tracer.trace(frame, album.look), False
        except FrameRejected as reason:
            album.reject(frame, str(reason))
            return str(reason), False

    with ThreadPoolExecutor(threads()) as pool:
        for frame, (trace, known) in zip(frames, pool.map(one, frames), strict=True):
            if not known:
                kept.keep(f"frame {frame}", lambda f=frame, t=trace: as_kept(f, t, album))
            yield frame, trace


def as_kept(frame: int, trace: Trace | str, album: Album) -> Arrays:
    """Return a frame's trace, or why there is none, with its picture, as arrays."""
    if isinstance(trace, str):
        return {"why": np.array(trace)}
    arrays = as_arrays(trace, "")
    if frame in album.kept:
        data, text = album.kept[frame]
        arrays |= {"picture": np.frombuffer(data, np.uint8), "text": np.array(text)}
    return arrays


def restored(frame: int, arrays: Arrays, album: Album) -> Trace | str:
    """Return the trace that was kept; its picture goes to the album."""
    if "why" in arrays:
        return str(arrays["why"])
    if "picture" in arrays:
        album.kept[frame] = (arrays["picture"].tobytes(), str(arrays["text"]))
    return from_arrays(Trace, "", arrays)


def _missing(recording: Recording) -> list[DroppedFrame]:
    """Return frames that are not there although those around them are, each with its name."""
    frames = recording.frames
    gaps = sorted(set(range(frames[0], frames[-1] + 1)) - set(frames))
    if len(gaps) > MOST_GAPS * len(frames):  # numbered in steps: none is missing
        return []
    reason = "missing: the recording has no file of this frame"
    return [DroppedFrame(frame=frame, reason=reason) for frame in gaps]
