"""Any exception as one of the failures that a person may meet."""

from __future__ import annotations

from ropefit.errors import RopefitError, StageFailed, WrongUsage
from ropefit.plugins import add_on_line


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
    what = f"{type(error).__name__}: {error}"
    if at := add_on_line(error):
        return StageFailed(f"{at}: an add-on that fails ({what}); mend it or uninstall it")
    return RopefitError(f"unexpected {what}; this is a bug, run again with --debug")


def one_line(error: BaseException) -> str:
    """Return what an exception says, on one line."""
    return " ".join(str(error).split())
