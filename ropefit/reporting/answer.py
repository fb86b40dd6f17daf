"""The answer in three plain sentences: what rope this is, how well it fits, what was missing.

For somebody who knows neither solver nor statistics; on the page and at the end of `ropefit run`.
"""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Diagnosis, FittedModel, Observations, Parameter
from ropefit.artifacts.diagnosis import Cause, Size
from ropefit.reporting.contents import RunContents
from ropefit.reporting.words import digits_of, given, metres, millimetres, number, plural, with_unit

SENSOR = {"clouds": "a point cloud sensor", "rgbd": "a depth camera", "markers": "motion capture"}
HELD = {"pinned": "held but free to turn", "clamped": "held firmly", "free": "loose"}
TENTH = 0.1  # of its length that a piece of rope droops, told as its stiffness
TOLD = 0.1  # of the noise: smaller gains in millimetres say nothing to a reader
AS_GOOD_AS_NOISE, SMALL_REST = 1.25, 2.5  # residual over noise


def answer(run: RunContents) -> list[str]:
    """The sentences; fewer than three where stages have not run."""
    told = [_rope(run.observations, run.fitted, run.diagnosis)]
    if run.fitted is None:
        return [*told, "No simulation has been fitted to it yet: run ropefit identify."]
    told.append(_fit(run.observations, run.fitted, run.diagnosis))
    return [*told, _missing(run)]


def rms(values: np.ndarray) -> float:
    """Root mean square of the rms of frames."""
    return float(np.sqrt(np.mean(values**2)))


def _rope(o: Observations, f: FittedModel | None, d: Diagnosis | None) -> str:
    about = f"{metres(o.length)} long" + (" (estimated)" if o.length_source == "estimated" else "")
    if o.diameter:
        about += f", {given(1e3 * o.diameter)} mm thick"
    if o.mass:
        about += f", {given(1e3 * o.mass)} g"
    first, second = (HELD[kind] for kind in o.end_kind)
    held = f"{first} at the gripper’s end and {second} at the other"
    if first == second:
        held = f"{first} at both ends"
    if o.ends_assumed:
        held = f"assumed to be {held}"
    frames = plural(len(o.frames), "frame")
    told = f"This is a rope {about}, {held}, seen by {SENSOR[o.source]} in {frames}"
    return f"{told}{_stiffness(f, o.length, d.rope if d is not None and d.causes else {})}."


def _stiffness(f: FittedModel | None, length: float, along: dict[str, Size]) -> str:
    """What was identified, as the end of a sentence. along: as fitted with what was missing."""
    if f is None:
        return ""
    whole = f.balance or f.stepped
    if whole is None:
        return (
            "; it was fitted by weights of the paper’s simulation, which are no properties of a "
            "rope"
        )
    if len(f.groups) > 1:
        return f"; {len(f.groups)} parameter sets were fitted, see below"
    group = next(iter(f.groups.values()))
    known = {name: _with(p, along.get(name)) for name, p in group.parameters.items()}
    free = [_value(name, p) for name, p in known.items() if p.free]
    more = f", and {plural(len(free) - 2, 'more number')} below" if len(free) > 2 else ""
    told = "; " + " and ".join(free[:2]) + more if free else "; nothing was fitted"
    bending = known.get("EI")
    if bending is None or bending.below is not None or bending.verdict == "flat direction":
        return told
    changed = bending.value / group.parameters["EI"].value
    return f"{told}; {_droop(whole.bending_length * changed ** (1 / 3), length)}"


def _with(p: Parameter, size: Size | None) -> Parameter:
    """A parameter as it was fitted along with what was missing."""
    if size is None or not p.free:
        return p
    return p.model_copy(update={"value": size.value, "ci95": size.ci95, "unit": size.unit})


def _droop(bending_length: float, length: float) -> str:
    """Stiffness as a hand would feel it: a cantilever of length l droops by l⁴ w / (8 EI)."""
    tenth = (8 * TENTH) ** (1 / 3) * bending_length
    if tenth <= length:
        piece = millimetres(tenth, 3)
        return f"a piece of it {piece} long, held level at one end, would droop by a tenth of that"
    tip = length**4 / (8 * bending_length**3)
    return f"held level at one end, the whole of it would droop by only {millimetres(tip)}"


def _value(name: str, p: Parameter) -> str:
    what = f"its {p.meaning} ({name})"
    if p.below is not None:
        below = with_unit(number(p.below), p.unit)
        return f"{what} is below {below} (95 %): softer makes no difference that could be seen"
    if p.ci95 is None:
        return f"{what} is not determined ({p.verdict})"
    digits = digits_of(p.ci95, 3)
    low, high = (number(value, digits) for value in p.ci95)
    value = with_unit(number(p.value, digits), p.unit)
    return f"{what} is {value} (95 % interval {low} to {high})"


