"""`ropefit inspect`: what an artifact or a run holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ropefit.cli.options import Debug, Json, Quiet, start_session


def inspect(
    path: Annotated[Path, typer.Argument(help="An artifact or a run directory.")],
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Show what an artifact or a run holds, and whether it is valid."""
    with start_session(json, quiet, debug) as session:
        from ropefit.errors import BadInput, StageFailed
        from ropefit.reporting.words import unit_text
        from ropefit.stages.inspect import inspect_path

        data = inspect_path(path)
        for item in data["artifacts"]:
            title = f"{item['file']}: {item['schema']} version {item['version']}"
            session.table(
                f"{title}, {'valid' if item['valid'] else 'NOT VALID: ' + item['problem']}",
                ["entry", "shape", "unit", "what"],
                [
                    [e["name"], e["shape"], unit_text(e["unit"]), e["value"]]
                    for e in item["entries"]
                ],
            )
        session.result(data)
        bad = [item for item in data["artifacts"] if not item["valid"]]
        if bad:
            damaged = bad[0]["exit_code"] == BadInput.exit_code
            raise (BadInput if damaged else StageFailed)(bad[0]["problem"])
