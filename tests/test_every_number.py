"""Every number of a recording replaced by NaN, ±inf, 0 and 1e30 in turn: a clear line, or an answer
that is right in all frames which the number does not concern."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ropefit.artifacts import Observations, Provenance
from ropefit.errors import RopefitError
from ropefit.recordings import open_recording
from ropefit.runs.protocol import Context
from ropefit.stages import preprocess
from tests.factories import cloud_recording, edit, marker_recording
from tests.test_parsers_property import _is_number, _split

VALUES = ("nan", "inf", "-inf", "0", "1e30")
MOVED = 1e-6  # m: frames that a number does not concern
BENT = 0.02  # m: what the arc lengths, which all frames share, may move them by
FAR = 2.0  # m: beyond it no point of the tiny recordings' ropes can be
PROVENANCE = Provenance(stage="preprocess", package_version="0")


def observed(recording: Path) -> Observations:
    context = Context(external={"recording": open_recording(recording)})
    settings = preprocess.PreprocessSettings(nodes=6, project="no")
    return Observations(provenance=PROVENANCE, **preprocess.compute({}, settings, context))


def answer(recording: Path) -> tuple[Observations | None, str]:
    """Observations, or why there are none."""
    try:
        return observed(recording), ""
    except RopefitError as error:
        return None, str(error)


def spoiled(path: Path, value: str, most: int) -> Iterator[str]:
    """The file with one number after the other replaced (at most so many, evenly spread), and what
    that was; in the end the file is as it was."""
    text = path.read_text()
    words = _split(text)
    numbers = [at for at, word in enumerate(words) if _is_number(word)]
    assert numbers
    for at in np.unique(np.linspace(0, len(numbers) - 1, most).astype(int)):
        at = numbers[at]
        path.write_text("".join([*words[:at], value, *words[at + 1 :]]))
        line = "".join(words[:at]).count("\n") + 1
        yield f"{path.name} line {line}: {words[at]} -> {value}"
    path.write_text(text)


def told(path: Path) -> Path:
    """Markers, and a manifest that says all it can of them."""
    marker_recording(path, rope="length = 1.0\ndiameter = 0.008\nmass = 0.05")
    manifest = path / "recording.toml"
    edit(manifest, "[rope]", "gravity = [0.0, 0.5, -9.8]\n[rope]")
    places = ", ".join(f"{place:.4f}" for place in np.linspace(0, 1, 9))
    priors = "[priors]\nscale = 0.01\ngravity = 1.0\nend_position = 0.002\nlength = 0.01\n"
    with manifest.open("a") as file:
        file.write(f"arc_length = [{places}]\n{priors}")
    return path


CASES: dict[str, tuple[Callable[[Path], Path], str, int]] = {
    "manifest": (told, "recording.toml", 30),
    "markers": (marker_recording, "markers.csv", 60),
    "ends": (marker_recording, "ends.csv", 40),
    "cloud": (lambda path: cloud_recording(path, count=80), "clouds/001.ply", 40),
    "ends of clouds": (lambda path: cloud_recording(path, count=80), "ends.csv", 20),
}


@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize("case", CASES)
def test_a_clear_line_or_a_right_answer(case: str, value: str, tmp_path: Path) -> None:
    make, name, most = CASES[case]
    recording = make(tmp_path / "r")
    right = observed(recording)
    lines = {int(frame): right.centreline[k] for k, frame in enumerate(right.frames)}
    answered = 0
    for what in spoiled(recording / name, value, most):
        found, refusal = answer(recording)
        if found is None:
            assert "\n" not in refusal, what
            assert str(recording) in refusal, (what, refusal)
            continue
        answered += 1
        assert np.isfinite(found.noise).all(), what
        assert 0.1 < found.length < FAR, what
        assert np.nanmax(np.abs(found.centreline)) < FAR, what
        if value == "0":
            continue  # a place like any other: nobody can know that it is wrong
        moved = [
            np.nanmax(np.abs(found.centreline[k] - lines[int(frame)]))
            for k, frame in enumerate(found.frames)
        ]
        assert sum(m > MOVED for m in moved) <= 1 or max(moved) < BENT, (what, moved)
        if case == "manifest":
            assert value == "0", what  # no number of it may be as large as that
    shutil.rmtree(recording)
    if value == "0":
        assert answered, "nothing but refusals"
