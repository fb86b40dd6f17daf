"""What `identify` found, told on the console and as JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit.artifacts import FittedModel, Model, Stepped
from ropefit.console import Session
from ropefit.runs.protocol import Outcome


def tell_identified(session: Session, outcome: Outcome[Any]) -> dict[str, Any]:
    """The table and sentences on model.h5, and its --json."""
    model: Model = outcome.artifact
    m = model.nominal
    rows = []
    for name, group in m.groups.items():
        for key, p in group.parameters.items():
            interval = f"{p.ci95[0]:.4g} .. {p.ci95[1]:.4g}" if p.ci95 else "-"
            if p.below is not None:
                interval = f"below {p.below:.4g}"
            partners = f" with {', '.join(p.trades_with)}" if p.trades_with else ""
            label = f"{name} {key}" if len(m.groups) > 1 else key
            label += "" if p.unit == "1" else f" [{p.unit}]"
            rows.append(
                [label, f"{p.initial:.4g}", f"{p.value:.4g}", interval, p.verdict + partners]
            )
    session.table(
        f"{model.recording}: {m.solver}, {m.loss}, {m.search}",
        ["parameter", "before", "after", "95 % interval", "verdict"],
        rows,
    )
    heldout = "none held out" if m.rms_heldout is None else f"held out {m.rms_heldout * 1e3:.3g} mm"
    session.say(
        f"point-to-line rms: fitted frames {m.rms_fit * 1e3:.3g} mm, {heldout}, "
        f"before {np.sqrt(np.mean(m.rms_initial**2)) * 1e3:.3g} mm"
    )
    _say_how_it_settled(session, m)
    for group in m.groups.values():
        if not group.converged:
            session.say(f"warning: the search did not converge ({group.stop_reason})")
    return {
        "stage": "identify",
        "artifact": str(outcome.path),
        "computed": outcome.computed,
        "solver": m.solver,
        "loss": m.loss,
        "search": m.search,
        "groups": {
            name: {
                "frames": group.frames,
                "parameters": {key: p.model_dump() for key, p in group.parameters.items()},
                "loss_before": group.loss_before,
                "loss_after": group.loss_after,
                "converged": group.converged,
                "stop_reason": group.stop_reason,
            }
            for name, group in m.groups.items()
        },
        "rms_fit_m": m.rms_fit,
        "rms_heldout_m": m.rms_heldout,
        "solver_converged": m.solver_converged,
        **_settled(m),
    }


def _say_how_it_settled(session: Session, m: FittedModel) -> None:
    if m.iterated and not m.solver_converged:
        session.say(
            f"the solver has not converged: iterated twice as long, particles move by "
            f"{np.median(m.iterated.drift):.2%} of the length; the weights belong to "
            f"{m.iterated.steps} x {m.iterated.iterations} iterations and are not properties of "
            "the rope"
        )
    if m.stepped:
        _say_how_it_moved(session, m.stepped)
    if m.balance is None:
        return
    b = m.balance
    if not b.mass_known:
        session.say(
            "the mass is not known: shapes fix rigidities over the weight per length only; bending "
            f"length (EI/w)^(1/3) = {b.bending_length:.4g} m"
        )
    lost = int((~b.converged).sum())
    if lost:
        session.say(f"warning: {lost} of {len(b.converged)} frames reach no equilibrium (marked)")
    twice = int(np.isfinite(b.other).sum())
    if twice:
        session.say(f"{twice} of {len(b.other)} frames have a second stable equilibrium")


def _say_how_it_moved(session: Session, s: Stepped) -> None:
    if not s.mass_known:
        session.say(
            "the mass is not known: motion too fixes rigidities and dampings over the weight per "
            f"length only; bending length (EI/w)^(1/3) = {s.bending_length:.4g} m"
        )
    short = int((s.clip < 0).sum())
    if short:
        session.say(f"{short} frames belong to no clip that is long enough: left as observed")


def _settled(m: FittedModel) -> dict[str, Any]:
    """How the states were found, for --json."""
    if m.iterated:
        return {
            "drift": float(np.median(m.iterated.drift)),
            "length_error": float(np.mean(np.abs(m.iterated.length_error[:, -1]))),
        }
    if m.stepped:
        return {
            "clips": m.stepped.clips,
            "mass_known": m.stepped.mass_known,
            "bending_length_m": m.stepped.bending_length,
            "calibration": {n: item.model_dump() for n, item in m.stepped.calibration.items()},
        }
    assert m.balance is not None
    b = m.balance
    return {
        "frames_converged": int(b.converged.sum()),
        "smallest_eigenvalue_N": b.stability,
        "other_equilibrium_m": b.other,
        "mass_known": b.mass_known,
        "bending_length_m": b.bending_length,
        "calibration": {name: item.model_dump() for name, item in b.calibration.items()},
        "noise_correlated_m": b.correlated_noise,
        "noise_correlation_length_m": b.correlation_length,
    }
