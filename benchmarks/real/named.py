"""Diagnose measured ropes in motion, and predict clips that neither fit nor diagnosis has seen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import ropefit
from benchmarks.real.motion import Score, clips_of, recorded, scored
from benchmarks.real.shapes import cause_cells, refused
from ropefit.artifacts import Diagnosis, Model, Observations, read
from ropefit.fitting.motion import diagnosed_motion, restored_motion


@dataclass(frozen=True)
class Named:
    """What `diagnose --json` answers, and how the eval clips are predicted before and after."""

    answer: dict[str, Any]
    before: Score
    after: Score


def name_motion(source: Path, folder: Path, count: int) -> Named:
    """Diagnose `count` training clips from the parameters that `identify` frees of itself, and
    predict the eval clips. What folder holds already is not computed again."""
    run = folder / "run-train"
    if not (run / Model.file_name).exists():
        recorded(source, folder, count)
        ropefit("identify", "--solver", "dynamics", "--holdout", "0", "--run", run)
    answer = ropefit("diagnose", "--run", run)
    model, _ = read(run / Model.file_name, Model)
    found, _ = read(run / Diagnosis.file_name, Diagnosis)
    o, _ = read(folder / "run-eval" / Observations.file_name, Observations)
    clips = len(clips_of(source, "eval"))
    before = scored(o, *restored_motion(o, model.nominal), clips)
    after = scored(o, *diagnosed_motion(o, model.nominal, found), clips)
    return Named(answer, before, after)


def named_table(found: dict[str, Named], clips: int) -> str:
    rows = [
        f"What `ropefit diagnose` names in {clips} training clips of these cables in motion, from",
        "a model in which `ropefit identify --solver dynamics` frees rigidities and damping.",
        "*Eval*: mean absolute error per coordinate on the clips that their authors score on, all",
        "markers, open loop over 5 s from two true frames, before and with what was named.",
        "Written by `python -m benchmarks.real`.",
        "",
        "| rope | verdict | accepted | place [m] | size (95 %) | equivalent to | log Bayes factor "
        "| held-out clips before → after [mm] | eval before → after [mm] |",
        "|---" * 9 + "|",
    ]
    for rope, one in found.items():
        held = one.answer["heldout"]
        ends = [f"{1e3 * held['rms_before_m']:.1f} → {1e3 * held['rms_after_m']:.1f}"]
        ends.append(" → ".join(f"{1e3 * np.mean(s.clip):.1f}" for s in (one.before, one.after)))
        causes = [cause_cells(effect) for effect in one.answer["effects"]] or [("-",) * 5]
        rows += [
            f"| {rope} | {one.answer['verdict']} | " + " | ".join((*cells, *ends)) + " |"
            for cells in causes
        ]
    said = "; ".join(f"{rope}: {refused(one.answer)}" for rope, one in found.items())
    rows += ["", f"Refused: {said}."]
    return "\n".join(rows) + "\n"
