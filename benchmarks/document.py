"""Tables in documents: each benchmark owns the part between its marks."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

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


def parser(description: str | None) -> argparse.ArgumentParser:
    """The options that all benchmarks have."""
    out = argparse.ArgumentParser(description=description)
    out.add_argument("--write", type=Path, default=None, help="document to write the table into")
    out.add_argument("--json", type=Path, default=None, help="file for the numbers")
    return out


def publish(options: argparse.Namespace, name: str, text: str, data: dict[str, Any]) -> None:
    """Print the table; keep the numbers and write the document where asked."""
    print(text)
    if options.json:
        options.json.write_text(json.dumps(data, indent=2) + "\n")
    if options.write:
        write_section(options.write, name, text)
