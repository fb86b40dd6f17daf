"""An output is computed again when what it was made by has changed, and only then."""

from __future__ import annotations

import ast
import inspect
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ropefit.adapters.control_settings import ControlSettings
from ropefit.adapters.settings import PreprocessSettings
from ropefit.api.pipeline import COMPUTED, IDENTIFY, PREPROCESS
from ropefit.artifacts import Observations, read
from ropefit.fitting.settings import IdentifySettings
from ropefit.recordings import fingerprint, open_recording
from ropefit.runs import code
from ropefit.runs.code import PACKAGE, hash_of, imported, reached
from ropefit.runs.execute import execute
from ropefit.runs.protocol import Context
from tests.factories import marker_recording

STAGES = ("preprocess", "identify", "diagnose", "control", "export")
FITTED = {"identify", "diagnose", "control", "export"}
EDITS = {
    "exporters/mujoco.py": {"export"},
    "perception/trace.py": {"preprocess"},
    "recordings/ply.py": {"preprocess", "control"},  # control reads targets as recordings are read
    "solvers/equilibrium/kernels/newton.py": FITTED,
    "effects/kink.py": FITTED,
    "fitting/weights.py": {"identify"},
    "artifacts/base.py": {"preprocess", *FITTED},
    "reporting/report.py": set(),
    "viewing/rerun.py": set(),
    "batch/run.py": set(),
    "__init__.py": set(),
}
FEW = {"most_frames": 4, "evaluations": 2}
FITS = {
    "weights, gradient": {"solver": "thomas", "steps": 4, "iterations": 3, **FEW},
    "weights, grid": {
        "solver": "jacobi", "steps": 4, "iterations": 3, "search": "grid", "levels": 2,
        "rounds": 1, "free": ["eta_x_G"],
    },
    "least squares": {"search": "least-squares", **FEW},
    "equilibrium, gradient": {"search": "gradient", **FEW},
    "equilibrium, grid": {"search": "grid", "levels": 2, "rounds": 1, "most_frames": 4},
    "motion": {"solver": "dynamics", "free": ["EI"], **FEW},
}  # fmt: skip
asked: set[str] = set()


class Watched(IdentifySettings):
    """Settings that note which of them are asked for."""

    def __getattribute__(self, name: str) -> Any:
        asked.add(name)
        return super().__getattribute__(name)


def hashes(package: Path) -> dict[str, str]:
    return {stage: hash_of((f"ropefit.stages.{stage}",), package) for stage in STAGES}


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package that may be edited."""
    copy = tmp_path_factory.mktemp("copy") / "ropefit"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "sample_data"))
    return copy


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with observations of a rope that sways slowly."""
    base = tmp_path_factory.mktemp("run")
    recording = open_recording(marker_recording(base / "recording", frames=24))
    context = Context(external={"recording": recording})
    external = {"recording": fingerprint(recording)}
    (base / "run").mkdir()
    execute(PREPROCESS, base / "run", PreprocessSettings(nodes=8), context, external)
    return base / "run"


@pytest.mark.parametrize("file", EDITS)
def test_an_edit_makes_stale_what_imports_it(file: str, package: Path) -> None:
    before = hashes(package)
    path = package / file
    text = path.read_text()
    path.write_text(text + "\n# edited\n")
    after = hashes(package)
    path.write_text(text)
    assert {stage for stage in STAGES if before[stage] != after[stage]} == EDITS[file]


def test_a_stage_knows_its_module() -> None:
    for stage in COMPUTED:
        assert stage.module in imported(inspect.getsource(stage.compute).encode())
        assert stage.module in reached((stage.module,), PACKAGE)


