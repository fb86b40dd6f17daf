"""docs/dependencies.md lists what pyproject.toml asks for, no more, no less, in its bounds."""

from __future__ import annotations

import re
import tomllib

from tests.conftest import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DOCUMENT = (ROOT / "docs" / "dependencies.md").read_text()
NEEDED = re.compile(r"([\w-]+(?:\[\w+\])?)\s*>=\s*([\d.]+)(?:,<([\d.]+))?")


def bounds(lines: list[str]) -> dict[str, str]:
    """{package: bounds as the document writes them}."""
    out = {}
    for line in lines:
        found = NEEDED.match(line)
        assert found, f"no lower bound: {line}"
        out[found[1]] = f"≥ {found[2]}" + (f", < {found[3]}" if found[3] else "")
    return out


def rows(columns: int) -> list[list[str]]:
    """Those of the document's tables with so many columns, without their heads."""
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in DOCUMENT.splitlines()
        if line.startswith("|") and not line.startswith("|--")
    ]
    return [row for row in cells if len(row) == columns and "allowed" not in row]


def test_every_dependency_with_its_bounds_reason_and_licence() -> None:
    told = {name: row for row in rows(4) for name in row[0].split(", ")}
    assert {name: row[1] for name, row in told.items()} == bounds(PROJECT["dependencies"])
    assert all(reason and licence for _, _, reason, licence in told.values())


def test_every_extra_with_its_bounds_reason_and_licence() -> None:
    told = {(row[0].strip("`"), row[1]): row[2] for row in rows(5)}
    extras = PROJECT["optional-dependencies"]
    asked = {
        (extra, name): bound
        for extra, lines in extras.items()
        if extra != "dev"
        for name, bound in bounds(lines).items()
    }
    assert told == asked
    assert all(reason and licence for *_, reason, licence in rows(5))
    for line in extras["dev"]:
        name = re.match(r"[\w-]+", line)
        assert name
        assert name[0] == "ropefit" or name[0] in DOCUMENT, line


def test_what_is_pinned_is_allowed() -> None:
    pinned = dict(re.findall(r"^([\w-]+)==([\d.]+)", (ROOT / "constraints.txt").read_text(), re.M))
    extras = PROJECT["optional-dependencies"].values()
    every = [*PROJECT["dependencies"], *(line for lines in extras for line in lines)]
    checked = 0
    for line in every:
        found = NEEDED.match(line)
        if found is None or (name := found[1].split("[")[0]) not in pinned:
            continue
        version, low, high = (_number(v) for v in (pinned[name], found[2], found[3] or "999999"))
        assert low <= version < high, line
        checked += 1
    assert checked > 20


def _number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))
