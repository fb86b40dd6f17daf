"""What `diagnose` says: on the terminal, and as the fixed JSON."""

from __future__ import annotations

from typing import Any

from ropefit.artifacts import Diagnosis
from ropefit.artifacts.diagnosis import Size
from ropefit.console import Session
from ropefit.runs.protocol import Outcome


def tell_diagnosed(session: Session, outcome: Outcome[Any]) -> dict[str, Any]:
    """Tell a diagnosis and return its JSON."""
    d: Diagnosis = outcome.artifact
    _tell_diagnosis(session, d)
    return {
        "stage": "diagnose",
        "artifact": str(outcome.path),
        "computed": outcome.computed,
        "verdict": d.verdict,
        "effects": [
            {
                "name": c.name,
                "kind": c.kind,
                "arc_length_m": c.arc_length,
                "frames": c.frames,
                "parameters": {key: size.model_dump() for key, size in c.parameters.items()},
                "equivalent_to": c.equivalent_to,
                "evidence": {
                    "heldout_log_likelihood_gain": float(c.heldout_gain.sum()),
                    "log_bayes_factor": c.log_evidence,
                    "p_value": c.p_value,
                },
                "description": c.sentence,
            }
            for c in d.causes.values()
        ],
        "mismatch": [
            {
                "arc_length_m": r.arc_length,
                "frames": r.frames,
                "rms_m": r.rms,
                "direction": r.direction,
            }
            for r in d.mismatch
        ],
        "heldout": {
            "rms_before_m": d.rms_before,
            "rms_after_m": d.rms_after,
            "noise_m": d.noise_white,
        },
        "detectable": {key: item.model_dump() for key, item in d.detectable.items()},
        "next_motion": {"separates": d.separates, "description": d.motion},
        "refused": d.refused,
        "latent_force": {"log_evidence": d.force_evidence, "threshold": d.force_threshold},
    }


def _told(key: str, size: Size) -> str:
    interval = f"({size.ci95[0]:.3g} .. {size.ci95[1]:.3g})"
    return f"{key} {size.value:.3g} {interval}" + ("" if size.unit == "1" else f" {size.unit}")


def _tell_diagnosis(session: Session, d: Diagnosis) -> None:
    if d.verdict == "none":
        session.say("nothing was left out: what the nominal model does not explain is noise")
    elif d.verdict == "unknown":
        session.say(
            "something was left out that no effect of the catalogue explains; see the latent force "
            "in the report"
        )
    rows = []
    for c in d.causes.values():
        where = "-" if c.arc_length is None else f"{c.arc_length[0]:.3f} .. {c.arc_length[1]:.3f}"
        key, size = next(iter(c.parameters.items()))
        rows.append(
            [
                c.name,
                where,
                _told(key, size),
                ", ".join(c.equivalent_to) or "-",
                f"{c.log_evidence:.1f}",
            ]
        )
    if rows:
        session.table(
            f"{d.recording}: left out",
            ["what", "where [m]", "size (95 %)", "or as well", "nats"],
            rows,
        )
        for c in d.causes.values():
            session.say(c.sentence)
    session.say(
        f"held-out frames: rms {d.rms_before * 1e3:.3g} mm before, {d.rms_after * 1e3:.3g} mm "
        f"after; noise of a point {d.noise_white * 1e3:.3g} mm"
    )
    for reason in d.refused:
        session.say(f"not believed, or not to be told: {reason}")
    if d.motion:
        session.say(f"to tell {' from '.join(d.separates)}: {d.motion}")
