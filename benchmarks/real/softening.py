"""A measured cable with a law of bending: does it soften, and is it predicted under a weight?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import ropefit
from benchmarks.real.shapes import VARYING, cause_cells, refused

WAYS = {"linear": (), "law of bending": ("--law", "bending")}
TOLD = (0.1, 0.5, 1.0)  # of the largest curvature in the data: where M / k is told


@dataclass(frozen=True)
class Predicted:
    """The unchanged cable as identified, and what the changed one is diagnosed as from it."""

    known: dict[str, Any]
    changed: dict[str, Any]


def predicted(real: Path, folder: Path) -> dict[str, Predicted]:
    """Identify the unchanged cable with a rest curve, linear and with a law; diagnose the other."""
    out = {}
    for name, more in WAYS.items():
        was, now = (folder / name.split()[0] / kind for kind in ("unweighted", "weighted"))
        for run in (was, now):
            ropefit("preprocess", real / f"cable_black_{run.name}", "--run", run)
        known = ropefit("identify", "--run", was, "--free", VARYING, *more)
        ropefit("identify", "--run", now, "--free", VARYING)
        out[name] = Predicted(known, ropefit("diagnose", "--run", now, "--nominal", was))
    return out


def softening_table(found: dict[str, Predicted]) -> str:
    rows = [
        "A cable held at its base, its free end hanging, with a rest curve (`--free",
        "EI,rest_curve`), and the same cable changed, by `ropefit diagnose --nominal`; three",
        "markers, rms in mm.",
        "Written by `python -m benchmarks.real --only softening --write docs/laws.md`.",
        "",
        "| bending | unchanged: fitted | held-out angles | changed: verdict | accepted | where [m] "
        "| size (95 %) | equivalent to | log Bayes factor | held out before → after |",
        "|---" * 10 + "|",
    ]
    for name, one in found.items():
        fitted = (f"{1e3 * one.known[key]:.2f}" for key in ("rms_fit_m", "rms_heldout_m"))
        held = one.changed["heldout"]
        ends = " → ".join(f"{1e3 * held[key]:.2f}" for key in ("rms_before_m", "rms_after_m"))
        for cells in [cause_cells(e) for e in one.changed["effects"]] or [("-",) * 5]:
            cells = (name, *fitted, one.changed["verdict"], *cells, ends)
            rows.append(f"| {' | '.join(cells)} |")
    rows += [""] + [f"Refused, {name}: {refused(one.changed)}." for name, one in found.items()]
    for law in (law for one in found.values() for law in one.known.get("laws", [])):
        curve = law["law"]["curve"]
        x, y, low, high = (np.array(curve[key]) for key in ("x", "y", "low", "high"))
        told = [np.abs(x - share * curve["visited"][1]).argmin() for share in TOLD]
        secants = "; ".join(
            f"{y[k] / x[k]:.3g} ({low[k] / x[k]:.3g} .. {high[k] / x[k]:.3g}) at {x[k]:.2g} 1/m"
            for k in told
        )
        forms = ", ".join(law["law"]["forms"]) or "none"
        rows += [
            "",
            f"The law, {law['evidence']['log_bayes_factor']:.0f} nats over the linear cable: M/k in"
            f" N m^2 (95 %) is {secants}; forms that remain: {forms}.",
        ]
    return "\n".join(rows) + "\n"
