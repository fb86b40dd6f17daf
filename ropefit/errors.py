"""The failures a person may meet: each is one line that says what, where and what to do.

The exit codes are part of the command line's contract: 1 failed, 2 wrong usage, 3 bad input data,
4 did not converge.
"""

from __future__ import annotations


class RopefitError(Exception):
    """Base of all failures that are told in one line; `exit_code` is the process's."""

    exit_code = 1


class StageFailed(RopefitError):
    """A stage cannot do its work: a missing or stale artifact, an unwritable directory."""


class WrongUsage(RopefitError):
    """The command line asks for something that does not exist or does not go together."""

    exit_code = 2


class BadInput(RopefitError):
    """The data given are wrong: a missing frame, an unknown key, NaN, impossible geometry."""

    exit_code = 3


class NotConverged(RopefitError):
    """A solve or a fit did not arrive; nothing it returned may be used as a number."""

    exit_code = 4


def as_failure(error: BaseException) -> RopefitError:
    """Return any exception as a failure that is said in one line, with its exit code."""
    from pydantic import ValidationError

    if isinstance(error, RopefitError):
        return error
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        name = "--" + str(first["loc"][0] if first["loc"] else "settings").replace("_", "-")
        return WrongUsage(f"{name}: {first['msg'].removeprefix('Value error, ')}")
    if isinstance(error, ImportError):
        from ropefit.system import missing_library, remedy

        library = missing_library(str(error))
        return RopefitError(
            remedy(library) if library else f"{error}; run pip install ropefit again"
        )
    if isinstance(error, KeyboardInterrupt):
        return RopefitError("stopped; what was finished is kept, run the same command to go on")
    if isinstance(error, MemoryError):
        return RopefitError("out of memory; use fewer frames, points or nodes")
    if isinstance(error, BrokenPipeError):
        return RopefitError("the reader of the output went away")
    if isinstance(error, OSError):
        what = error.strerror or type(error).__name__
        return RopefitError(f"{error.filename or 'file system'}: {what}; give another path")
    return RopefitError(
        f"unexpected {type(error).__name__}: {error}; this is a bug, run again with --debug"
    )


def one_line(error: BaseException) -> str:
    """Return what an exception says, on one line."""
    return " ".join(str(error).split())
