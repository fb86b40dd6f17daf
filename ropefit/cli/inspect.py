"""`ropefit inspect`: what an artifact, a run or a recording holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ropefit.cli.options import command

if TYPE_CHECKING:
    from ropefit.cli.console import Session


@command
def inspect(
    session: Session,
    path: Annotated[
        Path,
        typer.Argument(
            help="An artifact, a run directory, a recording, or a source that can be imported."
        ),
    ],
) -> None:
    """Show what an artifact, a run or a recording holds, and whether it is valid.

    Of a recording, everything that preprocess needs is checked, and nothing is written.
    """
    from ropefit.api.inspect_recording import (
        inspect_recording,
        inspect_source,
        is_recording,
        source_format,
    )
    from ropefit.errors import BadInput, StageFailed
    from ropefit.reporting.words import unit_text
    from ropefit.stages.inspect import inspect_path

    if is_recording(path):
        session.result(_shown(session, inspect_recording(path)))
        return
    if source_format(path):
        session.result(_shown(session, inspect_source(path)))
        return
    data = inspect_path(path)
    for item in data["artifacts"]:
        title = f"{item['file']}: {item['schema']} version {item['version']}"
        session.table(
            f"{title}, {'valid' if item['valid'] else 'NOT VALID: ' + item['problem']}",
            ["entry", "shape", "unit", "what"],
            [[e["name"], e["shape"], unit_text(e["unit"]), e["value"]] for e in item["entries"]],
        )
    session.result(data)
    bad = [item for item in data["artifacts"] if not item["valid"]]
    if bad:
        damaged = bad[0]["exit_code"] == BadInput.exit_code
        raise (BadInput if damaged else StageFailed)(bad[0]["problem"])


def _shown(session: Session, data: dict[str, Any]) -> dict[str, Any]:
    """Print the summary of a recording or of a source, and its warnings; return it."""
    session.table(data["title"], ["", ""], [list(row) for row in data["summary"]])
    for warning in data["warnings"]:
        session.say(f"warning: {warning}")
    session.say(data["next"])
    return data
