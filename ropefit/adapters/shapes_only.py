"""What needs a rope identified from its shapes at rest."""

from __future__ import annotations

from ropefit.artifacts import FittedModel
from ropefit.errors import WrongUsage


def shapes_only(model: FittedModel, what: str) -> None:
    """Refuse a model of a rope in motion. Raises WrongUsage."""
    if model.stepped:
        raise WrongUsage(
            f"{what} works on a rope at rest, and this one was identified in motion; run "
            "ropefit identify --solver equilibrium first"
        )
