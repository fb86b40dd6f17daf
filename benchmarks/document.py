"""Tables in documents: each benchmark replaces the section between its own marks."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from textwrap import fill
from typing import Any

WIDTH = 120  # of a line in the documents
NOT_PROSE = re.compile(r"^([|#!<]|[-*] |```)", re.M)
CODE = re.compile(r"`[^`]*`")
UNBROKEN = "\0"  # stands for a space at which no line may end
BEGIN, END = "<!-- begin {} -->", "<!-- end {} -->"


def write_section(path: Path, name: str, text: str) -> None:
    """Replace the section of a document between the marks of `name`, or append it."""
    begin, end = BEGIN.format(name), END.format(name)
    block = f"{begin}\n{reflowed(text)}{end}\n"
    old = path.read_text() if path.exists() else "# Results\n\n"
    if begin in old and end in old:
        before, rest = old.split(begin, 1)
        new = before + block + rest.split(end, 1)[1].removeprefix("\n")
    else:
        new = old.rstrip("\n") + "\n\n" + block
    path.write_text(new)


def reflowed(text: str) -> str:
    """Return the text with paragraphs of several lines wrapped anew; tables and lists stay."""
    parts = text.rstrip("\n").split("\n\n")
    prose = [part for part in parts if "\n" in part and not NOT_PROSE.search(part)]
    wrapped = {part: _wrapped(part) for part in prose}
    return "\n\n".join(wrapped.get(part, part) for part in parts) + "\n"


def _wrapped(paragraph: str) -> str:
    """Return the paragraph in lines of WIDTH, none broken within a code span."""
    joined = " ".join(paragraph.split())
    whole = CODE.sub(lambda span: span[0].replace(" ", UNBROKEN), joined)
    lines = fill(whole, WIDTH, break_long_words=False, break_on_hyphens=False)
    return lines.replace(UNBROKEN, " ")


def parser(description: str | None) -> argparse.ArgumentParser:
    """Return a parser of the options that all benchmarks have."""
    out = argparse.ArgumentParser(description=description)
    out.add_argument("--write", type=Path, default=None, help="document to write the table into")
    out.add_argument("--json", type=Path, default=None, help="file for the numbers")
    return out


def publish(options: argparse.Namespace, name: str, text: str, data: dict[str, Any]) -> None:
    """Print the table; write the numbers and the document where asked."""
    print(text)
    if options.json:
        options.json.write_text(json.dumps(data, indent=2) + "\n")
    if options.write:
        write_section(options.write, name, text)
