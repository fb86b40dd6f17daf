"""The pages on adding something of one's own, followed literally from outside the package."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ropefit.importers import importers
from tests.conftest import ROOT
from tests.factories import rope_points

DOCS = ROOT / "docs"


def package(page: str, directory: Path) -> str:
    """What a page shows, installed in a folder; the (first) module's name."""
    text = (DOCS / page).read_text()
    (declared,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    group = re.search(r'entry-points\."([\w.]+)"\]\n(.*)', declared, re.DOTALL)
    assert group is not None
    names = []
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        name = re.match(r"# (\w+)\.py", block)
        assert name is not None
        (directory / f"{name[1]}.py").write_text(block)
        names.append(name)
    name = names[0]
    info = directory / f"{name[1]}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name[1]}\nVersion: 1.0\n")
    points = group[2].replace('"', "")
    (info / "entry_points.txt").write_text(f"[{group[1]}]\n{points}")
    return name[1]


def python(directory: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(directory), str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=directory,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )


def test_adding_an_importer(tmp_path: Path) -> None:
    package("adding-an-importer.md", tmp_path)
    blocks = [
        "\n".join(" ".join(f"{1000 * v:.6f}" for v in point) for point in rope_points(frame, 30))
        for frame in range(3)
    ]
    (tmp_path / "rope.txt").write_text("\n\n".join(blocks))
    arguments = ["-m", "ropefit", "import", "rope.txt", "--from", "lines", "--out", "rec"]
    run = python(tmp_path, *arguments, "--set", "scale=0.001", "--json")
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["frames"] == 3
    assert json.loads(run.stdout)["ends"] == ["pinned", "free"]
    (tmp_path / "rope.txt").write_text("1 2 x")
    failed = python(tmp_path, *arguments[:-1], "other")
    assert failed.returncode == 3
    assert failed.stderr.count("\n") == 1
    wrong = python(tmp_path, *arguments[:-1], "other", "--set", "size=2")
    assert wrong.returncode == 2
    assert "scale" in wrong.stderr
    (tmp_path / "rope.txt").write_text("\n\n".join(blocks))
    module = tmp_path / "ropefit_lines.py"
    module.write_text(module.read_text().replace("points * options.scale", "points * options.size"))
    broken = python(tmp_path, *arguments[:-1], "other")
    assert broken.returncode == 1
    assert broken.stderr.count("\n") == 1
    assert re.match(r"ropefit: ropefit_lines.py:\d+: an add-on that fails \(Attr", broken.stderr)


def test_adding_an_exporter(tmp_path: Path) -> None:
    package("adding-an-exporter.md", tmp_path)
    (tmp_path / "use.py").write_text(
        "from reference_simulators.as_ropefit import describe\n"
        "from ropefit.exporters import export\n"
        "from ropefit.attachments import PointMass\n"
        "rope = describe('pinned', 1e-2, 11, effects=(PointMass(3, 0.1),))\n"
        "result = export(rope, 'table')\n"
        "assert result.not_expressed == ('PointMass is left out',)\n"
        "print(result.text)\n"
    )
    run = python(tmp_path, "use.py")
    assert run.returncode == 0, run.stderr
    lines = run.stdout.strip().splitlines()
    assert lines[0] == "# not expressed: PointMass is left out"
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[2:]])
    assert rows.shape == (11, 6)
    assert rows[:, 5].sum() == pytest.approx(0.05)


def test_adding_a_loss(tmp_path: Path) -> None:
    package("adding-a-loss.md", tmp_path)
    run = python(tmp_path, "-c", TRY_LOSS)
    assert run.returncode == 0, run.stderr
    asked = python(tmp_path, "-m", "ropefit", "identify", "--run", "none", "--loss", "sparse")
    assert asked.returncode == 1, asked.stderr  # it is known; the run is what is missing
    assert "sparse" not in asked.stderr
    other = python(tmp_path, "-m", "ropefit", "identify", "--run", "none", "--loss", "spars")
    assert other.returncode == 2
    assert "OBJ9, sparse" in other.stderr


def test_a_broken_add_on_is_named(tmp_path: Path) -> None:
    name = package("adding-an-importer.md", tmp_path)
    (tmp_path / f"{name}.py").write_text("import nothing_of_this_name")
    run = python(tmp_path, "-m", "ropefit", "import", "x", "--from", "lines", "--out", "y")
    assert run.returncode == 1
    assert name in run.stderr
    assert "Traceback" not in run.stderr


def test_every_format_and_option_is_described() -> None:
    page = (DOCS / "importing.md").read_text()
    for name, kind in importers().items():
        assert f"## `{name}`" in page
        for option in kind.options.model_fields:
            assert f"`{option}`" in page, f"{option} of {name}"


TRY_LOSS = """
import torch
from ropefit.fitting.settings import IdentifySettings
from ropefit.losses.objectives import objective
from ropefit.losses.primary import Observed

loss = objective(IdentifySettings(solver="thomas", loss="sparse").loss)
x = torch.zeros(2, 6, 3, dtype=torch.float64)
on = torch.ones(2, 6, dtype=torch.bool)
seen = Observed(x + 0.5, on, torch.zeros(2, 6, dtype=torch.long), x + 0.1, on)
one = loss.primary(x, seen).loss()
every = objective("OBJ4").primary(x, seen).loss()
assert torch.allclose(one, every / 2), (one, every)
"""

