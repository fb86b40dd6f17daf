"""Every command and option, as a page.

    python -m benchmarks.robustness.commands [--write docs/commands.md]

Options that all commands have are said once. `tests/test_documents.py` compares page and commands.
"""

from __future__ import annotations

import sys
from enum import Enum
from pathlib import Path
from typing import Any

import typer.main

from ropefit.cli import app

HEAD = """# Commands and options

Written by `python -m benchmarks.robustness.commands --write docs/commands.md` from the command line
itself.

Every command takes `--json` (one JSON object on standard output; words and progress go to standard
error), `--quiet` or `-q` (errors only), `--debug` (tracebacks) and `--help` or `-h`. `ropefit
--version` shows the version; `ropefit --install-completion` makes the shell complete commands and
options, `--show-completion` shows how. Colour is left out where `NO_COLOR` is set or the output is
no terminal. `python -m ropefit` is the same as `ropefit`.

Exit codes: 0 done, 1 failed, 2 wrong usage, 3 bad input data, 4 did not converge.
"""
SHARED = {"--json", "--quiet", "--debug", "--help"}


def page() -> str:
    """Return the whole page in Markdown."""
    group: Any = typer.main.get_command(app)
    return HEAD + "".join(_command(name, command) for name, command in group.commands.items())


def _command(name: str, command: Any) -> str:
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.opts[0] not in SHARED and p not in arguments]
    usage = " ".join([f"`{name}`", *(f"`{p.name.upper()}`" for p in arguments)])
    lines = [f"\n## {usage}\n", command.help, ""]
    lines += [f"{p.name.upper()}: {p.help}\n" for p in arguments if p.help]
    if options:
        lines += ["| option | meaning | default |", "|---|---|---|"]
    lines += [f"| {_names(p)} | {_cell(p.help)} | {_default(p)} |" for p in options]
    return "\n".join(lines) + "\n"


def _names(p: Any) -> str:
    both = " / ".join(f"`{name}`" for name in [*p.opts, *p.secondary_opts])
    kind = getattr(getattr(p, "type_descriptor", None), "annotation", None)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return f"{both}: {', '.join(str(choice.value) for choice in kind)}"
    return both


def _default(p: Any) -> str:
    return "needed" if p.required else "" if p.default in (None, "", False) else _value(p.default)


def _value(value: Any) -> str:
    return str(getattr(value, "value", value))


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def main() -> None:
    text = page()
    if sys.argv[1:2] == ["--write"]:
        Path(sys.argv[2]).write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
