"""import: a source of some format becomes a recording, all of it or nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ropefit.artifacts.atomic import new_folder
from ropefit.errors import BadInput, WrongUsage
from ropefit.importers import About, Draft, importer, parse_options
from ropefit.recordings import open_recording


def run_import(
    session: Any,
    source: Path,
    format: str,
    out: Path | None,
    given: list[str],
    show: bool,
    about: dict[str, Any],
) -> dict[str, Any]:
    """The command: a source becomes a recording, or (`show`) is listed.

    session: a console.Session, to tell progress and results.
    """
    if show:
        data = list_source(source, format)
        rows = [[entry["name"], entry["kind"], str(entry["count"])] for entry in data["contents"]]
        session.table(str(source), ["name", "kind", "count"], rows)
        return data
    if out is None:
        raise WrongUsage("--out is missing: the recording directory to write (or --list)")
    gravity = _gravity(about["gravity"])
    settings = parse_settings(given)
    rope = {key: about[key] for key in ("length", "diameter", "mass")}
    known = About(about["name"], gravity, **rope)
    data = import_recording(source, format, out, settings, known, session.progress("import"))
    session.finish()
    for note in data["notes"]:
        session.say(f"note: {note}")
    session.say(f"import: {out} written, {data['frames']} frames")
    return data


def _gravity(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(item) for item in text.split(","))
    except ValueError:
        raise WrongUsage(f"--gravity {text}: expected x,y,z")
    return x, y, z


def list_source(source: Path, format: str) -> dict[str, Any]:
    """What a source holds. Raises BadInput, WrongUsage."""
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
    """The draft opened as any recording is, and its first frame read: what is written is valid."""
    try:
        recording = open_recording(temporary)
        recording.source.sight(recording.frames[0])
    except BadInput as error:
        raise BadInput(f"{source}: {str(error).replace(str(temporary), str(out))}")
    return recording


def parse_settings(items: list[str]) -> dict[str, str]:
    """NAME=VALUE options; the last of one name counts. Raises WrongUsage."""
    out = {}
    for item in items:
        name, equals, value = item.partition("=")
        if not equals or not name.strip():
            raise WrongUsage(f"--set {item!r}: expected NAME=VALUE")
        out[name.strip()] = value.strip()
    return out
