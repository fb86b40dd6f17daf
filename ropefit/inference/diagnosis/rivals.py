"""Full fits of what a scan, motion and contact propose, on top of a model."""

from __future__ import annotations

import numpy as np

from ropefit.effects import SupportPlane
from ropefit.inference.bins import Data
from ropefit.inference.diagnosis.branch_repair import repaired
from ropefit.inference.diagnosis.contact import Start, bars_under, uneven
from ropefit.inference.diagnosis.evidence import Scored
from ropefit.inference.diagnosis.families import Family
from ropefit.inference.diagnosis.profile import profile
from ropefit.inference.diagnosis.weigh import Rival, fit_rival
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.models.equilibrium import Forward

LEADERS = 6
PLANE = (SupportPlane.__name__, 0)
NEGLIGIBLE = 0.15  # of the first misfit: what may stay unexplained once an effect is found


def fit_rivals(
    current: Fit, scan: list[Scored], driven: list[list[Start]], touching: list[list[Start]],
    data: Data, noise: Noise, bins: int, threshold: float,
) -> list[Rival]:  # fmt: skip
    """Full fits of the families that a scan puts in front, of what motion proposes, and, unless the
    best of these leaves next to nothing, of contact."""
    highest = max((s.log_factor for s in scan), default=0.0)
    leaders = [s for s in scan if s.log_factor > min(threshold, 0.5 * highest)][:LEADERS]
    starts = [
        [(s.family, np.concatenate([sizes, place]))]
        for s in leaders
        if s.log_factor > 0.6 * threshold
        for sizes, place in s.starts()
    ]
    out: dict[tuple[str, int], Rival] = {}

    def weigh(choices: list[Start]) -> None:
        fitted = (fit_rival(current, family, at, data, noise, bins) for family, at in choices)
        rival = next((rival for rival in fitted if rival is not None), None)
        if rival is None:
            return
        better = repair(rival.fit, data, noise, bins)
        if better is not rival.fit:
            rival = fit_rival(current, rival.family, rival.values(), data, noise, bins) or rival
        key = key_of(rival.family)
        if key not in out or rival.evidence > out[key].evidence:
            out[key] = rival

    for choices in starts + driven:
        weigh(choices)

    def best() -> Rival | None:
        return max(out.values(), key=lambda r: r.evidence, default=None)

    def wanting(rival: Rival) -> bool:
        return unexplained(rival.fit) > NEGLIGIBLE * unexplained(current)

    first = best()
    if (
        first
        and first.family.effect.locus == "interval"
        and first.evidence > threshold
        and wanting(first)
    ):
        start = profile(current, first.family, data, noise, bins)
        weigh([] if start is None else [(first.family, start)])
        first = best()
    if first is None or wanting(first) or uneven(first.fit):
        for choices in touching:  # these cost the most
            weigh(choices)
        plane = out.get(PLANE)
        if plane and plane is best() and plane.evidence > threshold:
            height, *slopes = plane.values()
            for choices in bars_under(plane.fit, height, np.array(slopes)):
                weigh(choices)
    return sorted(out.values(), key=lambda r: -r.evidence)


def unexplained(found: Fit) -> float:
    """χ² beyond what noise has."""
    return float(found.z @ found.z) - len(found.z)


def key_of(family: Family) -> tuple[str, int]:
    """What tells families apart: their effect, and the end it sits at."""
    return type(family.effect).__name__, family.effect.end


def repair(found: Fit, data: Data, noise: Noise, bins: int) -> Fit:
    """Frames on the wrong branch are brought to the right one, and the fit repeated."""
    states = repaired(found, data, bins)
    if states is None:
        return found
    forward = Forward(found.forward.base, found.forward.terms, states)
    again = fit(forward, data, noise, bins, found.point.u, 20, tolerance=1e-5)
    return again if again.cost < found.cost else found
