"""The shape of every stage: declared inputs -> its own settings -> a pure function -> artifact."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ConfigDict

from ropefit.artifacts import Artifact

S = TypeVar("S", bound="StageSettings")
A = TypeVar("A", bound=Artifact)


class StageSettings(BaseModel):
    """Settings of one stage. What it uses of them is recorded, and makes it stale."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    def used(self) -> dict[str, Any]:
        """Return the settings that the output depends on, as JSON has them: all, or fewer."""
        return self.model_dump(mode="json")

    def sha256(self) -> str:
        text = json.dumps(self.used(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


Progress = Callable[[float, str], None]  # (share done in 0..1, what is going on)


@dataclass
class Context:
    """What a stage may use besides its inputs: where to tell progress, and things it was given."""

    progress: Progress = lambda share, text: None
    say: Callable[[str], None] = lambda text: None
    external: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Stage(Generic[S]):
    """A subcommand's work: compute(inputs by name, settings, context) -> the artifact's contents.

    Inputs from outside the run directory (a recording, a target file) come in `Context.external`;
    whoever executes the stage gives their hashes.
    """

    name: str
    reads: tuple[type[Artifact], ...]
    writes: type[Artifact]
    compute: Callable[[dict[str, Any], S, Context], dict[str, Any]]

    @property
    def module(self) -> str:
        """Return the stage's own module, on whose code and imports the output depends."""
        return f"ropefit.stages.{self.name}"


@dataclass(frozen=True)
class Outcome(Generic[A]):
    """The artifact, its path, and whether it was computed now or found up to date."""

    artifact: A
    path: Path
    computed: bool
    why: str
