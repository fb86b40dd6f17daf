"""A hash of the source that a computation depends on: the modules it imports, and theirs."""

from __future__ import annotations

import ast
import hashlib
import os
import re
from functools import cache
from pathlib import Path

from ropefit.plugins import add_ons

PACKAGE = Path(__file__).parents[1]
PLUGINS = "ropefit.plugins"  # whose importers ask for add-ons
# Only these statements are parsed: parsing whole files takes twenty times as long.
STATEMENT = re.compile(
    rb"^[ \t]*(from[ \t]+ropefit[\w.]*[ \t]+import[ \t]+(?:\([^)]*\)|.*)|import[ \t]+ropefit.*)",
    re.MULTILINE,
)


@cache
def code_sha256(*modules: str) -> str:
    """Return the hash of modules of this package and of all that they import of it.

    With the modules of add-ons, where these may be asked. It stays for the life of a process, as
    the code that the process runs does.
    """
    digest = hash_of(modules, PACKAGE)
    if PLUGINS not in reached(modules, PACKAGE):
        return digest
    added = sorted(_read(path)[0] for path in add_ons())
    return hashlib.sha256(" ".join([digest, *added]).encode()).hexdigest() if added else digest


def hash_of(modules: tuple[str, ...], package: Path) -> str:
    """Return the hash of `modules` and of all that they import, in a package's directory."""
    digest = hashlib.sha256()
    for name, path in sorted(reached(modules, package).items()):
        digest.update(f"{name} {_read(path)[0]} ".encode())
    return digest.hexdigest()


def reached(modules: tuple[str, ...], package: Path) -> dict[str, Path]:
    """Return modules and what they import of the package, directly or not: {name: file}.

    Imports inside functions count. Plug-ins count where the `__init__` of their folder imports
    them. The package's own `__init__` does not: it holds public names and the version, which is
    compared by itself.
    """
    files = _files(package)
    found: dict[str, Path] = {}
    left = list(modules)
    while left:
        name = left.pop()
        if name in found or name not in files:  # a name in a module, or no module of ours
            continue
        found[name] = files[name]
        left.append(name.rpartition(".")[0])  # its folder's __init__ runs before it
        left += _read(files[name])[1]
    return found


def imported(text: bytes) -> set[str]:
    """Return what a source may import of this package: modules, and names that may be modules."""
    try:
        nodes = [node for part in STATEMENT.findall(text) for node in ast.parse(part).body]
    except SyntaxError:  # a comment within, or a sentence that reads like an import
        nodes = list(ast.walk(ast.parse(text)))
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def _files(package: Path) -> dict[str, Path]:
    """Return the modules of a package but its own `__init__`."""
    files = {}
    for folder, _, names in os.walk(package):
        parts = Path(folder).relative_to(package.parent).parts
        for name in names:
            if name == "__init__.py" and len(parts) > 1:
                files[".".join(parts)] = Path(folder, name)
            elif name.endswith(".py") and name != "__init__.py":
                files[".".join((*parts, name.removesuffix(".py")))] = Path(folder, name)
    return files


def _read(path: Path) -> tuple[str, frozenset[str]]:
    """Return the hash of a file and what it imports; read again where the file has changed."""
    state = path.stat()
    return _read_at(path, state.st_mtime_ns, state.st_size)


@cache
def _read_at(path: Path, changed: int, size: int) -> tuple[str, frozenset[str]]:
    text = path.read_bytes()
    return hashlib.sha256(text).hexdigest(), frozenset(imported(text))
