"""The lowest versions that pyproject.toml allows, in their own environment, and the tests there.

    python -m benchmarks.robustness.oldest [--folder build/oldest] [TEST ...]

A package without a wheel of its lowest version for this Python gets the lowest that has one. torch
for Linux comes with gigabytes of CUDA from the public index: the lowest build without is taken
where pip is shown one (PIP_FIND_LINKS, PIP_EXTRA_INDEX_URL), and the pinned version where not. What
was installed in the end is printed. Nothing is built from source.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

TESTS = ["tests/test_artifacts.py", "tests/test_recordings.py", "tests/test_least_squares.py"]
# The text of a schema is that of the pydantic that wrote it.
LEFT_OUT = "tests/test_artifacts.py::test_schemas_in_the_repository_are_up_to_date"
MORE = ["pytest", "hypothesis", "beartype"]  # what the tests themselves need
NEEDED = re.compile(r"([\w-]+)(?:\[\w+\])?\s*>=\s*([\d.]+)")
CPU = "+cpu"  # of a build without CUDA


def lowest() -> dict[str, str]:
    """Return {package: lowest version allowed} on this machine."""
    project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
    out = {}
    for line in project["dependencies"]:
        text, _, marker = line.partition(";")
        match = NEEDED.match(text.strip())
        assert match, f"no lower bound: {line}"
        if "!=" not in marker:
            out[match[1]] = match[2]
    return out


def offered(pip: list[str], name: str) -> list[str]:
    """Return versions with a wheel for this Python, lowest first; local builds too."""
    listed = subprocess.run(
        [*pip, "index", "versions", name, "--only-binary", ":all:"], capture_output=True, text=True
    ).stdout
    found = re.search(r"Available versions: (.*)", listed)
    every = [item.strip() for item in found[1].split(",")] if found else []
    return sorted(every, key=_number)


def choice(name: str, version: str, every: list[str], linux: bool) -> str | None:
    """Return the version to install.

    The lowest from `version` on, of torch for Linux the lowest without CUDA; None where there is
    none.
    """
    enough = [item for item in every if _number(item) >= _number(version)]
    if name == "torch" and linux:
        enough = [item for item in enough if item.endswith(CPU)] or [_pinned(name)]
    return enough[0] if enough else None


def _pinned(name: str) -> str:
    found = re.search(rf"^{name}==(\S+)", Path("constraints.txt").read_text(), re.M)
    assert found, f"not in constraints.txt: {name}"
    return found[1]


def _number(version: str) -> tuple[int, ...]:
    """Return (4, 10, 0) of 4.10; a local build as the version it is of."""
    parts = [int(part) for part in re.findall(r"\d+", version.partition("+")[0])]
    return tuple(parts + [0] * (4 - len(parts)))


def main() -> None:
    """Install, tell, test; the exit code is the tests'."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("build/oldest"))
    parser.add_argument("tests", nargs="*", default=TESTS)
    options = parser.parse_args()
    subprocess.run([sys.executable, "-m", "venv", "--clear", str(options.folder)], check=True)
    python = str(options.folder.absolute() / "bin" / "python")
    pip = [python, "-m", "pip", "--disable-pip-version-check"]
    bounds = lowest()
    chosen = {
        name: choice(name, version, offered(pip, name), sys.platform == "linux")
        for name, version in bounds.items()
    }
    asked = [f"{name}=={version}" for name, version in chosen.items() if version]
    install = [*pip, "install", "--quiet", "--only-binary", ":all:"]
    subprocess.run([*install, *asked, *MORE], check=True)
    for name, version in bounds.items():
        got = chosen[name]
        remark = "" if got and _number(got) == _number(version) else ", the lowest to be had"
        print(f"{name} ≥ {version}: {got or 'no wheel'}{remark if got else ''}", flush=True)
    # The code that numba compiled for other versions is left alone.
    own = os.environ | {"NUMBA_CACHE_DIR": str(options.folder.absolute() / "numba")}
    test = [python, "-m", "pytest", "-q", "--deselect", LEFT_OUT, *options.tests]
    raise SystemExit(subprocess.run(test, env=own).returncode)


if __name__ == "__main__":
    main()
