"""Write (or check) the JSON Schema of every artifact: `python -m ropefit.artifacts.export
[--check] DIR`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from ropefit.artifacts import ARTIFACTS


def schemas() -> dict[str, str]:
    """Return {file name: JSON text} of every artifact's schema."""
    out = {}
    for kind in ARTIFACTS:
        schema = kind.model_json_schema()
        schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
        schema["title"] = kind.schema_name
        schema["x-version"] = kind.schema_version
        schema["x-file"] = kind.file_name
        out[f"{kind.schema_name}.v{kind.schema_version}.json"] = json.dumps(schema, indent=2) + "\n"
    return out


def main() -> None:
    """Write the schemas; with --check exit 1 where a file differs."""
    check = "--check" in sys.argv
    directory = Path(next(a for a in sys.argv[1:] if not a.startswith("--")))
    directory.mkdir(exist_ok=True)
    differ = []
    for name, text in schemas().items():
        path = directory / name
        if check and (not path.exists() or path.read_text() != text):
            differ.append(name)
        elif not check:
            path.write_text(text)
    if differ:
        raise SystemExit(f"{', '.join(differ)} out of date; run `make schemas`")


if __name__ == "__main__":
    main()
