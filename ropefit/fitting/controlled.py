"""The recording that a rope is known from, as a control: the rope that is handed on must be that
one, and a change has nothing to explain there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.adapters.causes import effect_of
from ropefit.adapters.settings import NOMINAL_OBSERVATIONS, DiagnoseSettings
from ropefit.artifacts import Model, Observations
from ropefit.diagnosis.unexplained import UNLIKE_ELSEWHERE
from ropefit.errors import NotConverged
from ropefit.fitting.posed import KnownRope, posed
from ropefit.inference.least_squares import Fit
from ropefit.runs.protocol import Context


def controlled(
    rope: KnownRope, o: Observations, settings: DiagnoseSettings, context: Context
) -> tuple[KnownRope, Fit | None]:
    """Return a rope as it is handed on to a recording, and the nominal model as fitted to the one
    it is known from; None where there is none of markers, or the two know different weights.

    Where nothing was found, what is missed there counts without the frames at the edge of
    stability, as here. What was found beside the rope there is not handed on: without it, more is
    missed. Where the rope's values were fitted beside that, and miss much without it, the rope is
    taken as it was identified.
    """
    there = context.external.get(NOMINAL_OBSERVATIONS)
    if there is None or not rope.elsewhere or {there.source, o.source} != {"markers"}:
        return rope, None
    if bool(there.mass) != bool(o.mass):
        return rope, None
    fitted, found = _control(there, rope, settings), rope.found
    if fitted is None:
        return rope, None
    missed = float(np.sqrt((fitted.stations.residual**2).sum(axis=1).mean()))
    identified = rope.model.nominal.rms_fit
    if found is None or not found.causes:
        return replace(rope, model=_missing(rope.model, min(identified, missed))), fitted
    most = UNLIKE_ELSEWHERE**0.5 * found.rms_after
    if all(effect_of(cause).of_rope for cause in found.causes.values()):
        return rope, fitted
    if missed <= most:
        return replace(rope, model=_missing(rope.model, max(identified, missed))), fitted
    context.say(
        "warning: what was found in the nominal run is not of the rope alone, and with that of the "
        f"rope alone its own recording is missed by {1e3 * missed:.1f} mm: the rope is taken as "
        "identified there, without what was found"
    )
    rope = replace(rope, model=context.external["nominal"], found=None)
    return rope, _control(there, rope, settings)


def _missing(model: Model, missed: float) -> Model:
    """Return a model that misses its own recording by so much [m rms]."""
    nominal = model.nominal.model_copy(update={"rms_fit": missed})
    return model.model_copy(update={"models": model.models | {"nominal": nominal}})


def _control(there: Observations, rope: KnownRope, settings: DiagnoseSettings) -> Fit | None:
    """Return the nominal model as fitted to another recording without frames at the edge of their
    stability; None where it does not settle there."""
    problem = posed(there, rope, settings)
    try:
        firm = problem.firm()
        return firm[1] if firm else problem.fitted()
    except NotConverged:
        return None
