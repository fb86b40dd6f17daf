"""Build the wheel, install it in a new environment, and use it there, away from the source.

    python -m benchmarks.robustness.wheel [--folder build/wheel] [--write docs/dependencies.md]

Dependencies are those of constraints.txt. The sample in the wheel is run to its report by one
command.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from benchmarks.document import parser, publish


def main() -> None:
    """Build, install and use the wheel; progress goes to standard error."""
    p = parser(__doc__)
    p.add_argument("--folder", type=Path, default=Path("build/wheel"))
    options = p.parse_args()
    folder = options.folder.absolute()
    environment = {name: v for name, v in os.environ.items() if name != "PYTHONPATH"}

    def call(*command: str | Path, cwd: Path | None = None) -> str:
        print("+", *command, file=sys.stderr, flush=True)
        done = subprocess.run(
            list(map(str, command)), cwd=cwd, env=environment, stdout=subprocess.PIPE, text=True
        )
        if done.returncode != 0:
            raise SystemExit(f"failed with exit code {done.returncode}")
        return done.stdout

    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.whl"):
        old.unlink()
    pip = ["-m", "pip", "--disable-pip-version-check"]
    call(sys.executable, *pip, "wheel", "--quiet", "--no-deps", "-w", folder, ".")
    (wheel,) = folder.glob("*.whl")
    call(sys.executable, "-m", "venv", "--clear", folder / "env")
    python, away = folder / "env" / "bin" / "python", folder / "away"
    call(python, *pip, "install", "--quiet", "-c", Path("constraints.txt").absolute(), wheel)
    call(python, *pip, "check")
    away.mkdir(exist_ok=True)
    command = folder / "env" / "bin" / "ropefit"
    where = call(python, "-c", "import ropefit; print(ropefit.__file__)", cwd=away).strip()
    if not Path(where).is_relative_to(folder):
        raise SystemExit(f"it is not the wheel that is imported: {where}")
    call(command, "run", "--run", "run", "--force", cwd=away)
    size = (away / "run" / "report.html").stat().st_size
    packages = len(call(python, *pip, "list", "--format", "freeze").splitlines())
    data = {"wheel": wheel.name, "bytes": wheel.stat().st_size, "packages": packages}
    text = (
        f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, {packages} packages in the "
        f"environment,\nPython {sys.version.split()[0]}; "
        f"the sample's report: {size / 1e6:.1f} MB.\n"
    )
    publish(options, "wheel", text, data)


if __name__ == "__main__":
    main()
