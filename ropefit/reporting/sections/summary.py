"""The answer in three plain sentences, for somebody who knows neither solver nor statistics."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Balance, FittedModel, Observations, Parameter, ParameterGroup
from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import bullets, facts, paragraph
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.equilibrium import metres_or_less
from ropefit.reporting.words import (
    digits_of,
    given,
    listed,
    metres,
    millimetres,
    number,
    plural,
    symbol,
    unit_text,
)

SENSOR = {"clouds": "a point cloud sensor", "rgbd": "a depth camera", "markers": "motion capture"}
AS_GOOD_AS_NOISE, SMALL_REST = 1.25, 2.5  # residual over noise


class SummarySection(Section):
    """Three sentences, the numbers they rest on, and what to keep in mind."""

    title = "Summary"

    def render(self, run: RunContents) -> Markup:
        o, f = run.observations, run.fitted
        sentences = [_rope(o)]
        if f is None:
            sentences.append("No simulation has been fitted to it yet: run ropefit identify.")
        else:
            sentences += [_fit(o, f), _trust(f, run.observations.length)]
        body = Markup('<div class="lead">{}</div>').format(
            Markup("").join(map(paragraph, sentences))
        )
        if f is not None:
            body += facts(_key_numbers(o, f), "key")
        notes = _caveats(run)
        if notes:
            body += Markup('<div class="caveats">{}</div>').format(
                paragraph("Keep in mind") + bullets(notes)
            )
        return body


def _rope(o: Observations) -> str:
    about = f"{metres(o.length)} long" + (" (estimated)" if o.length_source == "estimated" else "")
    if o.diameter:
        about += f", {given(1e3 * o.diameter)} mm thick"
    if o.mass:
        about += f", {given(1e3 * o.mass)} g"
    first, second = o.end_kind
    held = f"{first} at the gripper’s end and {second} at the other"
    if first == second:
        held = f"{first} at both ends"
    if o.ends_assumed:
        held = f"assumed to be {held}"
    frames = plural(len(o.frames), "frame")
    return f"This is a rope {about}, {held}, seen by {SENSOR[o.source]} in {frames}."


def rms(values: np.ndarray) -> float:
    """Root mean square of the rms of frames."""
    return float(np.sqrt(np.mean(values**2)))


def _fit(o: Observations, f: FittedModel) -> str:
    noise = float(np.median(o.noise))
    if f.rms_heldout is None:
        left = f.rms_fit
        told = (
            f"After the fit the simulated rope lies {millimetres(left)} (rms) from the measured "
            f"points, {millimetres(rms(f.rms_initial))} before it, but no frame was held out: this "
            "is the agreement on the very frames the fit was made from"
        )
    else:
        left = f.rms_heldout
        before = millimetres(rms(f.rms_initial[f.heldout]))
        told = (
            f"In {plural(int(f.heldout.sum()), 'frame')} that the fit never saw, the simulated "
            f"rope lies {millimetres(left)} (rms) from the measured points ({before} before the "
            f"fit, {millimetres(f.rms_fit)} in the frames it was fitted to)"
        )
    ratio = left / noise
    if ratio <= AS_GOOD_AS_NOISE:
        meaning = ", so the fit is as close as this measurement can tell"
    elif ratio <= SMALL_REST:
        meaning = (
            f" and the fit leaves {number(ratio, 2)} times that, so a part of what the rope does "
            "is not explained"
        )
    else:
        meaning = (
            f" and the fit leaves {number(ratio, 2)} times that, so the model misses something "
            "about the rope or the set-up"
        )
    return f"{told}; a single measured point scatters by {millimetres(noise)}{meaning}."


def _trust(f: FittedModel, length: float) -> Markup:
    if f.balance:
        return _trust_equilibrium(f, f.balance)
    if f.stepped:
        return Markup(
            "Every clip was simulated open loop from its first two frames, with the rope's inertia "
            "and damping."
        )
    assert f.iterated is not None
    if f.solver_converged:
        solver = "The solver converged, so the shape does not depend on the iteration count"
    else:
        moved = millimetres(float(np.median(f.iterated.drift)) * length)
        solver = (
            f"The solver has not converged (iterated twice as long, the rope would move by {moved})"
            ", so the numbers depend on the iteration count and are not properties of the rope"
        )
    determined, not_determined = _sort(f)
    if not determined:
        known = Markup("the recording determines none of the free parameters")
    elif not_determined:
        known = Markup("the recording determines {} but not {}").format(
            listed(map(symbol, determined)), listed(map(symbol, not_determined))
        )
    else:
        known = Markup("the recording determines every free parameter ({})").format(
            listed(map(symbol, determined))
        )
    if not f.solver_converged:
        known = Markup("at this count {}").format(known)
    return Markup("{}; {}.").format(solver, known)


def _trust_equilibrium(f: FittedModel, b: Balance) -> Markup:
    lost = int((~b.converged).sum())
    solver = "The rope is in equilibrium in every frame"
    if lost:
        solver = f"{plural(lost, 'frame')} of {len(b.converged)} found no equilibrium"
    told = [_value(name, p) for group in f.groups.values() for name, p in _free(group)]
    if len(f.groups) > 1:
        told = [f"{len(f.groups)} parameter sets were fitted, see below"]
    known = Markup("; {}").format(listed(told)) if told else Markup("; nothing was fitted")
    rest = ""
    if not b.mass_known:
        rest = (
            " Without the rope’s mass, shapes alone fix only ratios to its weight; the bending "
            f"length (EI/w)^⅓ is {metres_or_less(b.bending_length)}."
        )
    return Markup("{}{}.{}").format(solver, known, rest)


def _free(group: ParameterGroup) -> list[tuple[str, Parameter]]:
    return [(name, p) for name, p in group.parameters.items() if p.free]


def _value(name: str, p: Parameter) -> str:
    unit = unit_text(p.unit)
    what = f"the {p.meaning} ({name})"
    if p.below is not None:
        return f"{what} is below {number(p.below)} {unit} (95 %): less makes no visible difference"
    if p.ci95 is None:
        return f"{what} is not determined ({p.verdict})"
    digits = digits_of(p.ci95, 3)
    low, high = (number(value, digits) for value in p.ci95)
    return f"{what} is {number(p.value, digits)} {unit} (95 % interval {low} to {high})"


def _sort(f: FittedModel) -> tuple[list[str], list[str]]:
    """Names of free parameters determined in every group, and of the others."""
    names = {n: [] for g in f.groups.values() for n in g.parameters if g.parameters[n].free}
    for group in f.groups.values():
        for name, found in names.items():
            found.append(group.parameters[name].verdict == "determined")
    return [n for n, v in names.items() if all(v)], [n for n, v in names.items() if not all(v)]


def _key_numbers(o: Observations, f: FittedModel) -> dict[str, str]:
    determined, not_determined = _sort(f)
    solver = "converged" if f.solver_converged else "not converged"
    if f.balance:
        solver = f"{int(f.balance.converged.sum())} of {len(o.frames)} in equilibrium"
    if f.stepped:
        solver = f"{f.stepped.clips} clips in motion"
    unseen = millimetres(f.rms_heldout) if f.rms_heldout is not None else "none held out"
    return {
        "Before the fit": millimetres(rms(f.rms_initial)),
        "After, fitted frames": millimetres(f.rms_fit),
        "After, unseen frames": unseen,
        "Noise of a point": millimetres(float(np.median(o.noise))),
        "Solver": solver,
        "Determined": f"{len(determined)} of {len(determined) + len(not_determined)}",
    }


def _caveats(run: RunContents) -> list[object]:
    o, f = run.observations, run.fitted
    notes: list[object] = []
    if o.ends_assumed:
        notes.append(
            "The recording says nothing about its ends: the ends seen were taken as pinned."
        )
    if o.length_source == "estimated":
        notes.append("The rope’s length was estimated from the frames, not given.")
    if o.noise_source.startswith("assumed"):
        notes.append("The noise was assumed, not measured: comparisons with it are rough.")
    if f is None:
        return notes
    if f.rms_heldout is None:
        notes.append("No frame was held out: how well the fit predicts unseen frames is not known.")
    for name, group in f.groups.items():
        if not group.converged:
            which = f" of {name.replace('_', ' ')}" if len(f.groups) > 1 else ""
            notes.append(f"The search{which} stopped before it arrived: {group.stop_reason}.")
    if any("eta" in name for group in f.groups.values() for name in group.parameters):
        notes.append("The parameters are weights of this simulation (η), not rigidities in N·m².")
    return notes
