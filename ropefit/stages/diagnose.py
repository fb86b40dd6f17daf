"""diagnose: what the nominal model left out, from observations and the identified rope."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from pydantic import Field

from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.artifacts.diagnosis import Candidate, Cause, Detectable, Region, Size
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.inference.diagnosis import search as engine
from ropefit.inference.diagnosis.motion import next_motion
from ropefit.inference.diagnosis.regions import misfit, regions
from ropefit.inference.diagnosis.weigh import Rival, heldout_rms
from ropefit.inference.equilibrium_rope import ranges
from ropefit.inference.forward import Forward, Term
from ropefit.inference.least_squares import Fit, Noise, fit
from ropefit.inference.terms import ROPE, calibration, rope_term
from ropefit.rod.setup import Setup
from ropefit.solvers.branches import follow
from ropefit.stages.frames import spread_evenly
from ropefit.stages.identify_equilibrium import (
    nearer_branch,
    noise_of,
    priors_of,
    started_setup,
    unit_scale,
)
from ropefit.stages.rope_setup import base_setup, data_in_space, segments_of, surface_sd
from ropefit.stages.shapes_only import shapes_only
from ropefit.stages.stage import Context, Stage, StageSettings

BINS = 40  # stations of a frame
INTERVAL = 1.959964


class DiagnoseSettings(StageSettings):
    """seed of the replicates; most_frames used, evenly spread; nominal: another run's rope."""

    seed: int = 0
    most_frames: int = Field(default=48, ge=4)
    nominal: bool = False


def compute(inputs: dict[str, Any], settings: DiagnoseSettings, context: Context) -> dict[str, Any]:
    """The contents of diagnosis.h5. Raises BadInput, NotConverged, WrongUsage."""
    o: Observations = inputs[Observations.file_name]
    model: Model = inputs[Model.file_name]
    shapes_only(model.nominal, "diagnose")
    if model.nominal.balance is None:
        raise WrongUsage(
            f"the model was fitted by {model.nominal.solver}, whose weights are no properties of "
            "the rope; run ropefit identify --solver equilibrium first"
        )
    if o.source == "rgbd" and len(o.points) == 0:
        raise BadInput("no points in space: the diagnosis needs depth, clouds or markers")
    segments = segments_of(o)
    every, setup = segments // (len(o.node_arc) - 1), base_setup(o, segments)
    used = spread_evenly(
        np.arange(len(o.frames)), np.zeros(len(o.frames), dtype=np.int64), settings.most_frames
    )
    setup, data = setup.frames(torch.from_numpy(used)), data_in_space(o).frames(used)
    source = context.external["nominal"] if settings.nominal else model
    terms, setup = nominal_terms(o, source, setup, prior=settings.nominal)
    noise = noise_of(o, data)
    bins = BINS
    context.progress(0.02, "nominal fit")
    nominal = _nominal(setup, terms, data, noise, bins, o)
    found = engine.search(nominal, data, noise, bins, settings.seed, context.progress)
    return _content(o, found, used, every, bins)


def nominal_terms(
    o: Observations, source: Model, setup: Setup, prior: bool
) -> tuple[list[Term], Setup]:
    """The rope's own parameters, starting where they were identified.

    prior: they are known from another run, within that run's intervals. GJ joins them where both
    clamps hold twist.
    """
    scale = unit_scale(o)
    group = next(iter(source.nominal.groups.values()))
    values = {
        name: p.value
        for name, p in group.parameters.items()
        if name in ("EI", "GJ") and p.verdict != "fixed"
    }
    setup = started_setup(setup, values, scale)
    names = ["EI"]
    if all(setup.clamped) and bool(torch.isfinite(setup.give).all()):
        names.append("GJ")
    if o.length_source == "estimated":
        names.append("length")
    known = ranges(setup)
    terms = []
    for name in names:
        start, low, high = known[name]
        term = rope_term(name, "", start, low, high, ROPE[name])
        p = group.parameters.get(name)
        if prior and p is not None and p.ci95 is not None:
            sd = 0.5 * np.log(p.ci95[1] / p.ci95[0]) / INTERVAL
            term = _with_prior(term, sd)
        terms.append(term)
    return terms, setup


def _with_prior(term: Term, sd: float) -> Term:
    return replace(term, prior=np.array([max(sd, 1e-4)]))


def _nominal(
    setup: Setup, terms: list[Term], data, noise: Noise, bins: int, o: Observations
) -> Fit:
    forward = Forward(
        setup, [*terms, *calibration(setup, priors_of(o), o.ends_assumed, surface_sd(o))]
    )
    start = forward.start()
    forward.last = follow(forward.setup_at(start).rod(), forward.conditions_at(start))
    try:
        first = fit(forward, data, noise, bins, start, 30, tolerance=1e-5)
        forward.last = nearer_branch(first, data, bins)
        return fit(forward, data, noise, bins, first.point.u, 30, tolerance=1e-5)
    except ArithmeticError as error:
        raise NotConverged(f"{error}; look at the ends and the length of the recording")


def _content(
    o: Observations, d: engine.Diagnosis, used: np.ndarray, every: int, bins: int
) -> dict[str, Any]:
    length = o.length
    first, last = d.nominal, d.final
    before, noise = heldout_rms(first)
    after, _ = heldout_rms(last)
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
        "causes": {f"cause_{k}": _cause(item, frames, length) for k, item in enumerate(d.found)}
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
        "refused": d.refused,
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


def _cause(item: engine.Found, frames: np.ndarray, length: float) -> Cause:
    rival, effect = item.rival, item.rival.family.effect
    values, sd = rival.values(), rival.sd()
    named = dict(zip(effect.names, (float(v) for v in values), strict=True))
    return Cause(
        name=effect.name,
        kind=effect.kind,
        variant=type(effect).__name__,
        end=effect.end if effect.locus == "end" else None,
        arc_length=_stretch(rival, named, sd, length),
        frames=_acting(rival, frames),
        parameters=_sizes(rival, values, sd),
        values=values,
        value_names=list(effect.names),
        equivalent_to=sorted({r.family.name for r in item.equivalent}),
        log_evidence=item.evidence,
        p_value=item.p_value,
        heldout_gain=rival.gains,
        sentence=effect.sentence(named),
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


def _sizes(rival: Rival, values: np.ndarray, sd: np.ndarray) -> dict[str, Size]:
    """The quantities with their intervals; a vector as its size first."""
    effect, k = rival.family.effect, rival.family.size
    t = rival.fit.quantile
    out = {}
    if effect.vector:
        name, unit = effect.vector
        size = float(np.linalg.norm(values[:k]))
        place = slice(-rival.term.size, None)
        slope = rival.term.slope(rival.fit.point.u[place])
        covariance = rival.fit.covariance[place, place] * np.outer(slope, slope)
        along = values[:k] / max(size, 1e-300)
        spread = float(np.sqrt(max(along @ covariance[:k, :k] @ along, 0.0)))
        out[name] = Size(value=size, unit=unit, ci95=(max(size - t * spread, 0), size + t * spread))
    for q, v, s in zip(effect.quantities, values, sd, strict=False):
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
        out[q.name] = Size(value=float(v), unit=q.unit, ci95=(float(v - t * s), float(v + t * s)))
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


STAGE = Stage(name="diagnose", reads=(Observations, Model), writes=Diagnosis, compute=compute)
