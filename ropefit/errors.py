"""The failures a person may meet: each is one line that says what, where and what to do.

The exit codes are part of the command line's contract: 1 failed, 2 wrong usage, 3 bad input data,
4 did not converge.
"""

from __future__ import annotations


class RopefitError(Exception):
    """Base of all failures that are reported in one line; `exit_code` is the process's."""

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
