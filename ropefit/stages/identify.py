"""identify: parameters that make simulation and observations agree."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from ropefit.adapters.scene import check_loss
from ropefit.artifacts import Observations
from ropefit.fitting.settings import IdentifySettings
from ropefit.runs.protocol import Context

LARGE_MISFIT = 3.0  # times the noise of a point: a misfit beyond it has a cause


def compute(inputs: dict[str, Any], settings: IdentifySettings, context: Context) -> dict[str, Any]:
    """Return the contents of model.h5. Raises BadInput, NotConverged, WrongUsage."""
    observations: Observations = inputs[Observations.file_name]
    if settings.how != "least-squares":
        check_loss(observations, settings.loss)
    model = _solver(settings).compute(observations, settings, context)
    if not model.heldout.any():
        context.say("too few frames to hold any out: the fit is judged on its own frames")
    left = float(model.rms_fit)
    noise = observations.noise_distance
    if left > LARGE_MISFIT * noise:
        rod = settings.solver in ("equilibrium", "dynamics")
        more = ", or free more parameters, as by --free EI,rest_curve" if rod else ""
        context.say(
            f"the fit leaves {left * 1e3:.3g} mm where noise is {noise * 1e3:.2g} mm: something is "
            "missing, or the set-up is described wrongly. Look for the cause with ropefit diagnose"
            + more
        )
    return {
        "recording": observations.recording,
        "length": observations.length,
        "frames": observations.frames,
        "models": {"nominal": model},
    }


def _solver(settings: IdentifySettings) -> ModuleType:
    """Return the module that fits by the chosen solver and search; the others are not imported."""
    if settings.solver == "dynamics":
        from ropefit.fitting import motion as chosen
    elif settings.solver != "equilibrium":
        from ropefit.fitting import weights as chosen
    elif settings.how == "least-squares":
        from ropefit.fitting import equilibrium as chosen
    else:
        from ropefit.fitting import searched as chosen
    return chosen
