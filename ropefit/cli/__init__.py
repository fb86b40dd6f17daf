"""The command line. One command a file: options are parsed, `ropefit.api` or a stage does the work,
the command says what came out. Nothing heavy is imported before a command runs."""

from ropefit.cli.app import app, main

__all__ = ["app", "main"]
