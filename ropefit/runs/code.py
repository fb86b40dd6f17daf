"""A hash of the source that results depend on."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

# What shows or hands on results, and does not change them.
SHOWS = ("reporting/", "viewing/", "sample_data/", "cli", "console", "commands", "api", "__init__")


@cache
def code_sha256() -> str:
    """Hash of the source that results depend on: the whole package but what only shows them."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package).as_posix()
        if not name.startswith(SHOWS):
            digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()
