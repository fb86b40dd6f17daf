"""What a diagnosis has found, put back into a setup."""

from __future__ import annotations

from collections.abc import Iterable

from ropefit.artifacts import Diagnosis
from ropefit.artifacts.causes import Cause
from ropefit.effects import Effect
from ropefit.errors import StageFailed
from ropefit.plugins import EFFECTS, concrete
from ropefit.rod.setup import Setup


def with_causes(setup: Setup, diagnosis: Diagnosis) -> Setup:
    """Return the setup with every cause of a diagnosis, and those that its nominal run's rope has,
    but errors of a solver, which no rope has. Raises StageFailed for effects not installed."""
    return changed_by(setup, (*diagnosis.known.values(), *diagnosis.causes.values()))


def changed_by(setup: Setup, causes: Iterable[Cause]) -> Setup:
    """Return the setup with causes, but errors of a solver. Raises StageFailed."""
    for cause in causes:
        effect = effect_of(cause)
        if effect.kind != "solver":
            setup = effect.apply(setup, cause.values)
    return setup


def effect_of(cause: Cause) -> Effect:
    """Return the effect of the catalogue, or of an add-on, that a cause names. Raises
    StageFailed."""
    for kind in concrete(Effect, EFFECTS):
        if kind.__name__ == cause.variant:
            return kind(cause.end or 0)  # pyright: ignore[reportAbstractUsage]
    raise StageFailed(f"the effect {cause.variant} of diagnosis.h5 is not installed here")
