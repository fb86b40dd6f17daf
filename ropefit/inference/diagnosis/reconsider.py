"""Whether effects still hold now that another one is known.

What is found first has to stand for all that is missing, and may win by that. Beside the others
something else may explain more in its place, or there may be nothing left for it to explain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.inference.bins import Data
from ropefit.inference.diagnosis.found import Found, found
from ropefit.inference.diagnosis.gates import winner_of
from ropefit.inference.diagnosis.rivals import key_of
from ropefit.inference.diagnosis.ties import SET_NATS
from ropefit.inference.diagnosis.weigh import Rival, fit_rival, weighed
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.noise import Noise
from ropefit.models.equilibrium import Forward, Term


def reconsidered(
    current: Fit, accepted: list[Found], threshold: float, looks: int, data: Data, noise: Noise,
    bins: int,
) -> tuple[Fit, list[Found]]:  # fmt: skip
    """The model and its effects, each weighed once more beside the others; the last one only if
    one of them changed, for it was found beside them."""
    out, changed = list(accepted), False
    for index, one in enumerate(accepted):
        if one is accepted[-1] and not changed:
            break
        without = _without(current, one.rival, data, noise, bins)
        after = [f.rival for f in accepted[index + 1 :]]
        if without is None or not all(
            r.family.effect.applies(without.point.setup) for r in after
        ):  # what was found later rests on it, as friction does on what is touched
            continue
        held = _anew(replace(one.rival, fit=current), [], without, data, noise, bins)
        if held is None:
            continue
        fitted = [fit_rival(without, r.family, r.values(), data, noise, bins) for r in one.beaten]
        later = [replace(r, fit=current) for r in after]
        # What the effect made of the rest is a bad beginning for another in its place; but where
        # it was beaten it stood beside effects that may have been changed since.
        if later and not changed:
            fitted += [_anew(r, later, without, data, noise, bins) for r in one.beaten]
        rivals = _best_of([held, *fitted])
        better = [
            r for r in rivals
            if r.evidence > held.evidence + SET_NATS and r.fit.cost < current.cost
        ]  # fmt: skip
        if not better and 0.5 * (without.cost - current.cost) < threshold and len(out) > 1:
            out = [f for f in out if f is not one]
            current, changed = without, True
            continue
        # Even where it keeps its place, others may explain as much beside the rest.
        now = found(winner_of(better, threshold, without, []) or held, rivals, without, looks)
        out = [now if f is one else f for f in out]
        current, changed = now.rival.fit, changed or now.rival is not held
    return current, out


def _anew(
    rival: Rival, later: list[Rival], without: Fit, data: Data, noise: Noise, bins: int
) -> Rival | None:
    """A rival as it is in its own fit, with later effects on top of that."""
    parts = [*_parts(rival.fit), *(p for r in later for p in _parts(r.fit) if p[0] is r.term)]
    parts.sort(key=lambda part: part[0] is rival.term)
    found = _refitted(rival.fit, parts, data, noise, bins)
    if found is None or len(found.z) != len(without.z):
        return None
    return weighed(rival.family, rival.term, without, found)


def _best_of(fitted: list[Rival | None]) -> list[Rival]:
    """Of each family the rival with the highest evidence, highest first."""
    out: dict[tuple[str, int], Rival] = {}
    for rival in sorted((r for r in fitted if r is not None), key=lambda r: -r.evidence):
        out.setdefault(key_of(rival.family), rival)
    return list(out.values())


def _without(current: Fit, rival: Rival, data: Data, noise: Noise, bins: int) -> Fit | None:
    """The model without an effect."""
    rest = [part for part in _parts(current) if part[0] is not rival.term]
    return _refitted(current, rest, data, noise, bins)


def _parts(found: Fit) -> list[tuple[Term, np.ndarray]]:
    return list(zip(found.forward.terms, found.forward.split(found.point.u), strict=True))


def _refitted(
    found: Fit, parts: list[tuple[Term, np.ndarray]], data: Data, noise: Noise, bins: int
) -> Fit | None:
    """A model of some terms of a fit, in that order, from their values there."""
    forward = Forward(found.forward.base, [term for term, _ in parts], found.point.solution)
    begin = np.concatenate([part for _, part in parts])
    return attempted(forward, data, noise, bins, begin, 20, tolerance=1e-5)
