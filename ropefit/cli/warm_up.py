"""`ropefit warm-up`: the compilation that the first work would wait for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ropefit.cli.options import command

if TYPE_CHECKING:
    from ropefit.cli.console import Session


@command
def warm_up(session: Session) -> None:
    """Compile the solvers for this machine ahead of the first run.

    It happens once: what is compiled is kept for every later command.
    """
    from ropefit.stages.warm_up import warm_up as compile_all

    data = compile_all(session.progress("compile"))
    session.finish()
    count, seconds = data["compiled"], data["seconds"]
    what = f"{count} of {data['loops']} loops compiled in {seconds:.0f} s"
    session.say(f"warm-up: {what if count else 'already compiled'}; kept in {data['folder']}")
    session.result(data)
