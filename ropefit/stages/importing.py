"""import: a source of some format becomes a recording, all of it or nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ropefit.artifacts.atomic import new_folder
from ropefit.errors import BadInput
from ropefit.importers import About, Draft, importer, parse_options
from ropefit.recordings import open_recording


def list_source(source: Path, format: str) -> dict[str, Any]:
    """Return what a source holds. Raises BadInput, WrongUsage."""
    entries = importer(format)().contents(source)
    return {
        "stage": "import",
        "source": str(source),
        "contents": [{"name": e.name, "kind": e.kind, "count": e.count} for e in entries],
    }


def import_recording(
    source: Path,
    format: str,
    out: Path,
    given: dict[str, str],
    about: About,
    progress: Callable[[float, str], None] = lambda share, text: None,
) -> dict[str, Any]:
    """Write the recording directory `out`; a failure leaves nothing there.

    given: NAME=VALUE options of the format. Raises BadInput, WrongUsage, StageFailed.
    """
    kind = importer(format)
    options = parse_options(kind, given)
    with new_folder(out) as temporary:
        draft = Draft(temporary, about, progress)
        kind().read(source, options, draft)
        draft.finish()
        recording = _checked(temporary, out, source)
    return {
        "stage": "import",
        "recording": str(out),
        "format": format,
        "frames": len(recording.frames),
        "ends": None if recording.ends is None else [end.kind for end in recording.ends],
        "notes": draft.notes,
    }


def _checked(temporary: Path, out: Path, source: Path) -> Any:
    """Return the draft opened as any recording is, and its first frame read: what is written is
    valid."""
    try:
        recording = open_recording(temporary)
        recording.source.sight(recording.frames[0])
    except BadInput as error:
        raise BadInput(f"{source}: {str(error).replace(str(temporary), str(out))}")
    return recording
