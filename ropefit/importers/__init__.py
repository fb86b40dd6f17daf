"""Importers: recordings as they come become recordings of ropefit. One class a file."""

from __future__ import annotations

from ropefit.errors import WrongUsage
from ropefit.importers.base import Entry, Importer, Options, parse_options
from ropefit.importers.c3d import C3d
from ropefit.importers.clouds import Clouds
from ropefit.importers.draft import Draft
from ropefit.importers.kinect import Kinect
from ropefit.importers.lerobot import Lerobot
from ropefit.importers.mocap import Mocap
from ropefit.importers.realsense import RealSense
from ropefit.importers.ros import Ros
from ropefit.importers.tum import Tum
from ropefit.importers.video import Video
from ropefit.plugins import IMPORTERS, concrete
from ropefit.recordings.writer import About

__all__ = [
    "About", "C3d", "Clouds", "Draft", "Entry", "Importer", "Kinect", "Lerobot", "Mocap",
    "Options",
    "RealSense", "Ros", "Tum", "Video", "importer", "importers", "parse_options",
]  # fmt: skip


def importers() -> dict[str, type[Importer]]:
    """Return {format: class} of every importer, those of installed add-ons included."""
    return {kind.format: kind for kind in concrete(Importer, IMPORTERS)}


def importer(name: str) -> type[Importer]:
    """Return the importer of a format. Raises WrongUsage."""
    known = importers()
    if name not in known:
        raise WrongUsage(f"--from {name}: one of {', '.join(sorted(known))}")
    return known[name]
