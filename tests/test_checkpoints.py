"""A stage that is interrupted anywhere and run again ends with the bytes of one that is not."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from ropefit.adapters.control_settings import ControlSettings
from ropefit.adapters.settings import DiagnoseSettings, PreprocessSettings
from ropefit.api.pipeline import CONTROL, DIAGNOSE, IDENTIFY, PREPROCESS
from ropefit.artifacts import Checkpoint, content_sha256, packing, read, store, write
from ropefit.artifacts.packing import packed, unpacked
from ropefit.diagnosis.rules import Rules
from ropefit.errors import StageFailed
from ropefit.fitting.settings import IdentifySettings
from ropefit.recordings import fingerprint, open_recording
from ropefit.runs import checkpoint
from ropefit.runs import journal as journals
from ropefit.runs.checkpoint import checkpoint_name
from ropefit.runs.execute import execute
from ropefit.runs.journal import Entries, Journal, journal, keeping
from ropefit.runs.protocol import Context, Outcome
from ropefit.runs.spilled import Spilled
from ropefit.stages import diagnose
from tests.conftest import ROOT
from tests.factories import marker_recording

FEW = {"most_frames": 4}
PAPER = {"solver": "thomas", "steps": 4, "iterations": 3, "evaluations": 12}
CASES = {
    "preprocess": (PREPROCESS, PreprocessSettings(nodes=7)),
    "identify": (IDENTIFY, IdentifySettings(**FEW)),
    "identify gradient": (IDENTIFY, IdentifySettings(**PAPER, free=["eta_x_G"])),
    "identify grid": (
        IDENTIFY,
        IdentifySettings(**PAPER, search="grid", levels=3, free=["eta_x_G"]),
    ),
    "diagnose": (DIAGNOSE, DiagnoseSettings(**FEW)),
    "control": (CONTROL, ControlSettings(evaluations=8)),
}


class Interrupted(Exception):
    """The process is gone."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording, and a run of it with all that the stages read."""
    base = tmp_path_factory.mktemp("run")
    marker_recording(base / "recording", frames=6)
    for name in ("preprocess", "identify"):
        compute(base / "run", name)
    return base


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """A copy of the run, beside its recording."""
    shutil.copytree(made, tmp_path / "made")
    return tmp_path / "made" / "run"


def compute(run: Path, case: str, say: list[str] | None = None) -> Outcome[Any]:
    stage, settings = CASES[case]
    context = Context(say=[].append if say is None else say.append)
    external = {}
    if stage is PREPROCESS:
        recording = open_recording(run.parent / "recording")
        context.external = {"recording": recording, "debug_images": None}
        external = {"recording": fingerprint(recording)}
    return execute(stage, run, settings, context, external, force=True)


FEW_EFFECTS = Rules(effects=("distributed_load", "scale_error"))  # all would take minutes


