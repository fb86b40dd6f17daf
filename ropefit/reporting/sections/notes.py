"""What to keep in mind with the answer."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import FittedModel, Observations
from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import bullets
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.equilibrium import metres_or_less
from ropefit.reporting.words import millimetres, plural


class NotesSection(Section):
    """Assumptions and what did not arrive."""

    title = "Keep in mind"

    def applies(self, run: RunContents) -> bool:
        return bool(_caveats(run))

    def render(self, run: RunContents) -> Markup:
        return bullets(_caveats(run))


def _caveats(run: RunContents) -> list[object]:
    o, f = run.observations, run.fitted
    notes = _of_recording(o)
    if f is None:
        return notes
    notes += _of_solver(f, o)
    if f.rms_heldout is None:
        notes.append("No frame was held out: how well the fit predicts unseen frames is not known.")
    for name, group in f.groups.items():
        if not group.converged:
            which = f" of {name.replace('_', ' ')}" if len(f.groups) > 1 else ""
            notes.append(f"The search{which} stopped before it arrived: {group.stop_reason}.")
    if any("eta" in name for group in f.groups.values() for name in group.parameters):
        notes.append("The parameters are weights of this simulation (η), not rigidities in N·m².")
    return notes


def _of_recording(o: Observations) -> list[object]:
    notes: list[object] = []
    if o.ends_assumed:
        notes.append(
            "The recording says nothing about its ends: the ends seen were taken as pinned."
        )
    if o.length_source == "estimated":
        notes.append("The rope’s length was estimated from the frames, not given.")
    if o.noise_source.startswith("assumed"):
        notes.append("The noise was assumed, not measured: comparisons with it are rough.")
    return notes


def _of_solver(f: FittedModel, o: Observations) -> list[object]:
    notes: list[object] = []
    if f.iterated and not f.solver_converged:
        moved = millimetres(float(np.median(f.iterated.drift)) * o.length)
        notes.append(
            "The solver has not converged: iterated twice as long, the rope would move by "
            f"{moved}, so the numbers depend on the iteration count and are not properties of the "
            "rope."
        )
    if f.balance:
        lost = int((~f.balance.converged).sum())
        if lost:
            notes.append(f"{plural(lost, 'frame')} of {len(o.frames)} found no equilibrium.")
        if not f.balance.mass_known:
            notes.append(
                "Without the rope’s mass, shapes alone fix only ratios to its weight; the bending "
                f"length (EI/w)^⅓ is {metres_or_less(f.balance.bending_length)}."
            )
    return notes
