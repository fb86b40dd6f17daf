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

SHARP = 1e-4  # of the length: width of a bend at one point

ITERATED = (  # of a fitted model: since version 2 apart, as the equilibrium has none of it
    "steps", "iterations", "dt", "iteration", "distance_violation", "length_error", "drift",
    "drift_allowed", "compliance",
)  # fmt: skip


def _model_1(tree: Tree) -> Tree:
    for fitted in tree["models"].values():
        fitted["iterated"] = {name: fitted.pop(name) for name in ITERATED if name in fitted}
    return tree


def _as_it_is(tree: Tree) -> Tree:
    """Return the same: the next version only has more entries, which have defaults."""
    return tree


def _diagnosis_2(tree: Tree) -> Tree:
    """Split a clamp's stiffness and direction, which were one vector; give a kink a width."""
    for cause in tree.get("causes", {}).values():
        names, values = list(cause["value_names"]), np.asarray(cause["values"], dtype=float)
        if names == ["stiffness_x", "stiffness_y", "stiffness_z"]:
            size = float(np.linalg.norm(values))
            names = ["stiffness", "direction_x", "direction_y", "direction_z"]
            values = np.array([size, *(values / max(size, 1e-300))])
        elif "arc_length" in names and {"angle", "angle_1"} & set(names):
            sharp = np.log(SHARP * float(np.asarray(tree["node_arc"])[-1]))
            names.insert(-1, "log_width")
            values = np.insert(values, -1, sharp)
        cause["value_names"], cause["values"] = names, values
    return tree


def _checkpoint_1(tree: Tree) -> Tree:
    """Bring a checkpoint of a search up to date: its arrays are those of one result among
    others."""
    names = ("u", "loss", "gradient", "inverse", "status", "calm", "trace", "evaluations")
    found = {name: np.asarray(tree[name]) for name in names}
    arrays, data = packed({"search 1": found})
    return {"provenance": tree["provenance"], "key": tree["key"], "arrays": arrays, "data": data}


STEPS: dict[tuple[str, int], Callable[[Tree], Tree]] = {
    ("ropefit-observations", 1): _as_it_is,
    ("ropefit-observations", 2): _as_it_is,
    ("ropefit-observations", 3): _as_it_is,
    ("ropefit-observations", 4): _as_it_is,
    ("ropefit-model", 1): _model_1,
    ("ropefit-model", 2): _as_it_is,
    ("ropefit-model", 3): _as_it_is,
    ("ropefit-diagnosis", 1): _as_it_is,
    ("ropefit-diagnosis", 2): _diagnosis_2,
    ("ropefit-diagnosis", 3): _as_it_is,
    ("ropefit-diagnosis", 4): _as_it_is,
    ("ropefit-diagnosis", 5): _as_it_is,
    ("ropefit-checkpoint", 1): _checkpoint_1,
}


def migrated(name: str, version: int, wanted: int, tree: Tree) -> Tree | None:
    """Return the tree as of version `wanted`; None where no steps lead there."""
    for number in range(version, wanted):
        step = STEPS.get((name, number))
        if step is None:
            return None
        tree = step(tree)
    return tree if version <= wanted else None
