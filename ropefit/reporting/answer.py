"""The answer in three plain sentences: what rope this is, how well it fits, what was missing.

For somebody who knows neither solver nor statistics; on the page and at the end of `ropefit run`.
"""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Diagnosis, FittedModel, Observations, Parameter
from ropefit.reporting.contents import RunContents
from ropefit.reporting.words import digits_of, given, metres, millimetres, number, plural, unit_text

SENSOR = {"clouds": "a point cloud sensor", "rgbd": "a depth camera", "markers": "motion capture"}
AS_GOOD_AS_NOISE, SMALL_REST = 1.25, 2.5  # residual over noise


def answer(run: RunContents) -> list[str]:
    """The sentences; fewer than three where stages have not run."""
    told = [_rope(run.observations, run.fitted)]
    if run.fitted is None:
        return [*told, "No simulation has been fitted to it yet: run ropefit identify."]
    clean = run.diagnosis is not None and run.diagnosis.verdict == "none"
    told.append(_fit(run.observations, run.fitted, clean))
    return [*told, _missing(run)]


def rms(values: np.ndarray) -> float:
    """Root mean square of the rms of frames."""
    return float(np.sqrt(np.mean(values**2)))


def _rope(o: Observations, f: FittedModel | None) -> str:
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
    told = f"This is a rope {about}, {held}, seen by {SENSOR[o.source]} in {frames}"
    return f"{told}{_stiffness(f)}."


def _stiffness(f: FittedModel | None) -> str:
    """What was identified, as the end of a sentence."""
    if f is None:
        return ""
    if f.balance is None and f.stepped is None:
        return (
            "; it was fitted by weights of the paper’s simulation, which are no properties of a "
            "rope"
        )
    if len(f.groups) > 1:
        return f"; {len(f.groups)} parameter sets were fitted, see below"
    group = next(iter(f.groups.values()))
    free = [_value(name, p) for name, p in group.parameters.items() if p.free]
    return "; " + " and ".join(free) if free else "; nothing was fitted"


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


def _fit(o: Observations, f: FittedModel, clean: bool) -> str:
    """clean: a diagnosis found nothing but noise in what is left."""
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
    ratio = left / noise if noise > 0 else np.inf
    if clean or ratio <= AS_GOOD_AS_NOISE:
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


def _missing(run: RunContents) -> str:
    d = run.diagnosis
    if d is None:
        if run.fitted is not None and run.fitted.balance is None:
            return "What this simulation left out is not known: that needs the equilibrium model."
        return "What the simulation left out was not looked into: run ropefit diagnose."
    if d.verdict == "none":
        return (
            "Nothing was missing that this recording could show: what the simulation does not "
            "explain is noise."
        )
    if d.verdict == "unknown":
        return (
            "Something was missing that no known effect explains: in frames held out of the fit "
            f"{millimetres(d.rms_before)} (rms) are left, where noise alone is "
            f"{millimetres(d.noise_white)}."
        )
    return _found(d)


def _found(d: Diagnosis) -> str:
    causes = [
        c.sentence + (f" (or as well {' or '.join(c.equivalent_to)})" if c.equivalent_to else "")
        for c in d.causes.values()
    ]
    return (
        f"What was missing: {'; and '.join(causes)}; with it, frames held out of the fit are off "
        f"by {millimetres(d.rms_after)} (rms) instead of {millimetres(d.rms_before)}, noise being "
        f"{millimetres(d.noise_white)}."
    )
