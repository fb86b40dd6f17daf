"""The names of the losses, for whoever only names one: nothing heavy is imported."""

from __future__ import annotations

from typing import Literal

LossName = Literal["OBJ1", "OBJ2", "OBJ3", "OBJ4", "OBJ5", "OBJ6", "OBJ7", "OBJ8", "OBJ9"]
