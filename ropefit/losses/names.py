"""The names of the losses, for whoever only names one: nothing heavy is imported."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from ropefit.errors import WrongUsage
from ropefit.plugins import LOSSES, names

OWN = tuple(f"OBJ{number}" for number in range(1, 10))

# By which losses pictures alone are compared, in place of those that need points in space.
IN_PICTURES = {
    "OBJ1": "OBJ2", "OBJ3": "OBJ2", "OBJ4": "OBJ5", "OBJ6": "OBJ5", "OBJ7": "OBJ8", "OBJ9": "OBJ8",
}  # fmt: skip


def loss_names() -> list[str]:
    """Return the names of all losses, those of installed add-ons included."""
    return [*OWN, *names(LOSSES)]


def known_loss(name: str) -> str:
    """Return the name of a loss that there is. Raises WrongUsage."""
    if name not in OWN and name not in loss_names():
        raise WrongUsage(f"--loss {name}: one of {', '.join(loss_names())}")
    return name


LossName = Annotated[str, AfterValidator(known_loss)]
