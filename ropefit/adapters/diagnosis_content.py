"""What a diagnosis becomes in diagnosis.h5."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ropefit.adapters.equilibrium_model import calibration_of
from ropefit.adapters.units import unit_scale
from ropefit.artifacts import Observations
from ropefit.artifacts.diagnosis import Candidate, Cause, Detectable, Region, Size
from ropefit.inference.diagnosis import search as engine
from ropefit.inference.diagnosis.motion import next_motion
from ropefit.inference.diagnosis.regions import misfit, regions
from ropefit.inference.diagnosis.weigh import Rival, heldout_rms, touches
from ropefit.inference.forward import Forward
from ropefit.inference.least_squares import Fit
from ropefit.inference.uncertainty import INTERVAL


def content(
    o: Observations, d: engine.Diagnosis, used: np.ndarray, every: int, bins: int
) -> dict[str, Any]:
    length = o.length
    first, last = d.nominal, d.final
    along = touches(last)
    before, noise = heldout_rms(first, along)
    after, _ = heldout_rms(last, along)
    frames = o.frames[used]
    motion, separates = "", []
    for item in d.found:
        if item.equivalent:
            motion, apart = next_motion(item.rival, item.equivalent[0])
            separates = [item.rival.family.name, item.equivalent[0].family.name]
            if motion:
                motion = (
                    f"{motion}: the two would differ by {apart * 1e3:.2g} mm (noise of a point "
                    f"{noise * 1e3:.2g} mm)"
                )
            break
    gap = [np.linalg.norm(misfit(f, bins)[:, :bins], axis=-1) for f in (first, last)]
    nodes = len(o.node_arc)
    return {
        "recording": o.recording,
        "verdict": d.verdict,
        "causes": {
            f"cause_{k}": _cause(item, last, frames, length) for k, item in enumerate(d.found)
        }
        if d.verdict == "found"
        else {},
        "scan": {f"{k:02d}_{s.family.name}": _candidate(s) for k, s in enumerate(d.scan)},
        "mismatch": [
            Region(
                arc_length=(r.arc[0] * length, r.arc[1] * length),
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
        "noise_correlated": d.noise.correlated,
        "correlation_length": d.noise.length * length,
        "rms_before": before,
        "rms_after": after,
        "detectable": {
            name: Detectable(value=float(size), unit=d.units[name])
            for name, size in d.detectable.items()
            if np.isfinite(size)
        },
        "segments": last.forward.base.segments,
        "rope": _rope(o, last),
        "calibration": calibration_of(last),
        "motion": motion,
        "separates": separates,
        "frames": frames,
        "node_arc": o.node_arc,
        "x_before": first.point.seen[:, ::every][:, :nodes],
        "x_after": last.point.seen[:, ::every][:, :nodes],
        "station_arc": (np.arange(bins) + 0.5) / bins * length,
        "misfit_before": gap[0],
        "misfit_after": gap[1],
        "force_arc": d.latent.arc * length,
        "force": d.latent.force,
        "force_sd": d.latent.sd,
        "force_evidence": d.latent.evidence,
        "force_threshold": d.latent.threshold,
    }


def _in_part(d: engine.Diagnosis) -> list[str]:
    """What comes nearest, where it does not explain enough to be called the cause."""
    if d.verdict != "unknown" or not d.found:
        return []
    was, left = engine.unexplained(d.nominal), engine.unexplained(d.final)
    joint = [replace(item.rival, fit=d.final) for item in d.found]
    said = "; ".join(f"{rival.family.name}: {_sentence(rival)}" for rival in joint)
    return [f"explains only {100 * (1 - left / was):.0f} % of the misfit: {said}"]


def _sentence(rival: Rival) -> str:
    effect = rival.family.effect
    return effect.sentence(dict(zip(effect.names, map(float, rival.values()), strict=True)))


def _rope(o: Observations, found: Fit) -> dict[str, Size]:
    """EI, GJ, length and rest curve as fitted together with the causes, in the units of the
    model."""
    scale, forward, out, place = unit_scale(o), found.forward, {}, 0
    for term, u in zip(forward.terms, forward.split(found.point.u), strict=True):
        mine = slice(place, place := place + term.size)
        if not set(term.names) <= scale.keys():
            continue
        ends = term.interval(u, found.covariance[mine, mine], found.quantile)
        for name, value, low, high in zip(term.names, term.value(u), *ends, strict=True):
            factor, unit = scale[name]
            out[name] = Size(
                value=factor * float(value), unit=unit,
                ci95=(factor * float(low), factor * float(high)),
            )  # fmt: skip
    return out


def _cause(item: engine.Found, last: Fit, frames: np.ndarray, length: float) -> Cause:
    # Sizes as they are beside all that was found later.
    rival, effect = replace(item.rival, fit=last), item.rival.family.effect
    values, sd = rival.values(), rival.sd()
    named = dict(zip(effect.names, (float(v) for v in values), strict=True))
    return Cause(
        name=effect.name,
        kind=effect.kind,
        variant=type(effect).__name__,
        end=effect.end if effect.locus == "end" else None,
        arc_length=_stretch(rival, named, sd, length),
        frames=_acting(item.rival, frames),
        parameters=sizes_of(rival, values, sd),
        values=values,
        value_names=list(effect.names),
        equivalent_to=sorted({r.family.name for r in item.equivalent}),
        log_evidence=item.evidence,
        p_value=item.p_value,
        heldout_gain=rival.gains,
        sentence=_sentence(rival),
    )


def _stretch(
    rival: Rival, named: dict[str, float], sd: np.ndarray, length: float
) -> tuple[float, float] | None:
    """[m] where it acts: an interval as fitted, a point with its own interval."""
    effect = rival.family.effect
    if effect.locus == "point":
        half = min(max(INTERVAL * float(sd[-1]), 0.005 * length), 0.5 * length)
        low, high = named["arc_length"] - half, named["arc_length"] + half
    elif effect.locus == "interval":
        low = named["centre"] - named["width"] / 2
        high = named["centre"] + named["width"] / 2
    elif effect.locus == "end":
        return (0.0, 0.0) if effect.end == 0 else (length, length)
    else:
        return (0.0, length)
    return float(np.clip(low, 0, length)), float(np.clip(high, 0, length))


def _acting(rival: Rival, frames: np.ndarray) -> np.ndarray:
    """Frames in which the effect moves the rope at all (contact acts in some only)."""
    whole = rival.fit.forward
    without = Forward(whole.base, whole.terms[:-1], rival.fit.point.solution)
    x = without.at(rival.fit.point.u[: -rival.term.size]).seen
    moved = np.nanmax(np.abs(x - rival.fit.point.seen), axis=(1, 2))
    acting = moved > 0.02 * max(float(np.nanmax(moved)), 1e-12)
    return frames[acting]


def sizes_of(rival: Rival, values: np.ndarray, sd: np.ndarray) -> dict[str, Size]:
    """The quantities with their intervals; a vector as its size first."""
    effect, t = rival.family.effect, rival.fit.quantile
    out = {}
    if effect.vector:
        name, unit = effect.vector
        size, spread = rival.sized()
        out[name] = Size(value=size, unit=unit, ci95=(max(size - t * spread, 0), size + t * spread))
    for q, v, s in zip(effect.quantities, values, sd, strict=False):
        s = float(np.hypot(s, q.inexact * v))
        if q.name == "log_factor":
            sign = -1.0 if effect.name == "soft_section" else 1.0
            ends = sorted(float(np.exp(sign * (v + e * t * s))) for e in (-1, 1))
            out["factor"] = Size(value=float(np.exp(sign * v)), unit="1", ci95=(ends[0], ends[1]))
        elif q.name == "compliance":
            high = v - t * s
            out["EA"] = Size(
                value=float(1 / max(v, 1e-300)),
                unit="N",
                ci95=(float(1 / (v + t * s)), float(1 / high) if high > 0 else 1e300),
            )
        low, high = max(v - t * s, q.lower), min(v + t * s, q.upper)  # beyond there is nothing
        out[q.name] = Size(value=float(v), unit=q.unit, ci95=(float(low), float(high)))
    return out


def _candidate(s) -> Candidate:
    return Candidate(
        name=s.family.name,
        variant=type(s.family.effect).__name__,
        log_factor=s.log_factor,
        score=float(np.sqrt(max(s.score, 0.0))),
        place=s.family.places,
        by_place=s.places,
    )
