"""What `--json` says of a stage's artifact, and what a batch keeps of it. Lengths in m."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit.api.runs import Exported
from ropefit.artifacts import Control, Diagnosis, FittedModel, Model, Observations
from ropefit.artifacts.causes import Cause
from ropefit.artifacts.diagnosis import Simulation
from ropefit.artifacts.exports import deviation
from ropefit.runs.protocol import Outcome


def preprocessed(outcome: Outcome[Observations]) -> dict[str, Any]:
    """Return the summary of observations.h5."""
    o = outcome.artifact
    return {
        **_head("preprocess", outcome),
        "recording": o.recording,
        "frames": len(o.frames),
        "dropped": [item.model_dump() for item in o.dropped],
        "length_m": o.length,
        "length_source": o.length_source,
        "ends": list(o.end_kind),
        "ends_assumed": o.ends_assumed,
        "noise_m": float(np.median(o.noise)),
        "visibility": float(o.visibility.mean()),
        "projected": o.projected,
        "projection": o.projection_reason,
        "depth_measured": o.depth_measured,
        "noise_correlated_m": o.noise_correlated,
        "noise_length_m": o.noise_length,
        "length_sd_m": o.length_sd,
        "quality": float(np.median(o.quality)) if o.quality is not None else None,
    }


def identified(outcome: Outcome[Model]) -> dict[str, Any]:
    """Return the summary of model.h5."""
    m = outcome.artifact.nominal
    return {
        **_head("identify", outcome),
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
        **({"laws": [_cause(c) for c in m.laws.values()]} if m.laws else {}),
        "rms_fit_m": m.rms_fit,
        "rms_heldout_m": m.rms_heldout,
        "solver_converged": m.solver_converged,
        **_settled(m),
    }


def _settled(m: FittedModel) -> dict[str, Any]:
    """Return how the states were found, by kind of solver."""
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


def diagnosed(outcome: Outcome[Diagnosis]) -> dict[str, Any]:
    """Return the summary of diagnosis.h5."""
    d = outcome.artifact
    return {
        **_head("diagnose", outcome),
        "verdict": d.verdict,
        "effects": [_cause(c) for c in d.causes.values()],
        "known": [_cause(c) for c in d.known.values()],
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
        "linearity": d.unseen("linearity"),
        "detectable": {key: item.model_dump() for key, item in d.detectable.items()},
        "next_motion": {"separates": d.separates, "description": d.motion},
        "refused": d.refused,
        "dropped": [item.model_dump() for item in d.dropped],
        "latent_force": {"log_evidence": d.force_evidence, "threshold": d.force_threshold},
        **({"simulation": _simulation(d, d.simulation)} if d.simulation else {}),
    }


def _cause(c: Cause) -> dict[str, Any]:
    return {
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
        **({"law": c.law.model_dump()} if c.law else {}),
    }


def _simulation(d: Diagnosis, s: Simulation) -> dict[str, Any]:
    return {
        "name": s.name,
        "verdict": s.verdict,
        "effects": [_cause(c) for c in s.effects.values()],
        "missing": s.missing,
        "differences": s.differences,
        "rope": {name: size.model_dump() for name, size in s.rope.items()},
        "rms_m": s.rms,
        "rms_converged_m": s.rms_converged,
        "rms_of_rope_m": s.rms_of_rope,
        "rms_explained_m": s.rms_explained,
    }


def controlled(outcome: Outcome[Control]) -> dict[str, Any]:
    """Return the summary of control.h5."""
    c = outcome.artifact
    return {
        **_head("control", outcome),
        "kind": c.kind,
        "loss": c.loss_name,
        "cases": c.cases,
        "position_m": c.position,
        "position_sd_m": c.position_sd,
        "orientation": c.orientation,
        "deviation_m": c.deviation,
        "deviation_px": c.deviation_px,
        "key_deviation_m": c.key_deviation,
        "key_deviation_px": c.key_deviation_px,
        "obj1_m": c.obj1,
        "length_error": c.length_error,
        "converged": c.converged,
        "notes": c.notes,
    }


def exported(made: Exported) -> dict[str, Any]:
    """Return the summary of an export, with how far off the rope is in the simulator."""
    data = {"stage": "export", "files": made.files, "effects": made.record.effects}
    return {**data, "notes": made.record.notes, "check": _checked(made)}


def _checked(made: Exported) -> dict[str, Any] | None:
    from ropefit.reporting.sections.exports import settled

    check = made.record.check
    if check is None:
        return None
    off = deviation(made.record, made.length)
    return {
        "simulator": check.simulator,
        "frames": made.record.frames,
        "settled": settled(check),
        "deviation": off,
        "largest_deviation": float(np.nanmax(off)) if np.isfinite(off).any() else None,
    }


def _head(stage: str, outcome: Outcome[Any]) -> dict[str, Any]:
    return {"stage": stage, "artifact": str(outcome.path), "computed": outcome.computed}


def plain(value: Any) -> Any:
    """Return a value as JSON takes it: numpy to Python, numbers that are not finite to null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
