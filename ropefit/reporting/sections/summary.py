"""The answer in three sentences, the numbers it rests on, and what to keep in mind."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import FittedModel, Observations
from ropefit.reporting.answer import answer, rms
from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import bullets, facts, paragraph
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.equilibrium import metres_or_less
from ropefit.reporting.words import millimetres, plural

VERDICTS = {"none": "nothing", "unknown": "something unknown"}


class SummarySection(Section):
    """Three sentences, the numbers they rest on, and what to keep in mind."""

    title = "Summary"

    def render(self, run: RunContents) -> Markup:
        body = Markup('<div class="lead">{}</div>').format(
            Markup("").join(map(paragraph, answer(run)))
        )
        if run.fitted is not None:
            body += facts(_key_numbers(run, run.fitted), "key")
        notes = _caveats(run)
        if notes:
            body += Markup('<div class="caveats">{}</div>').format(
                paragraph("Keep in mind") + bullets(notes)
            )
        return body


def _determined(f: FittedModel) -> tuple[int, int]:
    """Free parameters that are determined in every group, and all free parameters."""
    names = {n for g in f.groups.values() for n, p in g.parameters.items() if p.free}
    good = [
        all(g.parameters[n].verdict == "determined" for g in f.groups.values() if n in g.parameters)
        for n in names
    ]
    return sum(good), len(good)


def _key_numbers(run: RunContents, f: FittedModel) -> dict[str, str]:
    o, d = run.observations, run.diagnosis
    solver = "converged" if f.solver_converged else "not converged"
    if f.balance:
        solver = f"{int(f.balance.converged.sum())} of {len(o.frames)} in equilibrium"
    if f.stepped:
        solver = f"{plural(f.stepped.clips, 'clip')} in motion"
    unseen = millimetres(f.rms_heldout) if f.rms_heldout is not None else "none held out"
    numbers = {
        "Before the fit": millimetres(rms(f.rms_initial)),
        "After, fitted frames": millimetres(f.rms_fit),
        "After, unseen frames": unseen,
        "Noise of a point": millimetres(float(np.median(o.noise))),
        "Solver": solver,
        "Determined": "{} of {}".format(*_determined(f)),
    }
    if d is not None:
        causes = ", ".join(c.name.replace("_", " ") for c in d.causes.values())
        numbers["Left out"] = VERDICTS.get(d.verdict, causes)
    return numbers


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
