"""The contents of diagnosis.h5, from a diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ropefit.adapters.equilibrium_model import calibration_of
from ropefit.adapters.law_content import constant_law, law_of
from ropefit.adapters.unit_mass import per_unit_mass
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Observations
from ropefit.artifacts.causes import Cause, Size
from ropefit.artifacts.diagnosis import Candidate as Scanned
from ropefit.artifacts.diagnosis import Detectable, Region
from ropefit.diagnosis import search as engine
from ropefit.diagnosis.candidate import Candidate, columns_of
from ropefit.diagnosis.held_out import by_stretches, held_out_pit, heldout_rms
from ropefit.diagnosis.next_motion import next_motion
from ropefit.diagnosis.open_places import half_interval
from ropefit.diagnosis.regions import misfit, regions
from ropefit.diagnosis.repeated_poses import repeated_noise
from ropefit.diagnosis.scan import Score
from ropefit.inference.least_squares import Fit

ACTING_SHARE = 0.02  # of the greatest move of a node: frames with less are not acted on


@dataclass(frozen=True)
class Layout:
    """How a model's rows are those of a recording.

    frames (F,): numbers of the rows' frames, of which those in `shown` are kept; first, length [m]:
    where the model's rope begins, and how long it is; nodes: from the model's nodes in all rows to
    the recording's (S, K, 3), in the rows shown.
    """

    frames: np.ndarray
    shown: np.ndarray
    first: float
    length: float
    nodes: Callable[[np.ndarray], np.ndarray]


def content(o: Observations, d: engine.Diagnosis, layout: Layout) -> dict[str, Any]:
    """Return the fields of the artifact."""
    length = layout.length
    first, last = d.nominal, d.final
    noise_found, bins = first.problem.noise, first.problem.bins
    along = by_stretches(last)
    before, _ = heldout_rms(first, along)
    after, noise = heldout_rms(last, along)
    frames, shown = layout.frames, layout.shown
    motion, separates, shapes = "", [], None
    for item in d.accepted:
        if item.equivalent:
            motion, apart, shapes = next_motion(item.candidate, item.equivalent[0])
            separates = [item.candidate.hypothesis.name, item.equivalent[0].hypothesis.name]
            if motion:
                motion = (
                    f"{motion}: the two would differ by {apart * 1e3:.2g} mm (noise of a point "
                    f"{noise * 1e3:.2g} mm)"
                )
            break
    gap = [np.linalg.norm(misfit(f, bins)[:, :bins], axis=-1) for f in (first, last)]
    fields = {
        "recording": o.recording,
        "verdict": d.verdict,
        "causes": {f"cause_{k}": _cause(o, item, d, layout) for k, item in enumerate(d.accepted)}
        if d.verdict == "found"
        else {},
        "scan": {f"{k:02d}_{s.hypothesis.name}": _scanned(s) for k, s in enumerate(d.scan)},
        "mismatch": [
            Region(
                arc_length=(layout.first + r.arc[0] * length, layout.first + r.arc[1] * length),
                frames=(int(frames[r.frames[0]]), int(frames[r.frames[1]])),
                rms=r.rms,
                direction=tuple(float(v) for v in r.direction),  # type: ignore[arg-type]
            )
            for r in regions(first, bins)
        ]
        if d.verdict != "none"
        else [],
        "refused": d.refused + _in_part(d),
        "threshold": d.threshold,
        "noise_white": noise,
        "noise_repeated": repeated_noise(last),
        "noise_correlated": noise_found.correlated,
        "correlation_length": noise_found.length * length,
        "rms_before": before,
        "rms_after": after,
        "detectable": _detectable(d),
        "segments": last.forward.base.segments,
        "rope": _rope(o, last),
        "calibration": calibration_of(last),
        "motion": motion,
        "separates": separates,
        "motion_x": None if shapes is None else np.stack([layout.nodes(x) for x in shapes]),
        "pit": held_out_pit(last, along),
        "frames": frames[shown],
        "node_arc": o.node_arc,
        "x_before": layout.nodes(first.point.seen),
        "x_after": layout.nodes(last.point.seen),
        "station_arc": layout.first + (np.arange(bins) + 0.5) / bins * length,
        "misfit_before": gap[0][shown],
        "misfit_after": gap[1][shown],
        "force_arc": layout.first + d.latent.arc * length,
        "force": d.latent.force[shown],
        "force_sd": d.latent.sd[shown],
        "force_evidence": d.latent.evidence,
        "force_threshold": d.latent.threshold,
    }
    return fields if o.mass else per_unit_mass(fields)


def _in_part(d: engine.Diagnosis) -> list[str]:
    """Describe the effects that come nearest, where they are not said to be the cause."""
    if d.verdict != "unknown" or not d.accepted:
        return []
    was, left = engine.unexplained(d.nominal), engine.unexplained(d.final)
    joint = [replace(item.candidate, fit=d.final) for item in d.accepted]
    said = "; ".join(f"{candidate.hypothesis.name}: {_sentence(candidate)}" for candidate in joint)
    share = 100 * min(1 - left / was, 1)
    return [f"what comes nearest, explaining {share:.0f} % of the misfit: {said}"]


def _sentence(candidate: Candidate) -> str:
    effect = candidate.hypothesis.effect
    return effect.sentence(dict(zip(effect.names, map(float, candidate.values()), strict=True)))


def _detectable(d: engine.Diagnosis) -> dict[str, Detectable]:
    """Return the least sizes that would have been found, and what they mean to a reader."""
    effects = {score.hypothesis.name: score.hypothesis.effect for score in d.scan}
    out = {}
    for name, size in d.detectable.items():
        if np.isfinite(size):
            topic, sentence = effects[name].unseen(float(size))
            out[name] = Detectable(
                value=float(size), unit=d.units[name], topic=topic, sentence=sentence
            )
    return out


def _rope(o: Observations, found: Fit) -> dict[str, Size]:
    """Return EI, GJ, length and rest curve as fitted with the causes, in the units of the model."""
    scale, forward, out, place = stated_units(o), found.forward, {}, 0
    for term, u in zip(forward.terms, forward.split(found.point.u), strict=True):
        mine = slice(place, place := place + term.size)
        # A cause may have the names of parameters: of a rest curve.
        if term.effect is not None or not set(term.names) <= scale.keys():
            continue
        ends = term.interval(u, found.covariance[mine, mine], found.quantile)
        for name, value, low, high in zip(term.names, term.value(u), *ends, strict=True):
            factor, unit, _ = scale[name]
            out[name] = Size(
                value=factor * float(value), unit=unit,
                ci95=(factor * float(low), factor * float(high)),
            )  # fmt: skip
    return out


def _cause(o: Observations, item: engine.Accepted, d: engine.Diagnosis, layout: Layout) -> Cause:
    # Sizes as fitted beside all effects that were accepted later.
    last = d.final
    candidate, effect = replace(item.candidate, fit=last), item.candidate.hypothesis.effect
    values, sd = candidate.values(), candidate.sd()
    named = dict(zip(effect.names, (float(v) for v in values), strict=True))
    law, parameters = law_of(o, candidate, last), sizes_of(candidate, values, sd)
    # What else may stand in the place of another effect, or nothing.
    beside = [replace(candidate, fit=fitted) for of, fitted in d.alternatives if of is not item]
    beside += [h.of(candidate) for h in d.held_places if h.term is not candidate.term]
    held = [h.of(candidate) for h in d.held_places if h.term is candidate.term]
    for other in (*beside, *held):
        parameters = holding_both(parameters, other)
    return Cause(
        name=effect.name,
        kind=effect.kind,
        variant=type(effect).__name__,
        end=effect.end if effect.locus == "end" else None,
        arc_length=_stretch(candidate, named, beside, layout),
        frames=_acting(item.candidate, layout),
        parameters=parameters,
        values=values,
        value_names=list(effect.names),
        covariance=candidate.covariance_of_values(),
        equivalent_to=sorted({r.hypothesis.name for r in item.equivalent}),
        log_evidence=item.evidence,
        p_value=item.p_value,
        heldout_gain=candidate.gains,
        sentence=law[1] if law else _sentence(candidate),
        law=law[0] if law else constant_law(effect, parameters),
    )


def _stretch(
    candidate: Candidate, named: dict[str, float], beside: list[Candidate], layout: Layout
) -> tuple[float, float] | None:
    """Return where it acts [m]: an interval as fitted, a point with its confidence interval,
    which also holds those of the same effect in other fits, `beside`."""
    first, length = layout.first, layout.length
    effect = candidate.hypothesis.effect
    if effect.locus == "point":
        ends = np.array([_place(one, length) for one in (candidate, *beside)])
        low, high = ends[:, 0].min(), ends[:, 1].max()
    elif effect.locus == "interval":
        low = named["centre"] - named["width"] / 2
        high = named["centre"] + named["width"] / 2
    elif effect.locus == "end":
        low = high = 0.0 if effect.end == 0 else length
    else:
        low, high = 0.0, length
    low, high = np.clip((low, high), 0, length)
    return first + float(low), first + float(high)


def _place(candidate: Candidate, length: float) -> tuple[float, float]:
    """Return the confidence interval of the place of a point [m]."""
    place, half = float(candidate.values()[-1]), half_interval(float(candidate.sd()[-1]), length)
    return place - half, place + half


def _acting(candidate: Candidate, layout: Layout) -> np.ndarray:
    """Return the frames in which the effect moves the rope (contact acts in some only)."""
    fit, term = candidate.fit, candidate.term
    rest = [one for one in fit.forward.terms if one is not term]
    without = fit.forward.with_terms(rest, fit.point.solution)
    x = without.at(np.delete(fit.point.u, columns_of(fit, term))).seen
    moved = np.nan_to_num(np.abs(x - candidate.fit.point.seen)).max(axis=(1, 2))
    acting = moved > ACTING_SHARE * max(float(np.nanmax(moved)), 1e-12)
    return layout.frames[layout.shown[acting[layout.shown]]]


def sizes_of(candidate: Candidate, values: np.ndarray, sd: np.ndarray) -> dict[str, Size]:
    """Return the quantities with their intervals; a vector's size first."""
    effect, t = candidate.hypothesis.effect, candidate.fit.quantile
    out = {}
    if effect.vector:
        name, unit = effect.vector
        size, spread = candidate.magnitude()
        spread = float(np.hypot(spread, size * max(q.inexact for q in effect.quantities)))
        out[name] = Size(value=size, unit=unit, ci95=(max(size - t * spread, 0), size + t * spread))
    searched = zip(*candidate.interval(t), strict=True)
    limits = zip(candidate.term.lower, candidate.term.upper, strict=True)
    every = zip(effect.quantities, values, sd, searched, limits, strict=False)
    for q, v, s, ends, (least, most) in every:
        half = t * float(np.hypot(s, q.inexact * v))
        low, high = ends if q.saturates else (v - half, v + half)
        if q.derived:
            of = q.derived.of
            ends = sorted((of(float(low)), of(float(high))))
            out[q.derived.name] = Size(
                value=of(float(v)), unit=q.derived.unit, ci95=(ends[0], ends[1])
            )
        bounded = (float(max(low, least)), float(min(high, most)))
        out[q.name] = Size(value=float(v), unit=q.unit, ci95=bounded)
    return out


def holding_both(sizes: dict[str, Size], other: Candidate) -> dict[str, Size]:
    """Return sizes with intervals that hold those of another fit of the same effect, too."""
    out = {}
    for name, also in sizes_of(other, other.values(), other.sd()).items():
        (low, high), (other_low, other_high) = sizes[name].ci95, also.ci95
        ends = min(low, other_low), max(high, other_high)
        out[name] = sizes[name].model_copy(update={"ci95": ends})
    return out


def _scanned(s: Score) -> Scanned:
    return Scanned(
        name=s.hypothesis.name,
        variant=type(s.hypothesis.effect).__name__,
        log_factor=s.log_factor,
        score=float(np.sqrt(max(s.score, 0.0))),
        place=s.hypothesis.places,
        by_place=s.places,
    )
