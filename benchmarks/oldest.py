"""The lowest versions that pyproject.toml allows, in their own environment, and the tests there.

python -m benchmarks.oldest [--folder build/oldest] [TEST ...]

A package without a wheel of its lowest version for this Python gets the lowest that has one; it is
told which. Nothing is built from source.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tomllib
from pathlib import Path

TESTS = ["tests/test_artifacts.py", "tests/test_recordings.py", "tests/test_least_squares.py"]
NEEDED = re.compile(r"([\w-]+)(?:\[\w+\])?\s*>=\s*([\d.]+)")


def lowest() -> dict[str, str]:
    """{package: lowest version allowed} on this machine."""
    project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
    out = {}
    for line in project["dependencies"]:
        text, _, marker = line.partition(";")
        match = NEEDED.match(text.strip())
        assert match, f"no lower bound: {line}"
        if "!=" not in marker:
            out[match[1]] = match[2]
    return out


def install(pip: list[str], name: str, version: str) -> str | None:
    """The version that was installed: the lowest with a wheel; None where there is none."""
    exact = [*pip, "install", "--quiet", "--only-binary", ":all:", f"{name}=={version}"]
    if subprocess.run(exact, capture_output=True).returncode == 0:
        return version
    listed = subprocess.run(
        [*pip, "index", "versions", name, "--only-binary", ":all:"], capture_output=True, text=True
    ).stdout
    found = re.search(r"Available versions: (.*)", listed)
    every = [item.strip() for item in found[1].split(",")] if found else []
    for other in sorted(every, key=_number):
        exact[-1] = f"{name}=={other}"
        if (
            _number(other) >= _number(version)
            and subprocess.run(exact, capture_output=True).returncode == 0
        ):
            return other
    return None


def _number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version))


def main() -> None:
    """Install, tell, test; the exit code is the tests'."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("build/oldest"))
    parser.add_argument("tests", nargs="*", default=TESTS)
    options = parser.parse_args()
    subprocess.run([sys.executable, "-m", "venv", "--clear", str(options.folder)], check=True)
    python = str(options.folder / "bin" / "python")
    pip = [python, "-m", "pip", "--disable-pip-version-check"]
    for name, version in lowest().items():
        got = install(pip, name, version)
        remark = "" if got == version else " (lowest with a wheel here)"
        print(f"{name} {version}: {got or 'no wheel'}{remark if got else ''}", flush=True)
    more = ["pytest", "hypothesis", "beartype", "jaxtyping"]
    subprocess.run([*pip, "install", "--quiet", *more], check=True)
    raise SystemExit(subprocess.run([python, "-m", "pytest", "-q", *options.tests]).returncode)


if __name__ == "__main__":
    main()
