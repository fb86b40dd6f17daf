"""The names of the solvers, for whoever only names one: nothing heavy is imported."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from ropefit.errors import WrongUsage
from ropefit.plugins import SOLVERS, names

OF_RODS, OF_PAPER = ("equilibrium", "dynamics"), ("thomas", "jacobi")


def solver_names() -> list[str]:
    """Return the names of all solvers, those of installed add-ons included."""
    return [*OF_RODS, *OF_PAPER, *names(SOLVERS)]


def known_solver(name: str) -> str:
    """Return the name of a solver that there is. Raises WrongUsage."""
    if name not in (*OF_RODS, *OF_PAPER) and name not in solver_names():
        raise WrongUsage(f"--solver {name}: one of {', '.join(solver_names())}")
    return name


SolverName = Annotated[str, AfterValidator(known_solver)]
