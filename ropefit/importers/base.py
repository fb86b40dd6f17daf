"""What an importer is: a file of some format in, a draft of a recording out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError

from ropefit.errors import BadInput, RopefitError, WrongUsage
from ropefit.importers.draft import Draft

MAX_FRAMES = 1_000_000


class Options(BaseModel):
    """Options of one format, given as `--set NAME=VALUE`; a subclass adds its own fields."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    every: int = 1  # takes every n-th frame
    most_frames: int = 2000


@dataclass(frozen=True)
class Entry:
    """Something a source holds: a topic, a folder, a marker."""

    name: str
    kind: str
    count: int


class Importer(ABC):
    """One format. A subclass is found by its `format` once its module is imported."""

    format: ClassVar[str]
    options: ClassVar[type[Options]] = Options

    @abstractmethod
    def contents(self, source: Path) -> list[Entry]:
        """Return what the source holds, for `--list`. Raises BadInput."""

    @abstractmethod
    def read(self, source: Path, options: Any, draft: Draft) -> None:
        """Put the source's frames into the draft. Raises BadInput."""


@contextmanager
def readable(path: Path, what: str) -> Iterator[None]:
    """Return whatever a library meets in a damaged file becomes one line of BadInput."""
    try:
        yield
    except RopefitError:
        raise
    except Exception as error:
        text = str(error) or type(error).__name__
        raise BadInput(f"{path}: not readable as {what} ({text[:200]})")


def parse_options(kind: type[Importer], given: dict[str, str]) -> Any:
    """Return the options of a format from NAME=VALUE texts. Raises WrongUsage."""
    try:
        return kind.options.model_validate(given)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            known = ", ".join(sorted(kind.options.model_fields))
            raise WrongUsage(f"--set {name}: {kind.format} has no such option; one of {known}")
        raise WrongUsage(f"--set {name}: {first['msg'].removeprefix('Value error, ')}")


def exists(source: Path) -> None:
    """Refuse a source that is not there."""
    if not source.exists():
        raise BadInput(f"{source}: no such file or folder; correct its name")


def thinned(frames: list[Any], options: Options, path: Path) -> list[Any]:
    """Return the frames that `every` and `most_frames` leave."""
    if options.every < 1 or options.most_frames < 1:
        raise WrongUsage("--set every and most_frames: 1 or more")
    left = frames[:: options.every]
    if len(left) > options.most_frames:
        raise WrongUsage(
            f"{path}: {len(left)} frames, most_frames is {options.most_frames}; take fewer with "
            f"--set every={-(-len(frames) // options.most_frames)} or raise --set most_frames"
        )
    return left
