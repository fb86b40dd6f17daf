"""The names of the losses, for whoever only names one: nothing heavy is imported."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from ropefit.errors import WrongUsage
from ropefit.plugins import LOSSES, names

OWN = tuple(f"OBJ{number}" for number in range(1, 10))


def loss_names() -> list[str]:
    """Return the names of all losses, those of installed add-ons included."""
    return [*OWN, *names(LOSSES)]


def known_loss(name: str) -> str:
    """Return the name of a loss that there is. Raises WrongUsage."""
    if name not in OWN and name not in loss_names():
        raise WrongUsage(f"--loss {name}: one of {', '.join(loss_names())}")
    return name


LossName = Annotated[str, AfterValidator(known_loss)]
