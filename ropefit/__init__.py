"""ropefit: turn recordings of real ropes into simulations that behave like them.

    >>> import ropefit
    >>> recording = ropefit.load(ropefit.sample("markers"))
    >>> observations = ropefit.preprocess(recording)
    >>> observations.centreline.shape  # frames, nodes, xyz [m]
    (40, 20, 3)

The functions are the stages of the command line, in memory; `Rope` is the rope as a differentiable
function in torch. Everything heavy is imported when it is first asked for.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ropefit.api.memory import (
        Run,
        control,
        diagnose,
        export,
        fit,
        load,
        open_run,
        preprocess,
        report,
        sample,
        save,
    )
    from ropefit.differentiable import Rope

__version__ = "0.1.0"

__all__ = [
    "Rope",
    "Run",
    "__version__",
    "control",
    "diagnose",
    "export",
    "fit",
    "load",
    "open_run",
    "preprocess",
    "report",
    "sample",
    "save",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'ropefit' has no attribute {name!r}")
    home = "ropefit.differentiable" if name == "Rope" else "ropefit.api.memory"
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    return sorted(__all__)
