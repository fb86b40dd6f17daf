"""Keywords of the functions in Python, checked as options of the command line are."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any, TypeVar

from pydantic import ValidationError

from ropefit.errors import WrongUsage
from ropefit.runs.protocol import StageSettings

S = TypeVar("S", bound=StageSettings)


def checked_settings(kind: type[S], **values: Any) -> S:
    """Return the settings of a stage. Raises WrongUsage for a keyword or value that is none."""
    unknown = next((name for name in values if name not in kind.model_fields), None)
    if unknown is not None:
        near = get_close_matches(unknown, kind.model_fields, 1)
        hint = f"did you mean {near[0]}?" if near else f"one of {', '.join(kind.model_fields)}"
        raise WrongUsage(f"{unknown}: no such keyword; {hint}")
    try:
        return kind(**values)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(map(str, first["loc"])) or "settings"
        raise WrongUsage(f"{name}: {first['msg'].removeprefix('Value error, ')}")
