"""The terminal of a command: sentences on standard error, results on standard output."""

from __future__ import annotations

import json
import sys
import traceback
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rich.console import Console

if TYPE_CHECKING:
    from rich.progress import Progress

    from ropefit.runs.protocol import Context, Outcome


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
        if error is None or isinstance(error, SystemExit):
            return
        if self.debug:
            traceback.print_exception(kind, error, trace)
        from ropefit.failures import as_failure, one_line

        error = as_failure(error)
        self.errors.print(f"ropefit: {one_line(error)}", markup=False, style="bold red")
        raise SystemExit(error.exit_code)

    def say(self, text: str) -> None:
        """Print a line for a person on standard error."""
        if not self.quiet:
            self.errors.print(text, markup=False)

    def progress(self, label: str):
        """Provide a progress function (share, text) for a stage; drawn on terminals only."""
        if self.quiet or not self.errors.is_terminal:
            return lambda share, text: None
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        self.finish()
        self._progress = Progress(
            TextColumn(label),
            BarColumn(),
            TimeElapsedColumn(),  # what remains is not known: fits take as many steps as they need
            TextColumn("{task.description}"),
            console=self.errors,
            transient=True,
        )
        self._progress.start()
        task = self._progress.add_task("", total=1.0)
        bar = self._progress
        return lambda share, text: bar.update(task, completed=share, description=text)

    def context(self, label: str) -> Context:
        """Return where a stage reports its progress and its sentences."""
        from ropefit.runs.protocol import Context

        return Context(self.progress(label), self.say)

    def finished(self, stage: str, outcome: Outcome[Any]) -> None:
        """Say where the artifact of a stage is, and whether it was computed now."""
        self.finish()
        if outcome.computed:
            seconds = outcome.artifact.provenance.seconds
            self.say(f"{stage}: {outcome.path} written in {seconds:.1f} s ({outcome.why})")
        else:
            self.say(f"{stage}: {outcome.path} is up to date (--force computes it again)")

    def finish(self) -> None:
        """Take the progress bar away."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def table(self, title: str, columns: list[str], rows: list[list[str]]) -> None:
        """Print a table for a person."""
        if self.quiet or self.json:
            return
        from rich.table import Table

        table = Table(title=title, title_justify="left", show_edge=False)
        for column in columns:
            table.add_column(column.replace("[", r"\["), overflow="fold")
        for row in rows:
            table.add_row(*(cell.replace("[", r"\[") for cell in row))
        self.out.print(table)

    def answer(self, sentences: list[str]) -> None:
        """Print what a person wanted to know, in whole sentences, on standard output."""
        if not (self.quiet or self.json):
            for sentence in ("", *sentences):
                self.out.print(sentence, markup=False, style="bold")

    def result(self, data: dict[str, Any]) -> None:
        """Print the command's result, as one JSON object when that was asked for."""
        if self.json:
            from ropefit.api.summaries import plain

            sys.stdout.write(json.dumps(plain(data), allow_nan=False) + "\n")
            sys.stdout.flush()


def _console(stderr: bool) -> Console:
    """Return a console whose lines are broken between words on a terminal only."""
    console = Console(stderr=stderr, highlight=False)
    console.soft_wrap = not console.is_terminal
    return console
