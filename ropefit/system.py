"""System libraries that open3d and OpenCV load and pip cannot bring.

`python -m ropefit.system` names the Debian packages that are missing, one a line; `--install`
installs them where that is allowed (as root, or by sudo without a password).
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys

PACKAGES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libX11.so.6": "libx11-6",
    "libglib-2.0.so.0": "libglib2.0-0",
    "libgthread-2.0.so.0": "libglib2.0-0",
    "libstdc++.so.6": "libstdc++6",
}
MODULES = ("open3d", "cv2", "torch", "skimage")


def missing_library(message: str) -> str | None:
    """Return the shared library that an ImportError's message says is missing."""
    match = re.search(r"(lib[\w.+-]+\.so[\w.]*): cannot open shared object", message)
    return match.group(1) if match else None


def remedy(library: str) -> str:
    """Return one line: what is missing and what to do."""
    package = PACKAGES.get(library)
    if package:
        return f"system library {library} is missing; install it: sudo apt-get install {package}"
    return f"system library {library} is missing; install the package that holds it"


def _import_failure(module: str) -> str | None:
    """Return the library a module misses; imported in a fresh process, as a failed import cannot be
    retried."""
    run = subprocess.run([sys.executable, "-c", f"import {module}"], capture_output=True, text=True)
    if run.returncode == 0:
        return None
    library = missing_library(run.stderr)
    if library is None:
        raise SystemExit(f"ropefit: import {module} fails: {run.stderr.strip().splitlines()[-1]}")
    return library


def _install(package: str) -> bool:
    if shutil.which("apt-get") is None:
        return False
    prefix = [] if os.geteuid() == 0 else ["sudo", "-n"]
    if prefix and shutil.which("sudo") is None:
        return False
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}

    def apt(*arguments: str) -> bool:
        command = [*prefix, "apt-get", *arguments]
        return subprocess.run(command, env=environment, capture_output=True).returncode == 0

    return apt("install", "-y", package) or (apt("update") and apt("install", "-y", package))


def main() -> None:
    """Import what needs system libraries; install or name those that are missing."""
    install = "--install" in sys.argv[1:]
    for module in MODULES:
        last = None
        while library := _import_failure(module):
            package = PACKAGES.get(library)
            if not install or package is None or library == last or not _install(package):
                raise SystemExit(f"ropefit: {remedy(library)}")
            print(f"installed {package} (for {library})")
            last = library


if __name__ == "__main__":
    main()
