"""identify: parameters that make simulation and observations agree."""

from __future__ import annotations

from typing import Any

from ropefit.adapters.scene import check_loss
from ropefit.artifacts import Observations
from ropefit.fitting import equilibrium, motion, searched, weights
from ropefit.fitting.settings import IdentifySettings
from ropefit.runs.protocol import Context


def compute(inputs: dict[str, Any], settings: IdentifySettings, context: Context) -> dict[str, Any]:
    """Return the contents of model.h5. Raises BadInput, NotConverged, WrongUsage."""
    observations: Observations = inputs[Observations.file_name]
    check_loss(observations, settings.loss)
    if settings.solver == "dynamics":
        return motion.compute(observations, settings, context)
    if settings.solver != "equilibrium":
        return weights.compute(observations, settings, context)
    if settings.how == "least-squares":
        return equilibrium.compute(observations, settings, context)
    return searched.compute(observations, settings, context)
