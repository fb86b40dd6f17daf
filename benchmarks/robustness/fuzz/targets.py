"""What is fuzzed: each reader on a valid source of which one file is replaced.

The valid sources are those of the property tests.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ropefit.artifacts import ARTIFACTS, Artifact, read, write
from ropefit.errors import RopefitError
from ropefit.importers import About
from ropefit.recordings import open_recording
from ropefit.stages.importing import import_recording, list_source
from tests import test_importers_property as importers
from tests import test_parsers_property as readers
from tests.factories import example, resealed

Read = Callable[[Path], object]  # from a directory; may raise RopefitError and nothing else
Target = tuple[Callable[[Path], Path], str, Read]  # make a valid source, glob of its file, read


def _importing(name: str) -> Target:
    make, format, pattern, options = importers.CASES[name]

    def read_source(directory: Path) -> None:
        # Its place is known beside the file that is spoiled, whatever that holds.
        source = directory / Path(pattern).parts[0]
        out = directory / "out"
        shutil.rmtree(out, ignore_errors=True)
        with suppress(RopefitError):
            list_source(source, format)
        import_recording(source, format, out, options, About("r"))
        recording = open_recording(out)
        for frame in recording.frames:
            recording.source.sight(frame)

    def make_source(directory: Path) -> Path:
        directory.mkdir()
        make(directory)
        return directory

    return make_source, pattern, read_source


def _artifact(kind: type[Artifact]) -> Target:
    def make(directory: Path) -> Path:
        directory.mkdir()
        write(directory / kind.file_name, example(kind))
        return directory

    def read_sealed(directory: Path) -> None:
        # Under a seal of its own: else nothing that is spoiled would come as far as HDF5.
        path = directory / kind.file_name
        path.write_bytes(resealed(path.read_bytes()))
        read(path, kind)

    return make, kind.file_name, read_sealed


TARGETS: dict[str, Target] = {
    **{name: case for name, case in readers.CASES.items() if name != "observations.h5"},
    **{kind.file_name: _artifact(kind) for kind in ARTIFACTS},
    **{f"import {name}": _importing(name) for name in importers.CASES},
}
WORDS = [token for token in readers.TOKENS if 0 < len(token) < 40]
