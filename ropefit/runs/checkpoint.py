"""What a stage has found so far, in its run: written every few seconds, read when it is run again
with the same code, inputs and settings, removed when the stage is done."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryFile

from ropefit import __version__
from ropefit.artifacts import Checkpoint, Provenance, read, write
from ropefit.artifacts.checkpoint import KeptArray
from ropefit.artifacts.packing import packed, unpacked
from ropefit.errors import RopefitError, StageFailed
from ropefit.runs.journal import Entries, Journal, keeping

EVERY = 10.0  # s
SELDOM = 40  # one that takes long to write is written so much more seldom


def checkpoint_name(stage: str) -> str:
    return Checkpoint.file_name.replace("identify", stage)


@contextmanager
def checkpointed(
    directory: Path, stage: str, key: str, say: Callable[[str], None]
) -> Iterator[Saver]:
    """Keep what is found inside, and go on from what was found before.

    An interrupted stage saves at once. One that fails by itself would fail again: it keeps nothing.
    """
    saver = Saver(directory / checkpoint_name(stage), stage, key, say)
    with ExitStack() as held:
        try:
            aside = held.enter_context(TemporaryFile(dir=directory))
        except OSError:  # no room
            aside = None
        yield from _kept(Journal(saver.restored(), saver, aside), saver)


def _kept(kept: Journal, saver: Saver) -> Iterator[Saver]:
    if kept.entries:
        saver.say(f"{saver.stage}: resumed where it was interrupted")
    try:
        with keeping(kept):
            yield saver
    except KeyboardInterrupt:
        if kept.entries:
            saver.save(kept.entries)
        raise
    except RopefitError:
        saver.remove()
        raise


class Saver:
    """Writes the entries of a journal, not too often."""

    def __init__(self, path: Path, stage: str, key: str, say: Callable[[str], None]):
        self.path, self.stage, self.key, self.say = path, stage, key, say
        self.next = time.monotonic() + EVERY

    def __call__(self, entries: Entries) -> None:
        if time.monotonic() < self.next:
            return
        began = time.monotonic()
        self.save(entries)
        ended = time.monotonic()
        self.next = ended + max(EVERY, SELDOM * (ended - began))

    def save(self, entries: Entries) -> None:
        """Save; where it cannot be written that is said, and the stage goes on."""
        arrays, data = packed(entries)
        provenance = Provenance(stage=self.stage, package_version=__version__)
        items = [KeptArray(**item) for item in arrays]
        # Not validated: the data are never in memory as one.
        checkpoint = Checkpoint.model_construct(
            provenance=provenance, key=self.key, arrays=items, data=data
        )
        try:
            write(self.path, checkpoint)
        except StageFailed as error:
            self.say(f"warning: {error}")

    def restored(self) -> Entries:
        """Return what was found by the same code from the same inputs and settings; else
        nothing."""
        if not self.path.exists():
            return {}
        try:
            saved, _ = read(self.path, Checkpoint)
            found = unpacked(saved.arrays, saved.data) if saved.key == self.key else {}
            return {name: dict(entry) for name, entry in found.items()}
        except (RopefitError, ValueError, TypeError):
            return {}

    def remove(self) -> None:
        self.path.unlink(missing_ok=True)
