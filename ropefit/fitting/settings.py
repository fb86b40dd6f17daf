"""The settings of identify: model, loss, search, frames."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from ropefit.errors import WrongUsage
from ropefit.losses.names import LossName
from ropefit.runs.protocol import StageSettings
from ropefit.solvers.names import SolverName

# What a fit uses besides what every fit does; a search adds its own limits.
EVERY_FIT = {"solver", "loss", "search", "free", "control_at", "holdout", "most_frames"}
OF_WEIGHTS = {"start", "groups", "two_sided", "steps", "iterations", "dt", "compliance"}
OF_BATCHED_EQUILIBRIUM = {"start", "groups", "from_run", "device"}
OF_EQUILIBRIUM = {"start", "groups", "from_run", "law"}
OF_SEARCH = {
    "gradient": {"evaluations"},
    "grid": {"levels", "rounds"},
    "least-squares": {"evaluations"},
}


class IdentifySettings(StageSettings):
    """What is fitted, how, to which frames. Distances in m, dt in s.

    from_run: parameters are those of another run's model, apart from the free ones. law: which
    function is fitted as a curve besides.
    """

    solver: SolverName = "equilibrium"
    loss: LossName = "OBJ1"
    search: Literal["gradient", "grid", "least-squares"] | None = None
    free: list[str] | None = None
    start: dict[str, float] = Field(default_factory=dict)
    from_run: bool = False
    law: str | None = None
    groups: str = "one"
    two_sided: bool = False
    control_at: float | None = None
    steps: int = Field(default=50, ge=1, le=1000)
    iterations: int = Field(default=20, ge=1, le=100_000)
    dt: float = Field(default=0.1, gt=0, le=100)
    compliance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    evaluations: int = Field(default=60, ge=1)
    levels: int = Field(default=3, ge=2, le=9)
    rounds: int = Field(default=3, ge=1, le=20)
    holdout: float = Field(default=0.2, ge=0, lt=1)
    most_frames: int = Field(default=60, ge=1)
    device: Literal["cpu", "cuda"] = "cpu"

    @model_validator(mode="after")
    def _together(self) -> IdentifySettings:
        shapes = self.solver == "equilibrium" and self.how == "least-squares"
        if self.law and (not shapes or self.groups != "one"):
            raise WrongUsage(
                "--law is fitted by --solver equilibrium --search least-squares to one rope: leave "
                "out --groups"
            )
        if self.solver == "equilibrium":
            if self.two_sided:
                raise WrongUsage("--two-sided belongs to the paper's solvers: gravity has one size")
        elif self.solver == "dynamics":
            self._on_motion()
        elif self.search == "least-squares":
            raise WrongUsage("--search least-squares needs --solver equilibrium")
        elif self.from_run:
            raise WrongUsage("--from needs --solver equilibrium: weights are no rope's properties")
        if self.device != "cpu" and (self.solver != "equilibrium" or self.how == "least-squares"):
            raise WrongUsage(
                f"--device {self.device} settles many ropes at once: give --search grid or "
                "gradient, with --solver equilibrium, or leave it out"
            )
        return self

    def _on_motion(self) -> None:
        if self.search not in (None, "least-squares"):
            raise WrongUsage("--solver dynamics is fitted by --search least-squares")
        if self.two_sided or self.groups != "one" or self.from_run or self.start:
            raise WrongUsage(
                "--solver dynamics fits one rope from its own start: leave out --two-sided, "
                "--groups, --from and --start"
            )

    @property
    def how(self) -> str:
        """Return the search, chosen by the solver if not given."""
        shapes = self.solver in ("equilibrium", "dynamics")
        return self.search or ("least-squares" if shapes else "gradient")

    def used(self) -> dict[str, Any]:
        """Return the settings that the chosen solver and search use, the search by its name.

        The others may be given and change nothing.
        """
        names = EVERY_FIT | OF_SEARCH[self.how]
        if self.solver == "equilibrium":
            names |= OF_EQUILIBRIUM if self.how == "least-squares" else OF_BATCHED_EQUILIBRIUM
        elif self.solver != "dynamics":
            names |= OF_WEIGHTS
        whole = super().used() | {"search": self.how}
        return {name: value for name, value in whole.items() if name in names}

    @field_validator("compliance")
    @classmethod
    def _positive(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if not all(0 <= alpha < 1e12 for alpha in value):
            raise ValueError("expected three numbers >= 0: shear, bend, distance")
        return value
