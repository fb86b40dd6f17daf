"""Tables in documents: each benchmark owns the part between its marks."""

from __future__ import annotations

from pathlib import Path

BEGIN, END = "<!-- begin {} -->", "<!-- end {} -->"


def write_section(path: Path, name: str, text: str) -> None:
    """Replace the part of a document between the marks of `name`, or append it."""
    begin, end = BEGIN.format(name), END.format(name)
    block = f"{begin}\n{text}{end}\n"
    old = path.read_text() if path.exists() else "# Results\n\n"
    if begin in old and end in old:
        before, rest = old.split(begin, 1)
        new = before + block + rest.split(end, 1)[1].lstrip("\n")
    else:
        new = old.rstrip("\n") + "\n\n" + block
    path.write_text(new)
