"""Measured ropes at rest: a cable that was changed, and a wire that may not be straight."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import ropefit
from ropefit.artifacts import Model, read

VARYING = "EI,rest_curve"


@dataclass(frozen=True)
class Identified:
    """What `identify` found: rms [m] of fitted and held-out frames and of each frame, the free
    parameters as in the artifact, and EI of every group of frames."""

    fitted: float
    heldout: float | None
    by_frame: np.ndarray
    parameters: dict[str, dict[str, Any]]
    rigid: list[dict[str, Any]]


def identified(run: Path, free: str, groups: str = "one") -> Identified:
    """Identify a run with `--free`: return what was found for the first group."""
    ropefit("identify", "--run", run, "--free", free, "--groups", groups)
    model = read(run / Model.file_name, Model)[0].nominal
    told = {n: p.model_dump() for n, p in next(iter(model.groups.values())).parameters.items()}
    few = {n: p for n, p in told.items() if p["free"]}
    rigid = [group.parameters["EI"].model_dump() for group in model.groups.values()]
    return Identified(model.rms_fit, model.rms_heldout, model.rms, few, rigid)


# How a nominal rope is told: what the unchanged cable is identified with, and whether it is
# diagnosed, too.
NOMINAL = {
    "a varying rest curve": (VARYING, False),
    "a varying rest curve, diagnosed": (VARYING, True),
    "straight (default)": ("EI", False),
}


def cables(real: Path, folder: Path) -> dict[str, tuple[Identified, dict[str, Any]]]:
    """Return what was identified of the unchanged cable, and the diagnosis of the changed one with
    that as its nominal rope."""
    out = {}
    for number, (told, (free, diagnosed)) in enumerate(NOMINAL.items()):
        was, now = folder / f"unweighted-{number}", folder / f"weighted-{number}"
        for name, run in (("unweighted", was), ("weighted", now)):
            ropefit("preprocess", real / f"cable_black_{name}", "--run", run)
        known = identified(was, free)
        if diagnosed:
            ropefit("diagnose", "--run", was)
        ropefit("identify", "--run", now)
        out[told] = known, ropefit("diagnose", "--run", now, "--nominal", was)
    return out


def wire(real: Path, folder: Path) -> tuple[Identified, Identified, Identified]:
    """Identify the wire as straight, with a rest curve, and with one of its own in every pose."""
    ropefit("preprocess", real / "wire_black", "--run", folder)
    own = identified(folder, VARYING, ",".join(f"{t}-{t}" for t in range(5)))
    return identified(folder, "EI"), identified(folder, VARYING), own


def cable_table(found: dict[str, tuple[Identified, dict[str, Any]]]) -> str:
    rows = [
        "A cable held at its base, its free end hanging, at 23 angles of the base; then the same",
        "again with 0.2 kg on its tip (at 0.600 m); written by `python -m benchmarks.real`. The",
        "changed cable, by `ropefit diagnose --nominal` with the unchanged run:",
        "",
        "| nominal rope: misfit, EI [N m²] | verdict | accepted | where [m] | size (95 %) "
        "| equivalent to | log Bayes factor | held out before → after [mm] |",
        "|---" * 8 + "|",
    ]
    for told, (known, answer) in found.items():
        nominal = f"{told}: {_mm(known.fitted)} mm, {estimate(known.parameters['EI'])}"
        rows.append(_row(nominal, answer))
    for told, (_, answer) in found.items():
        rows += ["", f"{told.capitalize()}: " + _words(answer)]
    return "\n".join(rows) + "\n"


def _words(found: dict[str, Any]) -> str:
    """Return the effects that were refused, and the motion that would separate equivalent ones."""
    said = f"refused {refused(found)}"
    if found["next_motion"]["description"]:
        apart = " from ".join(found["next_motion"]["separates"])
        said += f"; to separate {apart}: {found['next_motion']['description']}"
    return said + "."


def refused(found: dict[str, Any]) -> str:
    """Return the names of the effects that were fitted and refused (the reasons are in --json)."""
    return ", ".join(text.split(":")[0] for text in found["refused"]) or "nothing"


def _row(known: str, found: dict[str, Any]) -> str:
    """Return the row of an answer, its effects side by side."""
    out = found["heldout"]
    held = f"{_mm(out['rms_before_m'])} → {_mm(out['rms_after_m'])}"
    if not found["effects"]:
        return f"| {known} | {found['verdict']} | - | - | - | - | - | {held} |"
    cells = [cause_cells(effect) for effect in found["effects"]]
    joined = " | ".join("; ".join(column) for column in zip(*cells, strict=True))
    return f"| {known} | {found['verdict']} | {joined} | {held} |"


def cause_cells(effect: dict[str, Any]) -> tuple[str, ...]:
    """Return name, place, size, equivalents and log Bayes factor of an accepted effect."""
    key, size = next(iter(effect["parameters"].items()))
    place = effect["arc_length_m"]
    low, high = size["ci95"]
    return (
        effect["name"],
        "-" if place is None else f"{place[0]:.3f} .. {place[1]:.3f}",
        f"{key} {size['value']:.3g} {size['unit']} ({low:.3g} .. {high:.3g})",
        ", ".join(effect["equivalent_to"]) or "-",
        f"{effect['evidence']['log_bayes_factor']:.0f}",
    )


def wire_table(straight: Identified, free: Identified, own: Identified) -> str:
    rows = [
        "A wire clamped at both ends, five poses clicked on photographs: is it straight at rest?",
        "Written by `python -m benchmarks.real`.",
        "",
        "| rest shape | rms of fitted frames [mm] | frame by frame [mm] | EI [N m²] (95 %) |",
        "|---|---|---|---|",
    ]
    models = {"straight": straight, "one curve": free, "a curve for every pose": own}
    for name, i in models.items():
        by_frame = ", ".join(_mm(v) for v in i.by_frame)
        rigid = "; ".join(estimate(p) for p in i.rigid)
        rows.append(f"| {name} | {_mm(i.fitted)} | {by_frame} | {rigid} |")
    return "\n".join(rows) + "\n"


def estimate(p: dict[str, Any]) -> str:
    """Return value, interval and, unless it is determined, the verdict of a parameter."""
    verdict = "" if p["verdict"] == "determined" else f", {p['verdict']}"
    return f"{p['value']:.3g} ({interval(p)}{verdict})"


def interval(p: dict[str, Any]) -> str:
    """Return the interval of a parameter in words, or its limit."""
    if p["below"] is not None:
        return f"below {p['below']:.3g}"
    return "-" if p["ci95"] is None else f"{p['ci95'][0]:.3g} .. {p['ci95'][1]:.3g}"


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{1e3 * value:.3g}"
