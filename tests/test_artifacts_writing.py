"""Writing an artifact: when it fails the old file stays and nothing else does."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from ropefit.artifacts import Checkpoint, Observations, write
from ropefit.errors import StageFailed
from tests.factories import example


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file of observations."""
    file = tmp_path / "observations.h5"
    write(file, example(Observations))
    return file


def _fail_to_replace(*_: object) -> None:
    raise OSError(28, "No space left on device")


def _fail_to_create(error: type[Exception]) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error("No space left on device")

    return fail


@pytest.mark.parametrize("when", ["replace", "fsync", "create", "close"])
def test_failed_write_leaves_the_old_file(
    path: Path, monkeypatch: pytest.MonkeyPatch, when: str
) -> None:
    before = path.read_bytes()
    if when in ("replace", "fsync"):
        monkeypatch.setattr(os, when, _fail_to_replace)
    else:
        error = OSError if when == "create" else RuntimeError
        monkeypatch.setattr(h5py.Group, "create_dataset", _fail_to_create(error))
    with pytest.raises(StageFailed, match=r"cannot write .*No space left.*unchanged"):
        write(path, example(Observations, noise=np.ones(3)))
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == [path.name]


def test_directory_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(StageFailed, match="cannot write"):
        write(tmp_path / "gone" / "checkpoint.h5", example(Checkpoint))
    if os.geteuid() == 0:
        pytest.skip("the superuser may write everywhere")
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(StageFailed, match="cannot write"):
            write(tmp_path / "checkpoint.h5", example(Checkpoint))
    finally:
        tmp_path.chmod(0o700)
    assert os.listdir(tmp_path) == []
