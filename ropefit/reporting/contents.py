"""What a report is made from."""

from __future__ import annotations

from dataclasses import dataclass

from ropefit.artifacts import Control, Diagnosis, Exports, FittedModel, Model, Observations


@dataclass(frozen=True)
class RunContents:
    """The artifacts of one run. All but `observations` are None where the stage has not run."""

    observations: Observations
    model: Model | None = None
    control: Control | None = None
    diagnosis: Diagnosis | None = None
    exports: Exports | None = None

    @property
    def fitted(self) -> FittedModel | None:
        """Return the nominal model, if there is one."""
        return self.model.nominal if self.model else None
