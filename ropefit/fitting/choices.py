"""What was asked of a fit of a rope at rest: control point, free parameters, first values."""

from __future__ import annotations

from ropefit.adapters.frozen import frozen_values
from ropefit.adapters.scene import node_at
from ropefit.adapters.shapes_only import shapes_only
from ropefit.artifacts import Observations
from ropefit.errors import WrongUsage
from ropefit.fitting.settings import IdentifySettings
from ropefit.models import rest_curve
from ropefit.models.parameters import AT_REST, offered
from ropefit.runs.protocol import Context


def held_node(o: Observations, control_at: float | None) -> int:
    """Return the control point as a node: an end. Raises WrongUsage for a place inside."""
    node = node_at(o, control_at)
    if 0 < node < len(o.node_arc) - 1:
        raise WrongUsage(
            f"--control-at {control_at:g}: the equilibrium rope is held at its ends only; give 0 "
            f"or {o.length:g}, or --solver thomas"
        )
    return node


def given_values(o: Observations, settings: IdentifySettings, context: Context) -> dict[str, float]:
    """Return where parameters start or stay, as asked for: another run's, then the user's. Raises
    WrongUsage."""
    if not settings.from_run:
        return settings.start
    where = f"--from {context.external['from_path']}"
    shapes_only(context.external["from"].nominal, where)
    return frozen_values(context.external["from"], where, o) | settings.start


def free_names(settings: IdentifySettings, o: Observations) -> list[str]:
    """Return the parameters that are fitted. Raises WrongUsage."""
    free = settings.free
    if free is None and settings.from_run:
        return []
    if free is None:
        return ["EI"] + (["length"] if o.length_source == "estimated" else [])
    free = rest_curve.spelled_out(free)
    for name in free:
        if name not in AT_REST:
            raise WrongUsage(f"unknown parameter {name}; one of {offered(AT_REST)}")
    return free
