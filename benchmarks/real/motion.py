"""Measured ropes in motion: `identify --solver dynamics` on training clips, open loop on others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.command import ropefit
from ropefit.adapters.motion_setup import Span
from ropefit.artifacts import Model, Observations, read
from ropefit.fitting.motion import restored_motion
from ropefit.inference.bins import match
from ropefit.models.dynamics import MotionPoint

APART = 100.0  # s between clips in a joined recording
FREE = "EI,GJ,EA,bend_damping,air_damping,rest_curve,length"
# Clips in which a marker jumps, and one (90) in which a marker sits elsewhere on the rope.
JUMPING = {"mocap_dlo1": (56, 58, 63, 66, 67, 76, 81, 86, 87, 88, 89, 90, 99)}
MARKERS = 'file = "markers.npz"'
TRUE = 2  # frames that a prediction starts from
HELD = 4  # markers, two at each end


@dataclass(frozen=True)
class Score:
    """Of one rope. clip (C,) [m]: mean absolute error per coordinate over all markers, held ones
    included; free (C,): over the others alone; by_time (T,) and by_marker (M,): where it lives."""

    clip: np.ndarray
    free: np.ndarray
    by_time: np.ndarray
    by_marker: np.ndarray
    parameters: dict[str, dict]


def join(
    source: Path, clips: list[Path], target: Path, arc: np.ndarray | None = None,
    frames: int | None = None,
) -> None:  # fmt: skip
    """Join several clips to one recording, with pauses between them.

    Arc (M,) [m]: places of the markers on the rope, if known from other clips. frames: only so many
    of each, from the first on.
    """
    arrays = [np.load(clip / "markers.npz") for clip in clips]
    target.mkdir(parents=True)
    np.savez(
        target / "markers.npz",
        positions=np.concatenate([a["positions"][:frames] for a in arrays]),
        time=np.concatenate([a["time"][:frames] + APART * k for k, a in enumerate(arrays)]),
    )
    text = (clips[0] / "recording.toml").read_text()
    if arc is not None:
        told = f"{MARKERS}\narc_length = {[round(float(v), 6) for v in arc]}"
        text = text.replace(MARKERS, told)
    (target / "recording.toml").write_text(text.replace(clips[0].name, f"{source.name} joined"))


def clips_of(source: Path, kind: str) -> list[Path]:
    """Return the authors' clips, without training clips in which a marker jumps."""
    bad = JUMPING.get(source.name, ()) if kind == "train" else ()
    return [c for c in sorted(source.glob(f"{kind}_*")) if int(c.name[-3:]) not in bad]


def recorded(source: Path, folder: Path, count: int) -> None:
    """Preprocess `count` training clips, evenly spread, and the eval clips: a recording each."""
    train, test = clips_of(source, "train"), clips_of(source, "eval")
    few = [train[k] for k in np.linspace(0, len(train) - 1, count).round().astype(int)]
    join(source, few, folder / "train")
    ropefit("preprocess", folder / "train", "--run", folder / "run-train")
    seen, _ = read(folder / "run-train" / Observations.file_name, Observations)
    join(source, test, folder / "eval", seen.point_arc[: seen.point_start[1]])
    ropefit("preprocess", folder / "eval", "--run", folder / "run-eval")


def prove(source: Path, folder: Path, count: int) -> Score:
    """Fit to `count` training clips and predict the eval clips. What folder holds already is not
    fitted again."""
    if not (folder / "run-train" / Model.file_name).exists():
        recorded(source, folder, count)
        ropefit(
            "identify", "--solver", "dynamics", "--free", FREE, "--holdout", "0",
            "--run", folder / "run-train",
        )  # fmt: skip
    model, _ = read(folder / "run-train" / Model.file_name, Model)
    o, _ = read(folder / "run-eval" / Observations.file_name, Observations)
    found = scored(o, *restored_motion(o, model.nominal), len(clips_of(source, "eval")))
    group = next(iter(model.nominal.groups.values()))
    parameters = {name: p.model_dump() for name, p in group.parameters.items()}
    return replace(found, parameters=parameters)


def scored(o: Observations, span: Span, point: MotionPoint, clips: int) -> Score:
    """Score the prediction of a recording of some clips, all of one length."""
    s = match(span.data, point.seen, 1)
    gap = np.full((len(o.frames), s.bin.max() + 1), np.nan)
    gap[s.frame, s.bin] = np.abs(s.residual).mean(1)
    free = gap[:, np.isfinite(gap).any(0)].reshape(clips, len(gap) // clips, -1)[:, TRUE:]
    markers = free.shape[-1] + HELD  # of held markers the place is given
    return Score(
        np.nansum(np.nanmean(free, axis=1), axis=1) / markers,
        np.nanmean(free, axis=(1, 2)),
        np.nansum(np.nanmean(free, axis=0), axis=1) / markers,
        np.pad(np.nanmean(free, axis=(0, 1)), HELD // 2),
        {},
    )
