"""Diagnoses of a recording: of ropes at rest, and in motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ropefit.adapters.diagnosis_content import Layout, content
from ropefit.adapters.motion_model import at_observed_nodes
from ropefit.adapters.settings import NOMINAL_DIAGNOSIS, NOMINAL_OBSERVATIONS, DiagnoseSettings
from ropefit.adapters.taken_over import TakenOver, as_found, noise_there, over_mass, understood
from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.artifacts.causes import Cause
from ropefit.artifacts.observations import DroppedFrame
from ropefit.diagnosis import search as engine
from ropefit.diagnosis.control import Controlled
from ropefit.diagnosis.fewer_frames import FoundBefore
from ropefit.diagnosis.noise_measurement import on_edge
from ropefit.diagnosis.rules import Rules
from ropefit.errors import BadInput
from ropefit.fitting.controlled import controlled
from ropefit.fitting.nominal_motion import UNRESOLVED, nominal_in_motion
from ropefit.fitting.posed import KnownRope, Posed, posed
from ropefit.inference.least_squares import Fit
from ropefit.runs.protocol import Context

UNSTABLE = "at the edge of stability"
OUTSIDE = "as their shapes depend on what was before or after the recording"


def in_motion(
    o: Observations, model: Model, settings: DiagnoseSettings, context: Context, rules: Rules
) -> dict[str, Any]:
    """Diagnose the stepped rope. Raises BadInput, NotConverged, WrongUsage."""
    context.progress(0.02, "nominal fit")
    source, found = None, None
    if settings.nominal:
        source, found = _as_diagnosed(context.external["nominal"], context)
        source = over_mass(source, context.external.get(NOMINAL_OBSERVATIONS, o), o)
    calibration = context.external["calibration"] if settings.calibration else None
    span, nominal, known, lost = nominal_in_motion(
        o, model, settings.most_frames, source, found, calibration, context.say
    )
    result = engine.search(nominal, settings.seed, context.progress, rules)
    dropped = _dropped(o.frames[lost], UNRESOLVED)
    was, still = nominal.problem.data.mask, result.final.problem.data.mask
    dropped += lost_with_effects(was, still, o.frames, context.say)
    shown = np.unique(nominal.stations.frame)
    reached = np.isin(np.arange(len(o.frames)), shown)

    def nodes(seen: np.ndarray) -> np.ndarray:
        return at_observed_nodes(o, span, seen, reached)[shown]

    layout = Layout(o.frames, shown, span.first, span.last - span.first, nodes)
    fields = {"known": _as_fitted(known, result.final), "dropped": dropped}
    return content(o, result, layout) | fields


def at_rest(
    o: Observations, model: Model, settings: DiagnoseSettings, context: Context, rules: Rules
) -> dict[str, Any]:
    """Diagnose the rope in equilibrium. Raises BadInput, NotConverged, WrongUsage."""
    if o.source == "rgbd" and len(o.points) == 0:
        raise BadInput("no points in space: the diagnosis needs depth, clouds or markers")
    context.progress(0.02, "nominal fit")
    calibrated = context.external["calibration"] if settings.calibration else None
    rope, control = KnownRope(model, calibration=calibrated), None
    if settings.nominal:
        source, found = _as_diagnosed(context.external["nominal"], context)
        rope = KnownRope(source, found, source.recording != o.recording, calibrated)
        rope, control = controlled(rope, o, settings, context)
    problem = posed(o, rope, settings, rules.calibration, control)
    if control:
        rules = replace(rules, selection=Controlled(control))
    firm = problem.firm()
    if firm is None:
        raise BadInput(
            "nearly every frame is at the edge of its stability, where the least disturbance "
            "decides the shape; record poses in which the rope hangs firmly"
        )
    dropped = _unstable(o, problem, firm[0], context)
    problem, nominal = firm
    rules = replace(rules, most_evaluations=settings.evaluations)
    result = engine.search(nominal, settings.seed, context.progress, rules)
    edge = on_edge(result.final)  # with an effect, other frames may be near instability
    ended = result.final.problem.work.exhausted
    firm = problem.without(edge).firm() if edge.any() and not ended else None
    if firm is not None:
        left = np.flatnonzero(np.isin(problem.used, firm[0].used))
        dropped += _unstable(o, problem, firm[0], context)
        problem, nominal = firm
        before = FoundBefore(result.accepted, result.final, result.of_known, left)
        result = engine.search(nominal, settings.seed, context.progress, rules, before)
    was, still = nominal.problem.data.mask, result.final.problem.data.mask
    dropped += lost_with_effects(was, still, o.frames[problem.used], context.say)
    nodes, every = len(o.node_arc), problem.setup.segments // (len(o.node_arc) - 1)
    layout = Layout(
        o.frames[problem.used], np.arange(len(problem.used)), 0.0, o.length,
        lambda x: x[:, ::every][:, :nodes],
    )  # fmt: skip
    fields = {"known": _as_fitted(problem.taken, result.final), "dropped": dropped}
    return content(o, result, layout) | fields


def _unstable(o: Observations, was: Posed, now: Posed, context: Context) -> list[DroppedFrame]:
    """Return the frames that are in a problem no longer, as excluded, and say so."""
    return _dropped(o.frames[np.setdiff1d(was.used, now.used)], UNSTABLE, context.say)


def _dropped(
    frames: np.ndarray, reason: str, say: Callable[[str], None] | None = None
) -> list[DroppedFrame]:
    """Return frames (n,), by their numbers, as excluded for a reason; say so, if there are any."""
    if say and len(frames):
        say(f"excluded, {reason}: frames {', '.join(map(str, frames))}")
    return [DroppedFrame(frame=int(number), reason=reason) for number in frames]


def lost_with_effects(
    was: np.ndarray, still: np.ndarray, frames: np.ndarray, say: Callable[[str], None]
) -> list[DroppedFrame]:
    """Return the frames, numbers (F,), that were compared (mask (F, ...)) and are not any more."""
    rows = was.reshape(len(frames), -1).any(axis=1) & ~still.reshape(len(frames), -1).any(axis=1)
    return _dropped(frames[rows], OUTSIDE, say)


def _as_diagnosed(source: Model, context: Context) -> tuple[Model, Diagnosis | None]:
    """Return the nominal run's model, and its diagnosis, as fitted along with what was found."""
    found = context.external.get(NOMINAL_DIAGNOSIS)
    if found is None:
        context.say(
            "warning: the nominal run was not diagnosed: what its rope has besides its rigidity is "
            "not known here and may be taken for a change; run `ropefit diagnose` on it"
        )
        return source, None
    if not understood(source, found):
        before, after, noise = (
            f"{1e3 * v:.1f} mm" for v in (found.rms_before, found.rms_after, noise_there(found))
        )
        context.say(
            f"warning: what was found in the nominal run leaves {after} of {before} (noise "
            f"{noise}): it is not the whole cause, and the rope is taken as identified there, "
            "without it"
        )
        return source, None
    if found.verdict == "unknown":
        context.say("warning: the nominal run misses something unknown; it may be missed here, too")
    return as_found(source, found), found


def _as_fitted(known: list[TakenOver], final: Fit) -> dict[str, Cause]:
    """Return causes of the nominal run with their values as fitted here."""
    parts = list(zip(final.forward.terms, final.forward.split(final.point.u), strict=True))
    out = {}
    for name, cause, term in known:
        u = next(part for one, part in parts if one is term)
        out[name] = cause.model_copy(update={"values": term.value(u)})
    return out
