"""The noise of a recording from its own data, mismatch set aside: DIAGNOSIS, section 1.

What is left after the most flexible credible fit (nominal, calibration, and every steady effect at
every place, all at once) is noise; its correlation along the rope is measured there, never on the
nominal residual, which would swallow the mismatch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ropefit.inference.diagnosis.columns import Columns
from ropefit.inference.least_squares import Fit
from ropefit.inference.noise import EndNoise, Noise, estimate
from ropefit.inference.stations import Stations
from ropefit.solvers.equilibrium.implicit import Directions, tangent

RIDGE = 10.0  # usual sizes: effects may be as large as that
FREE = 10.0  # search variables: how far a free parameter may be off
SEVERAL = 3.0  # times what a fit says: effects may be as large as that
WEAK = 1.0  # sd: what moves all stations together by less is left out
EDGE = 8.0  # what an end's error may be multiplied by, lengths for turns
UNUSUAL = 2.0  # times the usual mean square of a frame


def measure(found: Fit, columns: list[Columns], noise: Noise, moves: list[np.ndarray]) -> Noise:
    """White and correlated noise of the stations of a nominal fit, and that of its ends.

    moves: (M, D) [m] each, what else an effect may have done to the stations.
    """
    physics = [c.values for c in columns if c.family.effect.kind == "physics"]
    steady = [RIDGE * values.reshape(len(values), -1) for values in physics]
    spread = np.where(np.isfinite(found.prior), found.prior, FREE)
    design = np.concatenate([found.jacobian * spread, *steady], axis=1)
    strength, directions = np.linalg.eigh(design.T @ design)
    design = found.whitener.undo(design @ directions[:, strength > WEAK**2])
    design = np.column_stack([design, *(SEVERAL * move.ravel() for move in moves)])
    residual = found.whitener.undo(found.z).reshape(found.stations.residual.shape)
    every = replace(found.stations, residual=residual)
    mine = _usual_frames(every, residual)
    few = Stations(*(getattr(every, name)[mine] for name in Stations.__dataclass_fields__))
    rows = np.repeat(mine, found.stations.residual.shape[1])
    return estimate(few, replace(noise, ends=end_noise(found)), design[rows])


def end_noise(found: Fit) -> EndNoise:
    """What the fitted rope does when an end of one frame is off."""
    point, s = found.point, found.stations
    frames = len(point.seen)
    held = [end for end in range(2) if not bool(torch.isnan(point.setup.ends[:, end]).any())]
    clamps = [end for end in range(2) if point.setup.clamped[end]]
    places = [(end, axis) for end in held for axis in range(3)]
    turns = [(end, axis) for end in clamps for axis in range(2)]  # about the tangent: twist
    many = len(places) + len(turns)
    ends, clamp = np.zeros((2, frames, many, 2, 3))
    for k, (end, axis) in enumerate(places):
        ends[:, k, end, axis] = 1.0
    for k, (end, axis) in enumerate(turns, len(places)):
        clamp[:, k, end, axis] = 1.0
    dx, _ = tangent(point.solution, Directions(ends=ends, clamp=clamp))
    values = s.project(np.moveaxis(dx, 1, 0))
    return EndNoise(s, values[..., : len(places)], values[..., len(places) :])


def on_edge(found: Fit) -> np.ndarray:
    """(F,) bool: frames so near to losing their stability that a hair's breadth at an end decides
    the shape. No linear prediction holds there, and no error of the ends is small."""
    noise = end_noise(found)
    length = float(found.point.setup.properties.length.sum())
    out = np.zeros(len(found.point.seen), dtype=bool)
    for columns, most in ((noise.position, EDGE), (noise.tilt, EDGE * length)):
        if columns.size:
            far = np.abs(np.nan_to_num(columns, nan=np.inf)).max(axis=(1, 2)) > most
            out[found.stations.frame[far]] = True
    return out


def _usual_frames(s: Stations, residual: np.ndarray) -> np.ndarray:
    """(M,) bool: not in the frames, a quarter at most, that are left far worse than the others:
    something may act there that acts in few frames only."""
    frames = np.unique(s.frame)
    size = np.array([(residual[s.frame == t] ** 2).mean() for t in frames])
    usual = max(UNUSUAL * float(np.median(size)), float(np.quantile(size, 0.75)))
    return np.isin(s.frame, frames[size <= usual])
