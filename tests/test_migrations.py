"""Artifacts of every earlier schema version still open; the fixtures were written by that code."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from ropefit.artifacts import ARTIFACTS, Artifact, Checkpoint, Model, read
from ropefit.artifacts.migrations import SHARP, migrated
from ropefit.artifacts.store import leaves
from ropefit.effects import ClampedEnd, Kink
from ropefit.errors import BadInput
from ropefit.stages.inspect import inspect_path
from tests.conftest import ROOT

FIXTURES = ROOT / "tests" / "fixtures"
FILES = [(kind, version) for kind in ARTIFACTS for version in range(1, kind.schema_version + 1)]


def fixture(kind: type[Artifact], version: int) -> Path:
    return FIXTURES / f"{Path(kind.file_name).stem}.v{version}.h5"


@pytest.mark.parametrize(("kind", "version"), FILES, ids=lambda value: str(value))
def test_every_version_opens_with_its_numbers(kind: type[Artifact], version: int) -> None:
    path = fixture(kind, version)
    artifact, digest = read(path, kind)
    found = {name: value for name, value, _ in leaves(artifact)}
    compared = 0
    with h5py.File(path) as file:
        assert file.attrs["schema_version"] == version
        assert file.attrs["content_sha256"] == digest

        def check(name: str, node: object) -> None:
            nonlocal compared
            if isinstance(node, h5py.Dataset) and name in found and node.dtype.kind not in "OS":
                np.testing.assert_array_equal(found[name], node[()], err_msg=name)
                compared += 1

        file.visititems(check)
    if (kind, version) != (Checkpoint, 1):  # whose arrays have become one: test_checkpoints.py
        arrays = sum(isinstance(value, np.ndarray) for value in found.values())
        assert compared >= 0.5 * arrays
    assert inspect_path(path)["artifacts"][0]["valid"]


def test_the_first_models_iterations_are_kept() -> None:
    model, _ = read(fixture(Model, 1), Model)
    iterated = model.nominal.iterated
    assert iterated is not None
    with h5py.File(fixture(Model, 1)) as file:
        for name in ("drift", "length_error", "iteration"):
            np.testing.assert_array_equal(
                getattr(iterated, name), file[f"models/nominal/{name}"][()]
            )


@pytest.mark.parametrize("version", [1, 2])
def test_an_old_file_that_was_edited_is_refused(version: int, tmp_path: Path) -> None:
    path = tmp_path / "model.h5"
    shutil.copy(fixture(Model, version), path)
    with h5py.File(path, "r+") as file:
        file["models/nominal/rms"][0] += 1.0
    with pytest.raises(BadInput, match="hash"):
        read(path, Model)


def test_links_that_multiply_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.h5"
    shutil.copy(fixture(Model, 1), path)
    with h5py.File(path, "r+") as file:
        group = file["models"]
        for depth in range(40):  # 2^40 ways down
            below = group.create_group(f"b{depth}")
            group[f"c{depth}"] = below
            group = below
    with pytest.raises(BadInput, match=r"more than it can hold|never ends"):
        read(path, Model)


@pytest.mark.parametrize("version", [0, -5, 99, 10**18])
def test_unknown_versions_are_refused(version: int, tmp_path: Path) -> None:
    path = tmp_path / "model.h5"
    shutil.copy(fixture(Model, 2), path)
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = version
    with pytest.raises(BadInput, match=f"version {version}"):
        read(path, Model)


def test_clamps_and_kinks_of_the_second_diagnoses_are_told_as_now() -> None:
    clamp = {
        "value_names": ["stiffness_x", "stiffness_y", "stiffness_z"],
        "values": np.array([0.0, 0.03, 0.04]),
    }
    kink = {
        "value_names": ["angle_1", "angle_2", "arc_length"],
        "values": np.array([0.1, 0.2, 0.5]),
    }
    tree = {"causes": {"cause_0": clamp, "cause_1": kink}, "node_arc": np.array([0.0, 0.8])}
    now = migrated("ropefit-diagnosis", 2, 3, tree)
    assert now is not None
    held, bent = now["causes"].values()
    assert tuple(held["value_names"]) == ClampedEnd().names
    assert held["values"] == pytest.approx([0.05, 0.0, 0.6, 0.8])
    assert tuple(bent["value_names"]) == Kink().names
    assert bent["values"] == pytest.approx([0.1, 0.2, np.log(SHARP * 0.8), 0.5])
