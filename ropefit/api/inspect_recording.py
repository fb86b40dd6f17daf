"""inspect, of a recording: a dry check of everything that preprocess needs. Nothing is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings import Recording, open_recording
from ropefit.runs.run_directory import is_run

TRIED = 3  # frames that are traced
EARTH = 9.81  # m/s²
FAR_FROM_EARTH = 0.05  # of it
FORMATS = {
    ".bag": "ros", ".db3": "ros", ".mcap": "ros", ".c3d": "c3d", ".csv": "mocap", ".tsv": "mocap",
    ".npz": "mocap", ".mkv": "kinect", ".mp4": "video", ".mov": "video", ".avi": "video",
}  # fmt: skip
INSIDE = {
    "metadata.yaml": "ros",
    "rgb.txt": "tum",
    "meta/info.json": "lerobot",
}  # what a folder of the format holds


def is_recording(path: Path) -> bool:
    """Return whether a path is a recording, and not a run that lies in one."""
    return (path / "recording.toml").is_file() and not is_run(path)


def source_format(path: Path) -> str | None:
    """Return the format by which a file or folder would be imported; None where it is unknown."""
    if path.is_dir():
        return next((kind for name, kind in INSIDE.items() if (path / name).is_file()), None)
    return FORMATS.get(path.suffix.lower()) if path.is_file() else None


def inspect_source(path: Path) -> dict[str, Any]:
    """Return what a source that is no recording yet holds, and how it becomes one. Raises
    BadInput."""
    from ropefit.stages.importing import list_source

    kind = source_format(path)
    assert kind is not None
    contents = list_source(path, kind)["contents"]
    return {
        "path": str(path),
        "title": f"{path}: {kind}, not a recording yet",
        "summary": [(item["name"], f"{item['count']} x {item['kind']}") for item in contents],
        "warnings": [] if contents else ["nothing in it that can be imported"],
        "next": f"run `ropefit import {path} --from {kind} --out my_recording`, then "
        "`ropefit inspect my_recording` (docs/importing.md has the options)",
        "contents": contents,
    }


def inspect_recording(path: Path) -> dict[str, Any]:
    """Return what a recording holds and what will mislead a fit, after tracing a few frames.

    {path, title, summary: [(what, text)], warnings: [text], frames, traced, next}. Raises BadInput
    where preprocess would refuse it, too.
    """
    from ropefit.perception.trace import FrameRejected
    from ropefit.perception.tracing import Tracer

    recording = open_recording(path)
    tracer = Tracer(recording)
    frames = recording.frames
    some = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, TRIED).astype(int))]
    traced: dict[str, str] = {}
    failed = []
    for frame in some:
        try:
            trace = tracer.trace(frame)
        except FrameRejected as reason:
            traced[str(frame)] = f"no rope: {reason}"
            failed.append((frame, f"frame {frame}: {reason}; preprocess drops it"))
        else:
            line = float(np.linalg.norm(np.diff(trace.centreline, axis=0), axis=1).sum())
            traced[str(frame)] = f"{len(trace.points)} points on {line:.4g} m of rope"
    if len(failed) == len(some):
        raise BadInput(f"{path}: no rope in any of frames {', '.join(traced)}: {failed[0][1]}")
    lost = [text for frame, text in failed if _posed(recording, frame)]
    warnings = [*tracer.warnings, *lost, *_unsaid(recording), *_frames_without_poses(recording)]
    time = recording.times(frames)
    clock = "no times" if time is None else f"{np.nanmin(time):g} to {np.nanmax(time):g} s"
    rope = recording.manifest.rope
    given = [
        ("long", rope.length, "m"), ("thick", rope.diameter, "m"), ("heavy", rope.mass, "kg"),
        ("heavy", rope.mass_per_length, "kg a metre"),
    ]  # fmt: skip
    known = [f"{value:g} {unit} {what}" for what, value, unit in given if value is not None]
    summary = [
        ("frames", f"{len(frames)} ({frames[0]}..{frames[-1]}), {clock}"),
        ("data", _data(recording)),
        ("ends", "not given: the visible ones are taken as pinned" if recording.ends is None
         else ", ".join(f"end {k} {kind}" for k, kind in enumerate(tracer.end_kind))),
        ("rope", ", ".join(known) or "nothing given: its length is estimated"),
        ("gravity", "{:g}, {:g}, {:g} m/s²".format(*recording.gravity)),
        ("noise", f"measured by preprocess: {tracer.noise_source}" if tracer.noise is None
         else f"{tracer.noise * 1e3:.2g} mm per coordinate ({tracer.noise_source})"),
        *((f"frame {frame}", text) for frame, text in traced.items()),
    ]  # fmt: skip
    return {
        "path": str(path),
        "title": f"{recording.name}: a recording",
        "summary": summary,
        "warnings": warnings,
        "next": f"run `ropefit preprocess {path} --run my_run`",
        "frames": len(frames),
        "ends": None if recording.ends is None else list(tracer.end_kind),
        "traced": traced,
    }


def _data(recording: Recording) -> str:
    sight = recording.source.sight(recording.frames[0])
    if sight.ordered and sight.points is not None:
        seen = np.mean([
            np.isfinite(points).all(axis=1).mean()
            for frame in recording.frames
            if (points := recording.source.sight(frame).points) is not None
        ])  # fmt: skip
        return f"{len(sight.points)} markers, seen in {seen:.0%} of all places"
    if sight.points is not None:
        return f"clouds; {len(sight.points)} points in the first"
    assert sight.color is not None
    high, wide = sight.color.shape[:2]
    return f"pictures of {wide} x {high} px" + ("" if sight.depth is None else " with depth")


def _unsaid(recording: Recording) -> list[str]:
    """Return warnings on what the description of a recording leaves open, or says oddly."""
    found = []
    if recording.manifest.rope.length is None:
        found.append(
            "no [rope] length: it is estimated from what is seen, and any error of it goes into EI"
        )
    if not recording.manifest.rope.mass_known:
        found.append("no [rope] mass: rigidities are stated per weight of the rope, not in N m²")
    size = float(np.linalg.norm(recording.gravity))
    if abs(size - EARTH) > FAR_FROM_EARTH * EARTH:
        found.append(
            f"gravity is {size:.4g} m/s², not {EARTH}: correct it unless it is so on purpose"
        )
    return found


def _frames_without_poses(recording: Recording) -> list[str]:
    found = []
    for end, rows in enumerate(recording.ends or ()):
        lost = [frame for frame in recording.frames if frame not in rows.position]
        if rows.kind != "free" and lost:
            found.append(
                f"frame {lost[0]}: end {end} has no pose ({len(lost)} of {len(recording.frames)} "
                "frames), as no row is of that frame or, with another clock, near its time: "
                "preprocess drops it"
            )
    return found


def _posed(recording: Recording, frame: int) -> bool:
    return all(rows.kind == "free" or frame in rows.position for rows in recording.ends or ())
