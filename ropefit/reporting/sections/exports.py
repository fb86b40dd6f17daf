"""The rope in other simulators: what was written, and how far off it comes to rest there."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts.exports import Check, Export, deviation
from ropefit.exporters import exporters
from ropefit.reporting.camera import broadside
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import NOMINAL, RECORDED, Figure, at, dots, path, space
from ropefit.reporting.html import bullets, heading, sequence, table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import millimetres, percent, plural, ranges

MOST_DEVIATION = 0.01  # of the rope's length that an export may be off without a reason


class ExportsSection(Section):
    """A sentence and a table row a simulator, and both ropes in space."""

    title = "Export"
    folded = True

    def applies(self, run: RunContents) -> bool:
        return run.exports is not None

    def render(self, run: RunContents) -> Markup:
        assert run.exports is not None
        made, length = run.exports.exports, run.exports.length
        body = bullets(
            f"{target}: {summary(target, export, length)}" for target, export in made.items()
        )
        head = ["target", "file", "at rest in", "poses", "largest deviation", "went along"]
        body += table(head, [_row(target, export, length) for target, export in made.items()])
        checked = {target: e for target, e in made.items() if e.check and settled(e.check).any()}
        if checked:
            first = next(iter(checked.values()))
            labels = [f"Frame {frame}" for frame in first.frames]
            body += sequence(
                [_in_space(run, target, e, e.check) for target, e in checked.items() if e.check],
                labels,
            )
        for target, export in made.items():
            if export.notes:
                body += heading(f"What {target} cannot express, and what is good to know")
                body += bullets(export.notes)
        return body


def settled(check: Check) -> np.ndarray:
    """Return (pose,) whether the simulator brought the rope to rest."""
    return np.array([not failure for failure in check.failures])


def summary(target: str, export: Export, length: float) -> str:
    """Return how far off the exported rope comes to rest, in one or two sentences."""
    check = export.check
    if check is None:
        kind = exporters().get(target)
        if kind is None or kind.simulator is None:
            return f"{export.file} was written."
        return (
            f"{export.file} was written but not tried; ropefit export --check lets it come to rest "
            "in the simulator and measures how far off that is."
        )
    good = settled(check)
    lost = ""
    if not good.all():
        why = sorted({failure for failure in check.failures if failure})
        lost = (
            f" In {plural(int((~good).sum()), 'pose')} (frame {ranges(export.frames[~good])}) it "
            f"did not come to rest: {'; '.join(why)}."
        )
    if not good.any():
        return lost.strip()
    off = deviation(export, length)
    largest = float(np.nanmax(off))
    where = (
        f"{percent(largest)} of its length ({millimetres(largest * length)}) from where this "
        "simulation has it"
    )
    poses = plural(int(good.sum()), "pose")
    if largest <= MOST_DEVIATION:
        return (
            f"At rest in {check.simulator}, in {poses} of this recording, no point of "
            f"the exported rope is farther than {where}.{lost}"
        )
    return (
        f"At rest in {check.simulator}, in {poses} of this recording, the exported rope is up to "
        f"{where}: {_reason(export, off)}.{lost}"
    )


def _reason(export: Export, off: np.ndarray) -> str:
    """Return why more than 1 % is to be expected, as far as that is known."""
    far = off > MOST_DEVIATION
    twice = far & np.isfinite(export.other)
    reasons = []
    if twice.any():
        reasons.append(
            f"in frame {ranges(export.frames[twice])} a second stable equilibrium is known, "
            f"{millimetres(float(np.nanmax(export.other[twice])))} away, where it may have gone"
        )
    if (far & ~twice).any():
        left_out = [note for note in export.notes if not note.startswith("damping:")]
        reasons.append(
            "the simulator cannot express everything (see below)"
            if left_out
            else "the reason is not known, so do not trust it"
        )
    return "more than the 1 % that is usual; " + " and ".join(reasons)


def _row(target: str, export: Export, length: float) -> list[object]:
    check, off = export.check, deviation(export, length)
    known = np.isfinite(off).any()
    return [
        target,
        export.file,
        check.simulator if check else "not tried",
        f"{int(settled(check).sum())} of {len(export.frames)}" if check else len(export.frames),
        f"{percent(float(np.nanmax(off)))} of the length" if known else "–",
        ", ".join(name.replace("_", " ") for name in export.effects) or "–",
    ]


def _in_space(run: RunContents, target: str, export: Export, check: Check) -> Figure:
    both = np.concatenate([export.x, check.x]).reshape(-1, 3)
    low, high = np.nanmin(both, axis=0), np.nanmax(both, axis=0)
    eye, up = broadside(run.observations, both)
    return Figure(
        f"The exported rope at rest in {target}",
        [path("ropefit", NOMINAL, 3), dots(target, RECORDED, 6)],
        space(low, high, eye, up),
        f"The rope of this report (line) and its nodes at rest in {check.simulator} (dots). The "
        "node of a clamped end is not drawn: the clamp holds it.",
        height=380,
        steps=[[at(x) for x in pair] for pair in zip(export.x, check.x, strict=True)],
    )