def test_a_new_import_counts_wherever_it_stands(package: Path) -> None:
    path = package / "perception" / "trace.py"
    text = path.read_text()
    before = reached(("ropefit.stages.preprocess",), package)
    path.write_text(
        text + "\n\ndef late():\n    from ropefit.losses import (\n        primary,\n    )\n"
    )
    after = reached(("ropefit.stages.preprocess",), package)
    path.write_text(text)
    assert "ropefit.losses.primary" not in before
    assert {"ropefit.losses", "ropefit.losses.primary"} <= after.keys()


def test_plug_ins_count() -> None:
    found = reached(("ropefit.stages.diagnose",), PACKAGE)
    effects = {f"ropefit.effects.{path.stem}" for path in (PACKAGE / "effects").glob("[!_]*.py")}
    assert effects <= found.keys()


def test_imports_are_those_of_the_syntax_tree() -> None:
    for path in sorted(PACKAGE.rglob("*.py")):
        if path == PACKAGE / "__init__.py":
            continue
        text = path.read_bytes()
        found = set()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                found |= {a.name for a in node.names if a.name.split(".")[0] == "ropefit"}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: a relative import is not seen"
                module = node.module or ""
                if module.split(".")[0] == "ropefit":
                    found |= {module, *(f"{module}.{a.name}" for a in node.names)}
        assert imported(text) == found, path


def test_a_sentence_like_an_import_is_no_import() -> None:
    text = b'"""Words.\n\nimport ropefit where it is needed.\n"""\nfrom ropefit.rod import rod\n'
    assert imported(text) == {"ropefit.rod", "ropefit.rod.rod"}


@pytest.mark.parametrize("fit", FITS)
def test_recorded_settings_are_those_that_the_fit_asks_for(fit: str, run: Path) -> None:
    o, _ = read(run / Observations.file_name, Observations)
    o = o.model_copy(update={"time": 0.05 * np.arange(len(o.frames))})
    settings = Watched(**FITS[fit])
    used = set(settings.used())
    asked.clear()
    IDENTIFY.compute({Observations.file_name: o}, settings, Context())
    asked.add("search")  # told by its name, even where a solver has only one
    assert asked & set(IdentifySettings.model_fields) == used


def test_settings_that_the_fit_does_not_use_change_nothing(run: Path) -> None:
    def again(**given: Any) -> Any:
        return execute(IDENTIFY, run, IdentifySettings(**FEW, **given), Context())

    first = again()
    assert first.computed
    for unused in ({"steps": 7}, {"levels": 5}, {"dt": 0.2}, {"search": "least-squares"}):
        assert not again(**unused).computed
    assert "steps" not in first.artifact.provenance.settings
    assert again(holdout=0.4).why == "settings changed: holdout 0.2 -> 0.4"
    assert "solver equilibrium -> thomas" in again(solver="thomas", steps=4, iterations=3).why
    assert "steps 4 -> 5" in again(solver="thomas", steps=5, iterations=3).why


def test_a_target_replaces_loss_and_key_points() -> None:
    def sha(**given: Any) -> str:
        return ControlSettings(**given).sha256()

    assert sha(target=True) == sha(target=True, loss="OBJ2", key=[0.1])
    assert sha(target=True) != sha(target=True, turn=True)
    assert sha() != sha(loss="OBJ2") != sha(key=[0.1])


def test_an_add_on_counts_where_add_ons_are_asked_for(tmp_path, monkeypatch):
    (tmp_path / "some_effect.py").write_text("SIZE = 1\n")
    info = tmp_path / "some_effect-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: some-effect\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[ropefit.effects]\nsome = some_effect\n")
    monkeypatch.syspath_prepend(tmp_path)
    stages = [f"ropefit.stages.{name}" for name in ("preprocess", "diagnose")]

    def hashes():
        code.code_sha256.cache_clear()
        return [code.code_sha256(stage) for stage in stages]

    before = hashes()
    (tmp_path / "some_effect.py").write_text("SIZE = 22\n")
    after = hashes()
    code.code_sha256.cache_clear()
    assert before[0] == after[0]
    assert before[1] != after[1]
