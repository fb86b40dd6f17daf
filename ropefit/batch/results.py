"""The few numbers of a recording that a table of thousands shows."""

from __future__ import annotations

from typing import Any

from ropefit.api.summaries import plain


def results(stage: str, data: dict[str, Any]) -> dict[str, Any]:
    """Return what a stage's summary says of the recording as a whole."""
    return plain(_OF[stage](data)) if stage in _OF else {}


def _observed(data: dict[str, Any]) -> dict[str, Any]:
    kept = {name: data[name] for name in ("frames", "length_m", "noise_m")}
    return {**kept, "dropped": len(data["dropped"])}


def _identified(data: dict[str, Any]) -> dict[str, Any]:
    groups = data["groups"]
    parameters = {}
    for group, found in groups.items():
        for name, p in found["parameters"].items():
            if p["free"]:
                label = name if len(groups) == 1 else f"{group}.{name}"
                kept = ("value", "unit", "ci95", "verdict")
                parameters[label] = {key: p[key] for key in kept}
    kept = {name: data[name] for name in ("solver", "search", "rms_fit_m", "rms_heldout_m")}
    # A number without a status would be taken for a result.
    unconverged = ["solver"] if not data["solver_converged"] else []
    unconverged += [f"search of {name}" for name, g in groups.items() if not g["converged"]]
    return {**kept, "parameters": parameters, "unconverged": unconverged}


def _diagnosed(data: dict[str, Any]) -> dict[str, Any]:
    return {"verdict": data["verdict"], "effects": [e["name"] for e in data["effects"]]}


_OF = {"preprocess": _observed, "identify": _identified, "diagnose": _diagnosed}
