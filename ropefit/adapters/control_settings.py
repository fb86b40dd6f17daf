"""The settings of control."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from ropefit.losses.names import LossName
from ropefit.runs.protocol import StageSettings


class ControlSettings(StageSettings):
    """loss for an estimate; key: arc lengths [m] of key points to predict; turn: also the
    orientation."""

    loss: LossName = "OBJ1"
    key: list[float] = Field(default_factory=list)
    turn: bool | None = None  # None: not in an estimate, yes in shape control
    evaluations: int = Field(default=200, ge=1)
    target: bool = False

    def used(self) -> dict[str, Any]:
        """Return the settings that the output depends on: a target replaces loss and key points."""
        return {
            name: value
            for name, value in super().used().items()
            if not (self.target and name in ("loss", "key"))
        }
