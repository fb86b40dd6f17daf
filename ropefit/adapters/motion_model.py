"""A fit on motion as an artifact."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from ropefit.adapters.motion_of import centrelines
from ropefit.adapters.motion_setup import Span
from ropefit.adapters.parameter_group import Outcome, parameter_group
from ropefit.adapters.scene import build_scene
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Calibration, FittedModel, Observations, Stepped
from ropefit.inference.bins import Data, match, offsets
from ropefit.inference.evaluate import agreement
from ropefit.inference.intervals import Estimates
from ropefit.models.dynamics import MotionPoint
from ropefit.models.parameters import PARAMETERS

AT_ONCE = 500  # frames whose splines are in memory at once


def motion_model(
    o: Observations, span: Span, loss: str, node: int, clips: list[np.ndarray], out: np.ndarray,
    outcome: Outcome, trace: list[float], estimates: Estimates, point: MotionPoint,
    first: np.ndarray, train: np.ndarray,
) -> FittedModel:  # fmt: skip
    """Return the artifact. out (F,): held out; train: indices of the frames of the fit; outcome and
    trace: how that went; point and first: all clips at the fitted parameters, and (F, N+1, 3) [m]
    as seen where the fit set out. Frames of no clip are not simulated: they stay as observed, and
    are marked."""
    nodes, weight = len(o.node_arc), float(np.linalg.norm(o.gravity))
    clip = np.full(len(o.frames), -1)
    for number, frames in enumerate(clips):
        clip[frames] = number
    reached = clip >= 0
    x, before = (at_observed_nodes(o, span, seen, reached) for seen in (point.seen, first))
    middle = 0.5 * (o.node_arc[1:] + o.node_arc[:-1])
    segments = point.setup.segments
    share = (middle - span.first) / (span.last - span.first)
    q = np.zeros((len(o.frames), nodes - 1, 4))
    q[..., 0] = 1.0
    segment = np.clip((share * segments).astype(int), 0, segments - 1)
    q[reached] = point.solution.q[reached][:, segment]
    rms, rms_first = (_rms(span.data, np.nan_to_num(seen), reached) for seen in (point.seen, first))
    calibration, place = {}, 0
    for term, u in zip(point.model.terms, point.model.split(point.u), strict=True):
        slope = term.slope(u)  # of a grip, whose prior is that of its logarithm, relative
        for k, axis in enumerate(term.names if term.nuisance else ()):
            calibration[f"{term.name}_{axis}"] = Calibration(
                unit=term.units[k],
                prior=float(term.prior[k] * (slope[k] if term.log else 1.0)),
                value=float(term.value(u)[k]),
                sd=float(estimates.sd[place + k] * slope[k]),
            )
        place += term.size
    p = point.setup.properties
    return FittedModel(
        solver="dynamics",
        loss=loss,
        search="least-squares",
        control_node=node,
        fixed_nodes=[n for n, k in zip((0, nodes - 1), o.end_kind, strict=True) if k != "free"],
        two_sided=False,
        groups={
            "group_0": parameter_group(
                o.frames, estimates, {}, {n: PARAMETERS[n].range(span.setup) for n in estimates.of},
                stated_units(o), outcome,
            )
        },
        heldout=out & reached,
        x=x,
        q=q,
        x_initial=np.nan_to_num(before),
        residual=_at_nodes(o, span, np.nan_to_num(point.seen)),
        rms=rms,
        rms_initial=rms_first,
        rms_px=agreement(x, build_scene(o)).rms_px,
        solver_converged=True,
        stepped=Stepped(
            segments=point.setup.segments, clips=len(clips), clip=clip,
            newton=point.solution.iterations, mass_known=bool(o.mass),
            bending_length=float((p.bend.mean() / (p.density.mean() * weight)) ** (1 / 3)),
            calibration=calibration,
        ),
        trace=np.array(trace),
        rms_fit=float(np.sqrt(np.mean(rms[train] ** 2))),
        rms_heldout=float(np.sqrt(np.mean(rms[out & reached] ** 2))) if out.any() else None,
    )  # fmt: skip


def _rms(data: Data, x: np.ndarray, reached: np.ndarray) -> np.ndarray:
    """Return (F,) [m] distance of the data from where they were simulated; 0 where they were
    not."""
    gap, mask = offsets(data, x)
    square = np.where(mask, (gap**2).sum(-1), 0.0).sum(1)
    return np.where(reached, np.sqrt(square / np.maximum(mask.sum(1), 1)), 0.0)


def at_observed_nodes(
    o: Observations, span: Span, seen: np.ndarray, reached: np.ndarray
) -> np.ndarray:
    """Return (F, K, 3) [m] the simulated rope at the observations' nodes; as observed outside the
    grips and in frames that were not reached."""
    x = np.nan_to_num(centrelines(o, o.node_arc))
    inside = (o.node_arc >= span.first) & (o.node_arc <= span.last)
    frames = np.flatnonzero(reached)
    for k in range(0, len(frames), AT_ONCE):
        few = frames[k : k + AT_ONCE]
        curve = CubicSpline(span.node_arc, seen[few], axis=1)(o.node_arc[inside])
        x[np.ix_(few, inside)] = curve
    return x


def _at_nodes(o: Observations, span: Span, seen: np.ndarray) -> np.ndarray:
    """Return (F, K) [m] mean distance of the stations nearest to each node, NaN where none is."""
    bins = len(o.node_arc) - 1
    s = match(span.data, seen, bins)
    arc = span.first + s.share * (span.last - span.first)
    node = np.rint(arc / o.length * bins).astype(int)
    total, count = np.zeros((len(seen), bins + 1)), np.zeros((len(seen), bins + 1))
    np.add.at(total, (s.frame, node), np.linalg.norm(s.residual, axis=1))
    np.add.at(count, (s.frame, node), 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
