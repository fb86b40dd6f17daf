"""The answer in one line: is something missing, what, and how much that explains; then what rope
this is.

For somebody who knows neither solver nor statistics; on the page and at the end of `ropefit run`.
"""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Diagnosis, FittedModel, Observations, Parameter
from ropefit.artifacts.causes import Cause, Size
from ropefit.reporting.contents import RunContents
from ropefit.reporting.words import (
    common_power,
    digits_of,
    given,
    metres,
    millimetres,
    number,
    plural,
    with_unit,
)

SENSOR = {"clouds": "a point cloud sensor", "rgbd": "a depth camera", "markers": "motion capture"}
HELD = {"pinned": "held but free to turn", "clamped": "held firmly", "free": "loose"}
TENTH = 0.1  # of its length that a piece of rope droops, a measure of its stiffness
TOLD = 0.01  # of the error: smaller gains in millimetres say nothing to a reader
EVERYWHERE = 0.9  # of the rope: a mismatch in all frames along as much of it has no place
AS_GOOD_AS_NOISE, SMALL_REST = 1.25, 2.5  # residual over noise


def answer(run: RunContents) -> list[str]:
    """Return the headline and what stands under it."""
    return [headline(run), *under_it(run)]


def headline(run: RunContents) -> str:
    """Return the one line that is the answer."""
    f, d = run.fitted, run.diagnosis
    if f is None:
        return "No simulation has been fitted to this recording yet: run ropefit identify."
    if d is None:
        return _fit(run.observations, f)
    noise, before, after = (millimetres(v, 3) for v in (d.noise_white, d.rms_before, d.rms_after))
    if d.verdict == "none" and d.rms_before > SMALL_REST * d.noise_white:
        return (
            f"No missing effect was found, but the error on unseen data is {before} and noise "
            f"alone is {noise}: what is left is not explained."
        )
    if d.verdict == "none":
        return (
            f"Nothing is missing that this recording could show: the error on unseen data is "
            f"{before}, and noise alone is {noise}."
        )
    if d.verdict == "unknown":
        return (
            f"Something is missing that no effect ropefit knows explains{_where(d)}: the error on "
            f"unseen data is {before}; noise is {noise}."
        )
    causes = "; and ".join(_without_form(c) for c in d.causes.values())
    text = f"{causes[0].upper()}{causes[1:]}"
    if d.rms_before - d.rms_after < TOLD * d.rms_before:
        return (
            f"{text}: that moves the rope less than single points scatter (noise is {noise}), but "
            "all points together show it."
        )
    return f"{text}: the error on unseen data falls from {before} to {after}; noise is {noise}."


def under_it(run: RunContents) -> list[str]:
    """Return what rope this is, and what else must be known at once."""
    o, f, d = run.observations, run.fitted, run.diagnosis
    text = [_ties(c) for c in d.causes.values() if c.equivalent_to] if d is not None else []
    text.append(_rope(o, f, d))
    if f is not None and (unfinished := _unfinished(o, f)):
        text.append(unfinished)
    if d is not None and d.verdict == "unknown":
        text.append("What is missing may have shifted these values; the intervals leave that out.")
    if d is None and f is not None:
        text.append("Whether something is missing was not looked into: run ropefit diagnose.")
    if d is not None and d.verdict == "none":
        text += filter(None, (d.unseen("weight"), d.unseen("linearity")))
    return text


def rms(values: np.ndarray) -> float:
    """Return root mean square of the rms of frames."""
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
    text = f"This is a rope {about}, {held}, seen by {_sensor(o)} in {frames}"
    return f"{text}{_stiffness(f, o.length, d.rope if d is not None and d.causes else {})}."


def _stiffness(f: FittedModel | None, length: float, along: dict[str, Size]) -> str:
    """Return what was identified, as the end of a sentence. along: as fitted with what was
    missing."""
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
    text = "; " + " and ".join(free[:2]) + more if free else "; nothing was fitted"
    bending = known.get("EI")
    if bending is None or bending.below is not None or bending.verdict == "flat direction":
        return text
    changed = bending.value / group.parameters["EI"].value
    return f"{text}; {_droop(whole.bending_length * changed ** (1 / 3), length)}"


def _with(p: Parameter, size: Size | None) -> Parameter:
    """Return a parameter as it was fitted along with what was missing."""
    if size is None or not p.free:
        return p
    return p.model_copy(update={"value": size.value, "ci95": size.ci95, "unit": size.unit})


def _droop(bending_length: float, length: float) -> str:
    """Return the stiffness as a hand would feel it: a cantilever of length l droops by l⁴ w / (8
    EI)."""
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
    digits, power = digits_of(p.ci95, 3), common_power([p.value, *p.ci95])
    low, high = (number(value, digits, power) for value in p.ci95)
    value = with_unit(number(p.value, digits, power), p.unit)
    return f"{what} is {value} (95 % interval {low} to {high})"


def _fit(o: Observations, f: FittedModel) -> str:
    noise = o.noise_distance
    if f.rms_heldout is None:
        left = f.rms_fit
        text = f"The simulation fits the recording to {millimetres(left)} (no frame was held out)"
    else:
        left = f.rms_heldout
        text = f"The simulation predicts frames it was never shown to {millimetres(left)}"
    ratio = left / noise if noise > 0 else np.inf
    if ratio <= AS_GOOD_AS_NOISE:
        meaning = "a closer fit could not be distinguished from this one"
    elif ratio <= SMALL_REST:
        meaning = "it misses a part of what the rope does"
    else:
        meaning = "it misses something about the rope or the set-up"
    return f"{text}; noise is {millimetres(noise)}: {meaning}."


def _unfinished(o: Observations, f: FittedModel) -> str:
    """Return what must be said at once of a computation that did not arrive."""
    text = []
    if f.iterated and not f.solver_converged:
        moved = millimetres(float(np.median(f.iterated.drift)) * o.length)
        text.append(
            f"The computation was stopped before the rope came to rest (it would move another "
            f"{moved}): the numbers belong to this simulation and not to the rope."
        )
    lost = 0 if f.balance is None else int((~f.balance.converged).sum())
    if lost:
        text.append(f"In {lost} of {plural(len(o.frames), 'frame')} no resting shape was found.")
    if not all(group.converged for group in f.groups.values()):
        text.append("The search stopped before it arrived: its numbers are provisional.")
    return " ".join(text)


def _where(d: Diagnosis) -> str:
    """Return the largest mismatch, as the end of a phrase."""
    if not d.mismatch:
        return ""
    r = d.mismatch[0]
    low, high = (number(v, 2) for v in r.arc_length)
    along = (r.arc_length[1] - r.arc_length[0]) / float(d.node_arc[-1])
    if along > EVERYWHERE and r.frames == (d.frames[0], d.frames[-1]):
        return ""
    return f", most at {low} to {high} m in frames {r.frames[0]} to {r.frames[1]}"


def _without_form(c: Cause) -> str:
    """Return what a cause is; the form of a law and its constants stand in a section of their
    own."""
    text = c.sentence
    if c.law is not None:
        for mark in (f": {c.law.form}", "; its form", "; no known form"):
            text = text.split(mark)[0] if mark != ": " else text
    return text


def _ties(c: Cause) -> str:
    others = " or ".join(name.replace("_", " ") for name in c.equivalent_to)
    return f"It may also be: {others}. This recording does not rule that out."


def _sensor(o: Observations) -> str:
    camera = o.source == "rgbd" and not o.depth_measured
    return "one camera, without depth" if camera else SENSOR[o.source]