TRY_RED_BLACK = """
import numpy as np, torch
from ropefit.fitting.settings import IdentifySettings
from ropefit.models.xpbd_rope import Algorithm, build_rope
from ropefit.rod.rod import uniform
from ropefit.rod.setup import bare
from ropefit.solvers.xpbd.reference import Settings

ends = np.array([[[0.0, 0, 0], [0.5, 0, 0]]])
rope = uniform(length=1.0, segments=11, bend=1.0)
pinned = np.full((1, 2, 4), np.nan)
setup = bare(rope, np.array([0.0, 0.0, -9.81]), ends, pinned, np.zeros(3))
weights = torch.tensor([[0.04, 1, 1e-9, 1e-9, 1e-9, 1]], dtype=torch.float64)
for name in ("red_black", "jacobi"):
    IdentifySettings(solver=name)
    x = build_rope(setup, Algorithm(name, Settings(1, 200))).settle(weights).x
    print(float(((x[:, 1:] - x[:, :-1]).norm(dim=-1) - 1 / 11).abs().max()))
"""


def test_adding_a_distance_solver(tmp_path: Path) -> None:
    """Its sweeps keep the length better than as many of Jacobi's."""
    package("adding-a-distance-solver.md", tmp_path)
    (tmp_path / "try_it.py").write_text(TRY_RED_BLACK)
    run = python(tmp_path, "try_it.py")
    assert run.returncode == 0, run.stderr
    red_black, jacobi = map(float, run.stdout.split())
    assert red_black < 0.5 * jacobi


# A rope that hangs between pinned ends in six ways, and the fit to markers of what it becomes.
ROPE = """
import numpy as np
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.diagnosis.hypotheses import hypotheses
from ropefit.rod.rod import uniform
from ropefit.rod.setup import bare

gravity = np.array([0.0, 0.0, -9.81])
ends = np.zeros((6, 2, 3))
ends[:, 1, 0] = np.linspace(0.5, 0.85, 6)
rope = uniform(length=1.0, segments=40, bend=4e-4, density=0.05)
eye = np.array([0.5, -1.5, 0.0])
setup = bare(rope, gravity, ends, np.full((6, 2, 4), np.nan), eye)

def fitted(x):
    share = np.broadcast_to(np.linspace(0, 1, 41), (6, 41))
    points = x + 0.0005 * np.random.default_rng(0).normal(size=x.shape)
    data = Data(points, share, np.ones((6, 41), bool), True, eye)
    problem = FitProblem(data, Noise(marker=0.0005), 40)
    return fit(Equilibrium(setup, [PARAMETERS["EI"].within(Range(3e-4, 1e-6, 1e-2))]), problem)
"""


TRY_JET = """
from ropefit.diagnosis.scan import Projection, Scorer
from ropefit.diagnosis.sensitivities import Sensitivities

import ropefit_jet

gravity = np.array([0.0, 0.0, -9.81])
ends = np.zeros((6, 2, 3))
ends[:, 1, 0] = np.linspace(0.5, 0.85, 6)
rope = uniform(length=1.0, segments=40, bend=4e-4, density=0.05)
setup = bare(rope, gravity, ends, np.full((6, 2, 4), np.nan), np.array([0.5, -1.5, 0.0]))
blown = ropefit_jet.Jet().apply(setup, np.array([0.0, 0.004, 0.0, 0.5]))
found = fitted(Equilibrium(blown, []).at(np.empty(0)).seen)
responses, project = Sensitivities(found), Projection(found)
best = max(
    (Scorer(responses.of(f), project, f.scales(setup))(found.z) for f in hypotheses(setup)),
    key=lambda s: s.log_factor,
)
print(best.hypothesis.name, *best.hypothesis.places[best.best], *best.sizes)
"""


def test_adding_an_effect(tmp_path: Path) -> None:
    package("adding-an-effect.md", tmp_path)
    (tmp_path / "try_jet.py").write_text(ROPE + TRY_JET)
    run = python(tmp_path, "try_jet.py")
    assert run.returncode == 0, run.stderr
    name, place, *force = run.stdout.split()
    assert name == "jet"
    assert float(place) == pytest.approx(0.5, abs=0.03)
    assert [float(v) for v in force] == pytest.approx([0, 0.004, 0], abs=4e-4)


TRY_POST = """
from ropefit.diagnosis.acceptance import first_acceptable
from ropefit.diagnosis.candidates import fit_candidates
from ropefit.diagnosis.held_out import by_stretches
from ropefit.diagnosis.proposals import proposals

assert all(h.name != "post" for h in hypotheses(setup))

import ropefit_post

post = ropefit_post.Post()
leaning = post.apply(setup, np.array([0.02, 0.0, 0.03]))
point = Equilibrium(leaning, []).at(np.empty(0))
assert point.solution.converged.all()
nominal = fitted(point.seen)
slow = proposals(nominal, slow=True, names=("post",))
found = fit_candidates(nominal, [], [], slow, 6.0, ("post",))
best = first_acceptable(found, 6.0, nominal, [])
assert by_stretches(best.fit) and not by_stretches(nominal)
values = best.values()
summary = dict(zip(post.names, values))
(record,) = post.exported(summary, leaning, 11, ()).beside
print(best.hypothesis.name, best.evidence, values[2] - values[0], record.radius - summary["radius"])
"""


def test_adding_a_contact_effect(tmp_path: Path) -> None:
    package("adding-an-effect.md", tmp_path)
    (tmp_path / "try_post.py").write_text(ROPE + TRY_POST)
    run = python(tmp_path, "try_post.py")
    assert run.returncode == 0, run.stderr
    name, evidence, surface, same = run.stdout.split()
    assert name == "post"
    assert float(evidence) > 30
    assert float(surface) == pytest.approx(0.01, abs=0.001)  # m, by which it holds the rope off
    assert float(same) == 0
