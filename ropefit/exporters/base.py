"""What an exporter is: a rope's description in, text out. No simulator is ever imported."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ropefit.attachments import BendingFriction
from ropefit.exporters.description import RopeDescription

NOMINAL_DIAMETER = 0.008  # m, where the rope's own is not known: only contacts and looks use it


@dataclass(frozen=True)
class ExportResult:
    """text: the main file. files: {name: text} that go beside it. not_expressed: sentences on what
    the target cannot express; they stand in the text as well."""

    text: str
    files: Mapping[str, str] = field(default_factory=dict)
    not_expressed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Simulator:
    """Where an exported text comes to rest, in a Python of its own.

    module: what that Python must be able to import, in a version from `least` to before `below`.
    package: what pip installs for it. runner: a script in runners/ that takes the text and
    `--pose P --out CSV` and writes the vertices at rest; none: the text is that script itself.
    """

    module: str
    package: str
    least: tuple[int, ...] = (0,)
    below: tuple[int, ...] = (1000,)
    runner: str = ""


class Exporter(ABC):
    """One simulator. A subclass is found by its `target` once its module is imported."""

    target: ClassVar[str]
    suffix: ClassVar[str]  # of the main file, with the dot
    simulator: ClassVar[Simulator | None] = None  # for `export --check`; None: nothing runs it

    @abstractmethod
    def export(self, rope: RopeDescription) -> ExportResult:
        """Return the text that makes the rope in this simulator."""


def numbers(values: np.ndarray | list[float] | tuple[float, ...]) -> str:
    """Return numbers with spaces between, 10 significant digits: more than any simulator keeps."""
    return " ".join(f"{value:.10g}" for value in np.asarray(values, dtype=float).ravel())


def varies(values: np.ndarray) -> bool:
    """Return whether entries differ by more than a part in a thousand."""
    return bool(np.ptp(values) > 1e-3 * np.abs(values).max())


def diameter_of(rope: RopeDescription, lost: list[str]) -> float:
    """Return the rope's diameter [m]; a nominal one, and a sentence in `lost`, where it is not
    known."""
    if rope.diameter is not None:
        return rope.diameter
    lost.append(
        f"the rope's diameter is not known: {NOMINAL_DIAMETER:g} m is written, for contacts "
        "and looks; the stiffness does not depend on it"
    )
    return NOMINAL_DIAMETER


def stretch_note(rope: RopeDescription, lost: list[str]) -> None:
    """Say what an unstretchable, unshearable target leaves out, where that is anything."""
    weight = float(rope.masses.sum() * np.linalg.norm(rope.gravity))
    if np.isfinite(rope.EA).any():
        strain = weight / float(rope.EA.min())
        lost.append(
            f"stretch is not expressed: the target's rope keeps its length (EA = "
            f"{rope.EA.min():.4g} N lets its own weight stretch it by {strain:.2%} at most)"
        )
    if np.isfinite(rope.GA).any():
        lost.append("transverse shear is not expressed (GA is ignored)")


def friction_note(rope: RopeDescription, lost: list[str]) -> None:
    """Say that a target without it leaves out friction of bending."""
    for effect in rope.effects:
        if isinstance(effect, BendingFriction):
            lost.append(
                f"internal friction of bending, up to {effect.moment:.4g} N m: the target's rope "
                "has none"
            )