@pytest.mark.parametrize("case", CASES)
def test_interrupted_anywhere(case: str, run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saves = [0, 0]  # so many there were; after so many the process is gone

    def counted(saver: checkpoint.Saver, entries: Entries) -> None:
        saves[0] += 1
        if saves[0] == saves[1]:
            saver.save(entries)
            raise Interrupted

    monkeypatch.setattr(checkpoint.Saver, "__call__", counted)
    monkeypatch.setattr(diagnose, "RULES", FEW_EFFECTS)
    whole = content_sha256(compute(run, case).artifact)
    count, said = saves[0], []
    path = run / checkpoint_name(case.split()[0])
    assert count >= 3
    for place in sorted({1, count // 2, count - 1, count}):
        saves[:] = [0, int(place)]
        with pytest.raises(Interrupted):
            compute(run, case)
        assert path.exists()
        saves[:] = [0, 0]
        assert content_sha256(compute(run, case, said).artifact) == whole, place
        assert saves[0] < count - place + 2  # what was found was not found again
        assert not path.exists()
    assert sum("resumed" in text for text in said) >= 3


def test_of_other_settings_or_damaged_it_is_not_used(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = run / checkpoint_name("identify")
    for key in ("", "of another"):
        arrays, data = packed({"fit 1": {"start": np.zeros(1)}})
        made = {"provenance": {"stage": "identify", "package_version": "0"}, "key": key}
        write(path, Checkpoint(**made, arrays=arrays, data=data))
        if not key:
            path.write_bytes(path.read_bytes()[:-900])
        said: list[str] = []
        compute(run, "identify", said)
        assert not any("resumed" in text for text in said)
        assert not path.exists()


def test_a_stage_that_fails_leaves_none(tmp_path: Path) -> None:
    def fails(count: list[int]) -> None:
        with checkpoint.checkpointed(tmp_path, "identify", "k", [].append) as saver:
            saver.next = 0.0
            journal().keep("a", lambda: {"x": np.arange(3.0)})
            assert (tmp_path / checkpoint_name("identify")).exists()
            count.append(1)
            raise StageFailed("no")

    count: list[int] = []
    with pytest.raises(StageFailed):
        fails(count)
    assert count
    assert list(tmp_path.iterdir()) == []


def test_where_it_cannot_be_written_the_stage_goes_on(tmp_path: Path) -> None:
    said: list[str] = []
    with checkpoint.checkpointed(tmp_path / "gone", "identify", "k", said.append) as saver:
        saver.next = 0.0
        journal().keep("a", lambda: {"x": np.arange(3.0)})
    assert said[0].startswith("warning: cannot write")


def test_a_journal_forgets_the_parts_of_what_is_whole() -> None:
    kept = Journal(save=lambda entries: None)
    with keeping(kept):
        assert journal() is kept
        for name in ("fit 1/z 0", "fit 1/z 1", "fit 11/z 0", "fit 1"):
            kept.keep(name, lambda: {"x": np.zeros(2)})
    assert set(kept.entries) == {"fit 11/z 0", "fit 1"}
    assert journal().recall("fit 1") is None
    journal().keep("fit 1", lambda: pytest.fail("nothing is kept"))


def test_a_journal_keeps_no_gaps_when_it_is_full(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journals, "MOST_BYTES", 100.0)
    kept = Journal(save=lambda entries: None)
    for name, count in (("fit 1/z 0", 5), ("fit 1/slope 0", 50), ("fit 1/z 1", 1), ("fit 2", 90)):
        kept.keep(name, lambda count=count: {"x": np.zeros(count)})
    assert set(kept.entries) == {"fit 1/z 0", "fit 2"}  # nothing after what had no room
    kept.keep("fit 1", lambda: {"x": np.zeros(50)})
    assert set(kept.entries) == {"fit 1", "fit 2"}


def test_results_are_put_aside_and_saved_without_being_in_memory_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory: a diagnosis keeps the states of a hundred fits."""
    monkeypatch.setattr(store, "LARGE_ARRAYS", 100_000)  # written into a file, piece by piece
    rng, path = np.random.default_rng(0), tmp_path / checkpoint_name("diagnose")
    results = {f"fit {k}": {"x": rng.normal(size=(3, 4000)), "n": np.arange(k)} for k in range(5)}
    with checkpoint.checkpointed(tmp_path, "diagnose", "k", [].append) as saver:
        saver.next = np.inf
        for name, found in results.items():
            journal().keep(name, lambda found=found: found)
        kept = journal().entries
        assert all(isinstance(entry["x"], Spilled) for entry in kept.values())
        assert all(isinstance(entry["n"], np.ndarray) for entry in kept.values())
        saver.save(kept)
        for name, found in results.items():
            np.testing.assert_array_equal((journal().recall(name) or {})["x"], found["x"])
        assert sum(one.is_file() for one in tmp_path.iterdir()) == 1  # the file aside has no name
    saved, digest = store.read(path, Checkpoint)
    assert digest == content_sha256(saved)
    assert path.stat().st_size < saved.data.nbytes + 100_000
    for name, found in unpacked(saved.arrays, saved.data).items():
        for key, value in found.items():
            np.testing.assert_array_equal(value, results[name][key])


def test_a_large_file_for_which_there_is_no_room_is_not_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """HDF5 may end the process on a full disk."""
    monkeypatch.setattr(store, "LARGE_ARRAYS", 0)
    monkeypatch.setattr(store, "SPARE", 1 << 60)
    said: list[str] = []
    saver = checkpoint.Saver(tmp_path / "a.h5", "x", "k", said.append)
    saver.save({"fit 1": {"x": np.zeros(3)}})
    assert "No space left" in said[0]
    assert list(tmp_path.iterdir()) == []


def test_arrays_of_any_type_and_shape_come_back() -> None:
    results = {
        "a": {"x": np.arange(6.0).reshape(2, 3)[:, ::2], "n": np.array(7), "no": np.empty((0, 4))},
        "b": {"t": np.array("wörds"), "b": np.array([True, False]), "f": np.float32([1.5])},
    }
    arrays, data = packed(results)
    given = {"stage": "x", "package_version": "0"}
    kept = Checkpoint(**{"provenance": given, "key": "", "arrays": arrays, "data": data})
    back = unpacked(kept.arrays, kept.data)
    for result, found in results.items():
        for name, value in found.items():
            np.testing.assert_array_equal(back[result][name], value)
            assert back[result][name].dtype == value.dtype
    spoiled = kept.arrays[0].model_copy(update={"start": data.nbytes})
    with pytest.raises(ValueError, match="not in the data"):
        unpacked([spoiled], kept.data)


def test_a_search_of_the_first_version_is_one_result() -> None:
    fixture = ROOT / "tests" / "fixtures" / "identify.checkpoint.v1.h5"
    saved, _ = read(fixture, Checkpoint)
    found = unpacked(saved.arrays, saved.data)["search 1"]
    with h5py.File(fixture) as file:
        for name in ("u", "loss", "gradient", "inverse", "status", "calm", "trace"):
            np.testing.assert_array_equal(found[name], file[name][()])
        assert found["evaluations"] == int(file["evaluations"].asstr()[()])


def test_arrays_are_written_in_blocks_that_hold_the_same_bytes(monkeypatch):
    monkeypatch.setattr(packing, "AT_ONCE", 100)
    arrays = [np.arange(n, dtype=np.float64) for n in (3, 0, 5, 40, 1, 1)]
    _, data = packed({"fit": {str(k): a for k, a in enumerate(arrays)}})
    blocks = list(data)
    assert [len(block) for block in blocks] == [384, 16]
    assert b"".join(map(bytes, blocks)) == b"".join(a.tobytes() for a in arrays)
