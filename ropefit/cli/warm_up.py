"""`ropefit warm-up`: the compilation that the first work would wait for."""

from __future__ import annotations

from ropefit.cli.options import Debug, Json, Quiet, start_session


def warm_up(json: Json = False, quiet: Quiet = False, debug: Debug = False) -> None:
    """Compile the solvers for this machine ahead of the first run.

    It happens once: what is compiled is kept for every later command.
    """
    with start_session(json, quiet, debug) as session:
        from ropefit.stages.warm_up import warm_up as compile_all

        data = compile_all(session.progress("compile"))
        session.finish()
        count, seconds = data["compiled"], data["seconds"]
        what = f"{count} of {data['loops']} loops compiled in {seconds:.0f} s"
        session.say(f"warm-up: {what if count else 'already compiled'}; kept in {data['folder']}")
        session.result(data)
