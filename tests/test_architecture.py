"""The plan of the house: who may import whom, how long a file may be, nothing left unused."""

import ast
from pathlib import Path

import typer

from ropefit.cli import app
from tests.conftest import ROOT

PACKAGE = ROOT / "ropefit"
# A room may import from itself and from rooms further down; see docs/architecture.md.
FLOORS = [
    {"__main__"},
    {"cli"},
    {"batch"},
    {"api", "differentiable"},
    {"stages"},
    {"fitting"},
    {"adapters"},
    {"viewing"},
    {"reporting"},
    {"exporters"},
    {"inference"},
    {"effects"},
    {"losses", "solvers"},
    {"rod"},
    {"perception"},
    {"importers"},
    {"recordings"},
    {"runs"},
    {"artifacts"},
    {"plugins"},
    {"errors"},
    {"system"},
]
# The compiled loops and their derivative stay together: the compiler's cache sees one file only.
LONG = {
    "ropefit/solvers/kernels.py": 500,
    "ropefit/solvers/newton_kernels.py": 1400,
    "ropefit/solvers/dynamics_kernels.py": 820,
}
HEAVY = {"torch", "open3d", "cv2", "numpy", "scipy", "h5py", "numba", "plotly", "pydantic"}


def rooms() -> dict[str, int]:
    return {room: floor for floor, names in enumerate(FLOORS) for room in names}


def room_of(path: Path) -> str:
    part = path.relative_to(PACKAGE).parts[0]
    return part.removesuffix(".py")


def imports(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.append(node.module)
    return found


def sources() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def test_imports_run_downward():
    floor = rooms()
    wrong = []
    for path in sources():
        if path.parent == PACKAGE and path.name == "__init__.py":
            continue
        room = room_of(path)
        for module in imports(path):
            parts = module.split(".")
            if parts[0] != "ropefit" or len(parts) == 1 or parts[1] == room:
                continue
            if floor[parts[1]] <= floor[room]:
                wrong.append(f"{path.relative_to(ROOT)} imports {module}")
    assert not wrong


def test_every_module_is_imported_somewhere():
    used = {module for path in sources() for module in imports(path)}
    for path in sources():
        used |= {module.rpartition(".")[0] for module in used} | {
            f"{m}.{name}"
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.ImportFrom) and (m := node.module)
            for name in [alias.name for alias in node.names]
        }
    entry = {"ropefit", "ropefit.__main__", "ropefit.system", "ropefit.artifacts.export"}
    entry.add("ropefit.rod.energy")  # the physics as it is meant; the solvers' tests hold to it
    entry.add("ropefit.exporters.runners.settle_mujoco")  # run by the Python that has the simulator
    for path in sources():
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        assert name in used | entry, f"{name} is imported by nobody"


def test_stages_are_the_commands():
    """One file a command, but for those that only call others or show what there is."""
    commands = set(typer.main.get_command(app).commands)  # type: ignore[attr-defined]
    named = {"import": "importing"}  # `import` is a word of the language
    files = {path.stem for path in (PACKAGE / "stages").glob("*.py")} - {"__init__"}
    assert files == {named.get(name, name) for name in commands - {"run", "batch", "view"}}


def test_files_are_short():
    for path in sources():
        name = path.relative_to(ROOT).as_posix()
        lines = len(path.read_text().splitlines())
        assert lines <= LONG.get(name, 330), f"{name} has {lines} lines"


def test_command_line_imports_nothing_heavy():
    """Before a command runs: options only. `console` and `parsing` are imported when it runs."""
    late = ("console", "parsing")
    for path in sorted((PACKAGE / "cli").glob("*.py")):
        for node in ast.parse(path.read_text()).body:
            if not isinstance(node, ast.Import | ast.ImportFrom):
                continue
            names = [alias.name for alias in node.names]
            for module in [node.module or ""] if isinstance(node, ast.ImportFrom) else names:
                assert module.split(".")[0] not in HEAVY, f"{path.name} imports {module}"
                if path.stem not in late and module.startswith("ropefit"):
                    assert module.startswith("ropefit.cli."), f"{path.name} imports {module}"
                    assert module.removeprefix("ropefit.cli.") not in late, path.name
