"""Choice and settings of the paper's solver, without its code."""

from __future__ import annotations

from typing import NamedTuple

from ropefit.models.weights import eta_names
from ropefit.solvers.xpbd.settings import Settings

STEP = 1e-6  # of central differences in a logarithm: near divergence the answer is curved


class Algorithm(NamedTuple):
    """How Algorithm 1 is run: the distance solver by its name, steps and iterations; which particle
    the gripper holds, and whether gravity has a weight on each side of it."""

    solver: str
    settings: Settings
    control_node: int = 0
    two_sided: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of its weights."""
        return eta_names(self.two_sided)
