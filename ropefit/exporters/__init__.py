"""Exporters: a rope as text for a simulator. One class a file; importing it is what adds it."""

from __future__ import annotations

from ropefit.errors import WrongUsage
from ropefit.exporters.base import Exporter, ExportResult, Simulator
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.json import Json
from ropefit.exporters.mujoco import MuJoCo
from ropefit.exporters.mujoco3 import MuJoCo3
from ropefit.exporters.newton import Newton
from ropefit.exporters.pyelastica import PyElastica
from ropefit.plugins import EXPORTERS, concrete

__all__ = [
    "ExportResult",
    "Exporter",
    "Json",
    "MuJoCo",
    "MuJoCo3",
    "Newton",
    "PyElastica",
    "RopeDescription",
    "Simulator",
    "export",
    "exporter",
    "exporters",
]


def exporters() -> dict[str, type[Exporter]]:
    """Return {target: class} of every exporter, those of installed add-ons included."""
    return {kind.target: kind for kind in concrete(Exporter, EXPORTERS)}


def exporter(target: str) -> type[Exporter]:
    """Return the class that writes for `target`. Raises WrongUsage for an unknown one."""
    known = exporters()
    if target not in known:
        raise WrongUsage(f"--to {target}: one of {', '.join(sorted(known))}")
    return known[target]


def export(description: RopeDescription, target: str) -> ExportResult:
    """Return the rope as text for `target`. Raises WrongUsage for an unknown one."""
    return exporter(target)().export(description)