def _fit(o: Observations, f: FittedModel, d: Diagnosis | None) -> str:
    clean = d is not None and d.verdict == "none"  # nothing but noise is left
    noise = d.noise_white if d is not None else float(np.median(o.noise))
    if f.rms_heldout is None:
        left = f.rms_fit
        told = (
            f"The simulation lies {millimetres(left)} on average (rms) from the measured points, "
            f"{millimetres(rms(f.rms_initial))} before it was fitted, but it was shown every "
            "frame: how well it predicts is not known"
        )
    else:
        left = f.rms_heldout
        frames = plural(int(f.heldout.sum()), "frame")
        told = (
            f"In {frames} of the recording that it was never shown, the simulation comes within "
            f"{millimetres(left)} of the measured points on average (rms), where it was "
            f"{millimetres(rms(f.rms_initial[f.heldout]))} off before it was fitted"
        )
    ratio = left / noise if noise > 0 else np.inf
    scatter = f"a measured point itself scatters by {millimetres(noise)}"
    if d is not None and not clean and ratio <= AS_GOOD_AS_NOISE:
        meaning = f"{scatter}, so no single point tells the two apart, but all of them together do"
    elif clean or ratio <= AS_GOOD_AS_NOISE:
        meaning = f"{scatter}, so a closer fit could not be told from this one"
    elif ratio <= SMALL_REST:
        meaning = f"{scatter}, so a part of what the rope does is not explained"
    else:
        meaning = f"{scatter} only, so the simulation misses something about the rope or the set-up"
    return f"{told}; {meaning}{_unfinished(o, f)}."


def _unfinished(o: Observations, f: FittedModel) -> str:
    """What must be said at once of a computation that did not arrive."""
    if f.iterated and not f.solver_converged:
        moved = millimetres(float(np.median(f.iterated.drift)) * o.length)
        return (
            f"; but the computation was stopped before the rope came to rest (it would move "
            f"another {moved}), so the numbers belong to this simulation and not to the rope"
        )
    lost = 0 if f.balance is None else int((~f.balance.converged).sum())
    told = ""
    if lost:
        told = f"; but in {lost} of {plural(len(o.frames), 'frame')} no resting shape was found"
    if not all(group.converged for group in f.groups.values()):
        told += "; but the search stopped before it arrived, so its numbers are provisional"
    return told


def _missing(run: RunContents) -> str:
    d = run.diagnosis
    if d is None:
        if run.fitted is not None and run.fitted.stepped is not None:
            return (
                "Whether something is missing was not looked into: ropefit diagnose does that for "
                "a rope at rest (ropefit identify --solver equilibrium)."
            )
        if run.fitted is not None and run.fitted.balance is None:
            return "What this simulation left out is not known: that needs the equilibrium model."
        return "What the simulation left out was not looked into: run ropefit diagnose."
    if d.verdict == "none":
        return (
            "Nothing was missing that this recording could show: what is left between simulation "
            f"and recording is noise{_would_have_seen(d)}."
        )
    # Told in noise: these fits have calibrations of their own, and other millimetres than _fit's.
    before, after = (number(v / (d.noise_white or np.nan), 2) for v in (d.rms_before, d.rms_after))
    if d.verdict == "unknown":
        return (
            "Something is missing, and no effect that ropefit knows explains it: what is left over "
            f"in frames that it was not shown is {before} times what noise alone would leave, so "
            "trust it only for motions like this one."
        )
    causes = "; and ".join(map(_cause, d.causes.values()))
    if d.rms_before - d.rms_after < TOLD * d.noise_white:
        return (
            f"What was missing: {causes}; what that changes is less than single points scatter, "
            "but beyond chance over the whole recording."
        )
    return (
        f"What was missing: {causes}; with that, what is left over in frames that it was not shown "
        f"falls from {before} to {after} times what noise alone would leave."
    )


def _cause(c: Cause) -> str:
    if not c.equivalent_to:
        return c.sentence
    others = " or ".join(name.replace("_", " ") for name in c.equivalent_to)
    return f"{c.sentence} (this recording cannot tell it from: {others})"


def _would_have_seen(d: Diagnosis) -> str:
    """The smallest weight on the rope that would not have been missed, as an example."""
    weight = d.detectable.get("point_mass")
    if weight is None or weight.unit != "kg":
        return ""
    return f"; a weight of {number(1e3 * weight.value, 2)} g on the rope would have been noticed"
