"""Open a recording directory: read its manifest, find its sources, its ends and its clock."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from ropefit.errors import BadInput, StageFailed
from ropefit.recordings.clouds import Clouds
from ropefit.recordings.ends import end_times, read_ends
from ropefit.recordings.manifest import inside, read_manifest
from ropefit.recordings.markers import Markers
from ropefit.recordings.recording import Recording
from ropefit.recordings.rgbd import Rgbd
from ropefit.recordings.sources import Source

# Best first: the first that a recording has gives its points. A new reader is one class here.
SOURCES: tuple[type[Source], ...] = (Markers, Clouds, Rgbd)


def open_recording(directory: Path) -> Recording:
    """Return the recording in a directory. Raises BadInput in one line when it is not one."""
    manifest = read_manifest(directory)
    sources = [kind(directory, manifest) for kind in SOURCES if getattr(manifest, kind.table)]
    main = sources[0]
    markers = main if isinstance(main, Markers) else None
    ends = read_ends(directory, manifest, markers) if manifest.ends else None
    files = [directory / "recording.toml", *(file for source in sources for file in source.files())]
    if manifest.ends and manifest.ends.file:
        ends_path = inside(directory, manifest.ends.file)
        files.append(ends_path)
        clock = end_times(ends_path)
        main.time = main.time or clock
    for end, rows in enumerate(ends or ()):
        missing = [frame for frame in main.frames if frame not in rows.position]
        if rows.kind != "free" and len(missing) == len(main.frames):
            raise BadInput(
                f"{directory}: end {end} has no row for any observed frame "
                f"({main.frames[0]}..{main.frames[-1]}); frame numbers must agree"
            )
    return Recording(directory, manifest, main, ends, tuple(files))


def fingerprint(recording: Recording) -> str:
    """Return sha256 over the names and contents of every file the recording consists of."""
    digest = hashlib.sha256()
    for path in sorted(recording.files):
        digest.update(os.fsencode(path.relative_to(recording.path)))
        try:
            with path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        except OSError as error:
            raise BadInput(f"{path}: not readable ({error.strerror})")
    return digest.hexdigest()


def sample_path(name: str = "cloud") -> Path:
    """Return a packaged sample recording: in an installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    for root in (package / "sample_data", package.parent / "sample_data"):
        if (root / name / "recording.toml").is_file():
            return root / name
    raise StageFailed(f"the packaged sample {name!r} is not installed; reinstall ropefit")
