"""Whether effects still hold now that another one is known.

What is found first has to stand for all that is missing, and may win by that. Beside the others
something else may explain more in its place, or there may be nothing left for it to explain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.inference.diagnosis.found import Found, found
from ropefit.inference.diagnosis.gates import winner_of
from ropefit.inference.diagnosis.ties import SET_NATS
from ropefit.inference.diagnosis.weigh import Rival, fit_rival
from ropefit.inference.forward import Forward
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.noise import Noise
from ropefit.inference.stations import Data


def reconsidered(
    current: Fit, accepted: list[Found], threshold: float, looks: int, data: Data, noise: Noise,
    bins: int,
) -> tuple[Fit, list[Found]]:  # fmt: skip
    """The model and its effects, each weighed once more beside the others; the last one only if
    one of them changed, for it was found beside them."""
    out, changed = list(accepted), False
    for one in accepted:
        if one is accepted[-1] and not changed:
            break
        without = _without(current, one.rival, data, noise, bins)
        if without is None:
            continue
        again = replace(one.rival, fit=current)
        held = fit_rival(without, again.family, again.values(), data, noise, bins)
        if held is None:
            continue
        fitted = [fit_rival(without, r.family, r.values(), data, noise, bins) for r in one.beaten]
        rivals = [r for r in (held, *fitted) if r is not None]
        rivals.sort(key=lambda r: -r.evidence)
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


def _without(current: Fit, rival: Rival, data: Data, noise: Noise, bins: int) -> Fit | None:
    """The model without an effect."""
    forward = current.forward
    parts = zip(forward.terms, forward.split(current.point.u), strict=True)
    rest = [(term, part) for term, part in parts if term is not rival.term]
    smaller = Forward(forward.base, [term for term, _ in rest], current.point.solution)
    begin = np.concatenate([part for _, part in rest])
    return attempted(smaller, data, noise, bins, begin, 20, tolerance=1e-5)
