"""What a person (or a script) sees: progress and words on standard error, results on standard
output."""

from __future__ import annotations

import json
import sys
import traceback
from types import TracebackType
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ropefit.errors import RopefitError, WrongUsage


class Session:
    """One command: owns the terminal, turns failures into one line and an exit code."""

    def __init__(self, json: bool = False, quiet: bool = False, debug: bool = False):
        self.json, self.quiet, self.debug = json, quiet, debug
        self.errors = _console(stderr=True)
        self.out = _console(stderr=json)
        self._progress: Progress | None = None

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.finish()
        if error is None or isinstance(error, (typer.Exit, SystemExit)):
            return
        if self.debug:
            traceback.print_exception(kind, error, trace)
        error = as_failure(error)
        self.errors.print(f"ropefit: {one_line(error)}", markup=False, style="bold red")
        raise SystemExit(error.exit_code)

    def say(self, text: str) -> None:
        """A line for a person, on standard error."""
        if not self.quiet:
            self.errors.print(text, markup=False)

    def progress(self, label: str):
        """A progress function (share, text) for a stage; drawn on terminals only."""
        if self.quiet or not self.errors.is_terminal:
            return lambda share, text: None
        self.finish()
        self._progress = Progress(
            TextColumn(label),
            BarColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.description}"),
            console=self.errors,
            transient=True,
        )
        self._progress.start()
        task = self._progress.add_task("", total=1.0)
        bar = self._progress
        return lambda share, text: bar.update(task, completed=share, description=text)

    def finish(self) -> None:
        """Take the progress bar away."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def table(self, title: str, columns: list[str], rows: list[list[str]]) -> None:
        """A table for a person."""
        if self.quiet or self.json:
            return
        table = Table(title=title, title_justify="left", show_edge=False)
        for column in columns:
            table.add_column(column.replace("[", r"\["), overflow="fold")
        for row in rows:
            table.add_row(*(cell.replace("[", r"\[") for cell in row))
        self.out.print(table)

    def answer(self, sentences: list[str]) -> None:
        """What a person wanted to know, in whole sentences, on standard output."""
        if not (self.quiet or self.json):
            for sentence in ("", *sentences):
                self.out.print(sentence, markup=False, style="bold")

    def result(self, data: dict[str, Any]) -> None:
        """The command's result, as one JSON object when that was asked for."""
        if self.json:
            sys.stdout.write(json.dumps(plain(data), allow_nan=False) + "\n")
            sys.stdout.flush()


def _console(stderr: bool) -> Console:
    """Lines are broken between words on a terminal, and left whole in a file or a pipe."""
    console = Console(stderr=stderr, highlight=False)
    console.soft_wrap = not console.is_terminal
    return console


def as_failure(error: BaseException) -> RopefitError:
    """Any exception as a failure that is told in one line, with its exit code."""
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
    """What an exception says, on one line."""
    return " ".join(str(error).split())


def plain(value: Any) -> Any:
    """JSON without NaN: numpy to Python, non-finite numbers to null."""
    import numpy as np

    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
