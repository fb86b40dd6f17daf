"""Known vulnerabilities of the versions that are tested, by the package index.

    python -m benchmarks.robustness.audit [--write docs/dependencies.md] [--json FILE]

The index has them from the public databases (OSV, PyPA). It is asked for the pinned version; an
index that answers for the latest version only says nothing about an older one; it is listed.
A package that is known to be vulnerable is asked for first: no answer about it, no audit.
"""

from __future__ import annotations

import datetime
import json
import re
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.document import parser, publish

INDEX = "https://pypi.org/pypi"
CONTROL = ("pycrypto", "2.6.1")  # CVE-2013-7459; never mended
PINNED = re.compile(r"^([\w-]+)==([\w.]+)", re.M)


class Finding(NamedTuple):
    """What is known of a version: names of vulnerabilities, None without an answer; the latest
    version there is."""

    package: str
    version: str
    known: list[str] | None
    latest: str


def answer(url: str) -> dict[str, Any] | None:
    """Return the JSON at an address, None where there is none. Raises OSError without an answer."""
    try:
        with urllib.request.urlopen(url, timeout=180) as reply:
            return json.load(reply)
    except urllib.error.HTTPError as error:
        if error.code == 404:
            return None
        raise


def names(told: dict[str, Any]) -> list[str]:
    """Return the vulnerabilities in an answer, one name each: a CVE where it has one."""
    out = set()
    for item in told["vulnerabilities"]:
        if not item["withdrawn"]:
            every = sorted([item["id"], *item["aliases"]])
            out.add(next((name for name in every if name.startswith("CVE-")), every[0]))
    return sorted(out)


def ask(package: str, version: str, index: str = INDEX) -> Finding:
    """Ask the index about a version.

    Raises OSError as `answer`, LookupError without such a package.
    """
    told = answer(f"{index}/{package}/{version}/json")
    if told is not None:
        return Finding(package, version, names(told), version)
    told = answer(f"{index}/{package}/json")
    if told is None:
        raise LookupError(package)
    latest = told["info"]["version"]
    return Finding(package, version, names(told) if latest == version else None, latest)


def text(found: list[Finding], date: str) -> str:
    """Return the section of the document."""
    known = [f for f in found if f.known]
    clean = [f for f in found if f.known == []]
    silent = [f for f in found if f.known is None]
    lines = [
        f"Asked on {date} for the {len(found)} pinned versions (not for what these need in turn):",
        f"{len(clean)} without a known vulnerability, {len(known)} with one,",
        f"{len(silent)} for which the index gives no answer.",
    ]
    if known:
        lines += ["", "| version | known |", "|---|---|"]
        lines += [f"| {f.package} {f.version} | {', '.join(f.known or [])} |" for f in known]
    if silent:
        older = ", ".join(f"{f.package} {f.version} ({f.latest})" for f in silent)
        lines += ["", f"The index answered for the latest version only, not for: {older}."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Audit; exit 1 where a vulnerability is known, or the index knows none at all."""
    p = parser(__doc__)
    p.add_argument("--index", default=INDEX, help="address of the index's JSON")
    options = p.parse_args()
    try:
        if not ask(*CONTROL, options.index).known:
            raise SystemExit(f"{options.index} knows of no vulnerability in {CONTROL}: no audit")
        pins = PINNED.findall(Path("constraints.txt").read_text())
        found = [ask(package, version, options.index) for package, version in pins]
    except (OSError, LookupError) as error:
        raise SystemExit(f"no audit: {options.index}: {error!r}")
    date = datetime.date.today().isoformat()
    data = {"date": date, "versions": [f._asdict() for f in found]}
    publish(options, "audit", text(found, date), data)
    raise SystemExit(any(f.known for f in found))


if __name__ == "__main__":
    main()
