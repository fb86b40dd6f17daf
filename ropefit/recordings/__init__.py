"""Readers: every input format becomes one Recording."""

from ropefit.recordings.manifest import Manifest
from ropefit.recordings.masks import Masks
from ropefit.recordings.open import fingerprint, open_recording, sample_path
from ropefit.recordings.recording import End, Recording
from ropefit.recordings.sources import Sight, Source, check_spread

__all__ = [
    "End",
    "Manifest",
    "Masks",
    "Recording",
    "Sight",
    "Source",
    "check_spread",
    "fingerprint",
    "open_recording",
    "sample_path",
]
