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
    {"diagnosis"},
    {"inference"},
    {"models"},
    {"effects"},
    {"exporters"},
    {"losses", "solvers"},
    {"rod"},
    {"perception"},
    {"importers"},
    {"recordings"},
    {"runs"},
    {"artifacts"},
    {"failures"},
    {"plugins", "attachments", "gaps"},
    {"errors"},
    {"system"},
]
LONG = {}
HEAVY = {"torch", "open3d", "cv2", "numpy", "scipy", "h5py", "numba", "pydantic"}


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


def test_inference_and_diagnosis_know_models_by_their_protocol():
    models = {"equilibrium", "dynamics", "xpbd", "equilibrium_rope", "xpbd_rope"}
    for room in ("inference", "diagnosis"):
        for path in (PACKAGE / room).glob("*.py"):
            known = {module.removeprefix("ropefit.models.") for module in imports(path)}
            assert not known & models, f"{path.relative_to(ROOT)} imports {known & models}"


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
    entry.add("ropefit.solvers.batched.simulate")  # public; called on an accelerator
    entry.add("ropefit.solvers.dynamics.differentiable")  # public; the same in torch
    entry.add("ropefit.exporters.runners.settle_mujoco")  # run by the Python that has the simulator
    for path in sources():
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        assert name in used | entry, f"{name} is imported by nobody"


def test_stages_are_the_commands():
    """One file a command, but for those that only call others or show what there is."""
    commands = set(typer.main.get_command(app).commands)  # type: ignore[attr-defined]
    named = {"import": "importing", "warm-up": "warm_up"}  # `import` is a word of the language
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


EFFECTS = PACKAGE / "effects"
BASES = {"ropefit.effects.base", "ropefit.effects.contact", "ropefit.effects.misfit"}
BASES |= {"ropefit.effects.place", "ropefit.effects.drawn", "ropefit.effects.law"}
BASES |= {"ropefit.effects.ends"}
# All are of effects, of no single one.


def effect_names() -> tuple[set[str], set[str]]:
    """The names of all effects of the catalogue, and of their classes, as their files have them."""
    names, classes = set(), set()
    for path in EFFECTS.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                given = [
                    item.value.value
                    for item in node.body
                    if isinstance(item, ast.Assign)
                    and isinstance(item.value, ast.Constant)
                    and [t.id for t in item.targets if isinstance(t, ast.Name)] == ["name"]
                ]
                names |= set(given)
                inherited = any(isinstance(b, ast.Name) and b.id in classes for b in node.bases)
                classes |= {node.name} if given or inherited else set()
    return names, classes


def special_cases(source: str) -> list[str]:
    """What a file outside effects/ knows of single effects."""
    names, classes = effect_names()
    tree, found, own = ast.parse(source), [], set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            given = {alias.name for alias in node.names}
            if node.module == "ropefit.effects":
                found += [f"imports {name}" for name in given - {"CATALOGUE", "Effect", "Quantity"}]
            elif node.module.startswith("ropefit.effects.") and node.module not in BASES:
                found.append(f"imports {node.module}")
            elif node.module == "ropefit" and "effects" in given:
                found.append("imports effects")
            else:
                own |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            found += [f"imports {a.name}" for a in node.names if "ropefit.effects" in a.name]
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            for side in (node.left, *node.comparators):
                found += [f"compares with {v}" for v in constants(side) if v in names]
        elif isinstance(node, ast.Subscript):
            found += [f"looks up {v}" for v in constants(node.slice) if v in names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(".get"):
            looked_up = [v for key in node.args[:1] for v in constants(key)]
            found += [f"looks up {v}" for v in looked_up if v in names]
        elif isinstance(node, ast.MatchValue):
            found += [f"matches {v}" for v in constants(node.value) if v in names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "issubclass"):
            inside = list(ast.walk(node.args[1]))
            kinds = {n.id for n in inside if isinstance(n, ast.Name)}
            kinds |= {n.attr for n in inside if isinstance(n, ast.Attribute)}
            found += [f"an instance of {kind}" for kind in (kinds & classes) - own]
    return found


def constants(node: ast.AST) -> list[object]:
    """The constants that a comparison is with, those in a tuple, list or set included."""
    inside = node.elts if isinstance(node, ast.Tuple | ast.List | ast.Set) else [node]
    return [item.value for item in inside if isinstance(item, ast.Constant)]


def test_no_effect_is_a_special_case_outside_its_file():
    wrong = [
        f"{path.relative_to(ROOT)} {what}"
        for path in sources()
        if path.parent != EFFECTS
        for what in special_cases(path.read_text())
    ]
    assert not wrong


def test_special_cases_are_noticed():
    for source in (
        'if term.name == "tether": pass',
        'plain = cause.name not in ("kink", "other")',
        "from ropefit.effects import SupportPlane",
        "from ropefit.effects.support_plane import touching",
        "import ropefit.effects as e",
        "from ropefit import effects",
        "isinstance(effect, (FreeKink, int))",
        "isinstance(effect, effects.Obstacle)",
        'match effect.name:\n    case "inertia": pass',
        'weight = detectable.get("point_mass")',
        'weight = detectable["point_mass"]',
    ):
        assert len(special_cases(source)) == 1, source
    assert not special_cases("from ropefit.effects import CATALOGUE, Effect")
    assert not special_cases("from ropefit.attachments import Tether\nisinstance(x, Tether)")


NOUN_PHRASES = {"a", "all", "an", "each", "how", "the", "what", "where", "whether", "which"}


def test_docstrings_of_functions_are_imperative():
    wrong = []
    for path in sources():
        for node in ast.walk(ast.parse(path.read_text())):
            first = (isinstance(node, ast.FunctionDef) and ast.get_docstring(node)) or "Do"
            word = first.split()[0]
            if not word[0].isupper() or word.lower() in NOUN_PHRASES:
                wrong.append(f"{path.relative_to(ROOT)}:{node.lineno}: {first.splitlines()[0]}")
    assert not wrong
