"""docs/paper.md: tables of numbers, and what the paper says beside what is found here."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, what was measured here, and why they agree or differ.

    `because` is said only where the outcome is the one that it explains (`explains`); any other
    outcome is reported as unexplained.
    """

    paper: str
    here: str
    agrees: bool
    because: str
    explains: bool = True

    def row(self) -> str:
        word = "agrees" if self.agrees else "**differs**"
        why = self.because if self.agrees == self.explains else "not explained"
        return f"| {self.paper} | {self.here} | {word}: {why} |"


def claims(items: Iterable[Claim]) -> str:
    """Return the table with the column *agrees / differs, because*."""
    head = "| the paper | here | agrees / differs, because |\n|---|---|---|\n"
    return head + "\n".join(item.row() for item in items) + "\n"


def table(columns: list[str], rows: Iterable[Iterable[Any]]) -> str:
    """Return a table in Markdown."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def picture(path: Path, caption: str) -> str:
    """Return a figure beside the document, with its caption."""
    return f"![{path.stem}](figures/{path.name})\n\n*{caption}*\n"


def millimetres(value: float) -> str:
    """Return a length in mm to three digits."""
    return f"{1e3 * value:.3g} mm"


def diagnosed(said: dict[str, Any]) -> str:
    """Return what `ropefit diagnose` found, in one line."""
    found = said["diagnose"]
    if not found["effects"]:
        return f"verdict *{found['verdict']}*, no effect named"
    parts = []
    for effect in found["effects"]:
        name, size = next(iter(effect["parameters"].items()))
        ties = ", ".join(e for e in effect["equivalent_to"] if e != effect["name"])
        interval = " to ".join(f"{v:.3g}" for v in size["ci95"])
        parts.append(
            f"`{effect['name']}`, {name} {size['value']:.3g} {size['unit']} ({interval})"
            + (f", equivalent to {ties}" if ties else "")
        )
    return f"verdict *{found['verdict']}*: " + "; ".join(parts)
