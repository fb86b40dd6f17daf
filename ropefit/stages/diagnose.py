"""diagnose: the physics or measurement errors that the nominal model leaves out."""

from __future__ import annotations

from typing import Any

from threadpoolctl import threadpool_limits

from ropefit.adapters.settings import DiagnoseSettings
from ropefit.artifacts import Model, Observations
from ropefit.diagnosis.rules import RULES, Rules
from ropefit.errors import WrongUsage
from ropefit.fitting import diagnosed as diagnoses
from ropefit.fitting.simulation import of_simulation, of_weights
from ropefit.runs.protocol import Context


def compute(inputs: dict[str, Any], settings: DiagnoseSettings, context: Context) -> dict[str, Any]:
    """Return the contents of diagnosis.h5. Raises BadInput, NotConverged, WrongUsage."""
    return diagnosed(inputs, settings, context, RULES)


def diagnosed(
    inputs: dict[str, Any], settings: DiagnoseSettings, context: Context, rules: Rules
) -> dict[str, Any]:
    """Return the contents of diagnosis.h5 by other rules. Raises like `compute`."""
    o: Observations = inputs[Observations.file_name]
    model: Model = inputs[Model.file_name]
    with threadpool_limits(1, "blas"):  # small matrices: threads only wait for each other
        if settings.simulation:
            return of_simulation(o, model, settings, context, rules)
        if model.nominal.stepped is not None:
            return diagnoses.in_motion(o, model, settings, context, rules)
        if model.nominal.iterated is not None:
            return of_weights(o, model, settings, context, rules)
        if model.nominal.search != "least-squares":
            raise WrongUsage(
                f"the model was fitted by --search {model.nominal.search}, which allows for no "
                "errors of the set-up; run ropefit identify --solver equilibrium first"
            )
        return diagnoses.at_rest(o, model, settings, context, rules)
