"""The plan of the house: who may import whom, how long a file may be, nothing left unused."""

import ast
from pathlib import Path

from tests.conftest import ROOT

PACKAGE = ROOT / "ropefit"
# A room may import from itself and from rooms further down; see docs/architecture.md.
FLOORS = [
    {"__main__"},
    {"cli"},
    {"cli_show", "cli_batch"},
    {"cli_options"},
    {"batch"},
    {"commands"},
    {"commands_identify", "commands_diagnose", "commands_show", "commands_export"},
    {"console"},
    {"api", "differentiable"},
    {"system"},
    {"stages"},
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
    {"artifacts"},
    {"plugins"},
    {"errors"},
]
LONG = {
    "ropefit/cli.py": 430,  # the options of every command, nothing else
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


def test_files_are_short():
    for path in sources():
        name = path.relative_to(ROOT).as_posix()
        lines = len(path.read_text().splitlines())
        assert lines <= LONG.get(name, 330), f"{name} has {lines} lines"


def test_command_line_imports_nothing_heavy():
    light = {"ropefit.cli_options", "ropefit.cli_show", "ropefit.cli_batch"}
    for name in ("cli", "cli_show", "cli_batch", "cli_options"):
        path = PACKAGE / f"{name}.py"
        for module in imports(path):
            assert module.split(".")[0] not in HEAVY
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ImportFrom):
                module = node.module or ""
                assert not module.startswith("ropefit") or module in light
