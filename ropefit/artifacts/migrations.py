"""Artifacts of earlier schema versions, brought to the present one when they are read.

A step takes the tree of a version, {name: array, JSON value or tree}, and gives that of the next.
`tests/fixtures` holds a file of every version; a test opens them all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ropefit.artifacts.packing import packed

Tree = dict[str, Any]

ITERATED = (  # of a fitted model: since version 2 apart, as the equilibrium has none of it
    "steps", "iterations", "dt", "iteration", "distance_violation", "length_error", "drift",
    "drift_allowed", "compliance",
)  # fmt: skip


def _model_1(tree: Tree) -> Tree:
    for fitted in tree["models"].values():
        fitted["iterated"] = {name: fitted.pop(name) for name in ITERATED if name in fitted}
    return tree


def _as_it_is(tree: Tree) -> Tree:
    """The next version only has more entries, which have defaults."""
    return tree


def _checkpoint_1(tree: Tree) -> Tree:
    """Of a search only: its arrays are those of one result among others."""
    names = ("u", "loss", "gradient", "inverse", "status", "calm", "trace", "evaluations")
    found = {name: np.asarray(tree[name]) for name in names}
    arrays, data = packed({"search 1": found})
    return {"provenance": tree["provenance"], "key": tree["key"], "arrays": arrays, "data": data}


STEPS: dict[tuple[str, int], Callable[[Tree], Tree]] = {
    ("ropefit-observations", 1): _as_it_is,
    ("ropefit-observations", 2): _as_it_is,
    ("ropefit-model", 1): _model_1,
    ("ropefit-diagnosis", 1): _as_it_is,
    ("ropefit-diagnosis", 2): _as_it_is,
    ("ropefit-checkpoint", 1): _checkpoint_1,
}


def migrated(name: str, version: int, wanted: int, tree: Tree) -> Tree | None:
    """The tree as of version `wanted`; None where no steps lead there."""
    for number in range(version, wanted):
        step = STEPS.get((name, number))
        if step is None:
            return None
        tree = step(tree)
    return tree if version <= wanted else None
