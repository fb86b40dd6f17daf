"""Tiny recordings and artifacts for tests: valid, so that a test can spoil one thing."""

from __future__ import annotations

import types
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel

from ropefit.artifacts import Artifact, Observations
from ropefit.artifacts.base import FIXED_SIZES, ArraySpec, array_spec
from ropefit.artifacts.seal import SEAL_BYTES, Seal, claimed, sealed

A = TypeVar("A", bound=Artifact)
FRAMES = 3
SIZES = {"frame": FRAMES, "boundary": FRAMES + 1, "node": 5, "segment": 4}


def example(kind: type[A], **given: Any) -> A:
    """A valid artifact: every field filled by its type, apart from those given."""
    return kind(**{**_fields(kind), **given})


def _fields(kind: type[BaseModel]) -> dict[str, Any]:
    return {
        name: _array(spec)
        if (spec := array_spec(field.annotation, field.metadata))
        else _value(field.annotation, name)
        for name, field in kind.model_fields.items()
    }


def _array(spec: ArraySpec) -> np.ndarray:
    shape = [FIXED_SIZES.get(dim, SIZES.get(dim, 2)) for dim in spec.dims]
    return (np.arange(np.prod(shape)).reshape(shape) * 0.25).astype(spec.dtype)


def _value(annotation: Any, name: str) -> Any:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, types.UnionType):
        return _value(arguments[0], name)
    if origin is Literal:
        return arguments[0]
    if origin is dict:
        # Not in alphabetical order: the file must keep the order of keys.
        return {key: _value(arguments[1], name) for key in ("nominal", "eta_b", "eta_a")}
    if origin is list:
        return [_value(arguments[0], name)] * 2
    if origin is tuple:
        return tuple(_value(argument, name) for argument in arguments)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return _fields(annotation)
    return {str: name, bool: True, int: 3, float: 1.5}.get(annotation, "anything")


def rope_points(frame: int, count: int, length: float = 1.0) -> np.ndarray:
    """(count, 3) [m] a hanging arc from (0, 0, 0) to (0.7, 0, 0) that sways with the frame."""
    share = np.linspace(0, 1, count)
    sag = 0.31 + 0.01 * frame
    line = np.stack([0.7 * share, 0.02 * np.sin(np.pi * share), -sag * 4 * share * (1 - share)], 1)
    return length * line


def write_ends(directory: Path, frames: int = FRAMES, scale: float = 1.0) -> None:
    """ends.csv with both ends pinned."""
    rows = ["frame,time,end,x,y,z"]
    for frame in range(frames):
        rows += [f"{frame},{0.5 * frame},0,0,0,0", f"{frame},{0.5 * frame},1,{0.7 * scale},0,0"]
    (directory / "ends.csv").write_text("\n".join(rows) + "\n")


def marker_recording(
    directory: Path,
    rope: str = "length = 1.0",
    ends: str = 'file = "ends.csv"',
    frames: int = FRAMES,
) -> Path:
    """A recording of 9 markers in markers.csv."""
    directory.mkdir(parents=True)
    write_manifest(directory, '[markers]\nfile = "markers.csv"', rope, ends)
    rows = ["frame,time,marker,x,y,z"]
    for frame in range(frames):
        for marker, (x, y, z) in enumerate(rope_points(frame, 9)):
            rows.append(f"{frame},{0.5 * frame},{marker},{x:.6f},{y:.6f},{z:.6f}")
    (directory / "markers.csv").write_text("\n".join(rows) + "\n")
    write_ends(directory, frames)
    return directory


def cloud_recording(
    directory: Path, rope: str = "length = 1.0", scale: float = 1.0, count: int = 300
) -> Path:
    """A recording of ascii PLY clouds, `count` points a frame; scale 1000 is millimetres."""
    (directory / "clouds").mkdir(parents=True)
    write_manifest(directory, '[clouds]\npattern = "clouds/{frame:03d}.ply"', rope)
    rng = np.random.default_rng(0)
    for frame in range(FRAMES):
        points = rope_points(frame, count) + rng.normal(0, 0.001, (count, 3))
        write_ply(directory / "clouds" / f"{frame:03d}.ply", points * scale)
    write_ends(directory, scale=scale)
    return directory


def write_ply(path: Path, points: np.ndarray) -> None:
    """An ascii PLY file of (N, 3) [m]."""
    header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    header += "property float x\nproperty float y\nproperty float z\nend_header\n"
    body = "".join(f"{x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in points)
    path.write_text(header + body)


def image_recording(directory: Path, size: tuple[int, int] = (24, 16)) -> Path:
    """An RGB-D recording of random pixels, written by OpenCV."""
    import cv2

    for name in ("color", "depth"):
        (directory / name).mkdir(parents=True)
    width, height = size
    write_manifest(
        directory,
        '[rgbd]\ncolor = "color/{frame}.png"\ndepth = "depth/{frame}.png"\ndepth_scale = 0.001\n'
        f"intrinsics = {{ width = {width}, height = {height}, fx = 20, fy = 20, cx = 12, cy = 8 }}",
    )
    rng = np.random.default_rng(0)
    for frame in range(FRAMES):
        color = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
        depth = rng.integers(0, 65536, (height, width), dtype=np.uint16)
        assert cv2.imwrite(str(directory / "color" / f"{frame}.png"), color)
        assert cv2.imwrite(str(directory / "depth" / f"{frame}.png"), depth)
    write_ends(directory)
    return directory


def write_manifest(
    directory: Path, data: str, rope: str = "length = 1.0", ends: str = 'file = "ends.csv"'
) -> None:
    """recording.toml with the given tables; an empty `ends` leaves [ends] out."""
    table = f"[ends]\n{ends}\n" if ends else ""
    (directory / "recording.toml").write_text(
        f'format = "ropefit-recording/1"\nname = "tiny"\n[rope]\n{rope}\n{table}{data}\n'
    )


def edit(path: Path, old: str, new: str) -> None:
    """Replace text in a file; it must be there."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def resealed(data: bytes, **claims: Any) -> bytes:
    """An artifact's bytes, spoiled or not, under a seal that fits them: who means harm can."""
    seal = claimed(data[-SEAL_BYTES:])
    image = data[:-SEAL_BYTES] if seal else data
    seal = seal or Seal(Observations.schema_name, Observations.schema_version, "0" * 64)
    return b"".join(sealed(image, replace(seal, **claims)))
