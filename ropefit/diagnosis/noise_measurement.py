"""The noise of a recording, estimated from its own data without the mismatch.

Noise is what the most flexible credible fit leaves (nominal, calibration, and every steady effect
at every place, all at once). Its correlation along the rope is estimated there by restricted
maximum likelihood, never on the nominal residual, which contains the mismatch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.inference.bins import Stations
from ropefit.inference.least_squares import Fit
from ropefit.inference.noise import EndNoise, Noise, likeliest
from ropefit.solvers.equilibrium.implicit import Directions, tangent

EFFECT_PRIOR_SD = 10.0  # usual sizes
FREE_PRIOR_SD = 10.0  # search variables: of parameters without a prior
FITTED_PRIOR_SD = 3.0  # times what a fit says: of effects that were fitted
WEAKEST_MODE = 1.0  # sd: directions that move all stations together by less are ignored
MOST_AMPLIFICATION = 8.0  # of an end's error by the rope; in lengths for turns
UNUSUAL_RATIO = 2.0  # of a frame's mean square to the median one
USUAL_SHARE = 0.75  # at least, of the frames are usual


def measured_noise(
    fitted: Fit, sensitivities: list[Sensitivity], moves: list[np.ndarray]
) -> tuple[Noise, float]:
    """Return white and correlated noise of the stations of a nominal fit, and that of its ends;
    with its negative log likelihood [nats].

    moves: (M, D) [m] each, what further effects may have done to the stations.
    """
    physics = [c.values for c in sensitivities if c.hypothesis.effect.kind == "physics"]
    steady = [EFFECT_PRIOR_SD * values.reshape(len(values), -1) for values in physics]
    spread = np.where(np.isfinite(fitted.prior), fitted.prior, FREE_PRIOR_SD)
    design = np.concatenate([fitted.jacobian * spread, *steady], axis=1)
    strength, directions = np.linalg.eigh(design.T @ design)
    design = fitted.whitener.undo(design @ directions[:, strength > WEAKEST_MODE**2])
    design = np.column_stack([design, *(FITTED_PRIOR_SD * move.ravel() for move in moves)])
    residual = fitted.whitener.undo(fitted.z).reshape(fitted.stations.residual.shape)
    every = replace(fitted.stations, residual=residual)
    mine = _usual_frames(every, residual)
    few = Stations(*(getattr(every, name)[mine] for name in Stations.__dataclass_fields__))
    rows = np.repeat(mine, fitted.stations.residual.shape[1])
    return likeliest(few, replace(fitted.problem.noise, ends=end_noise(fitted)), design[rows])


def end_noise(fitted: Fit) -> EndNoise:
    """Return the response of the fitted rope to an error of an end in one frame."""
    point, s = fitted.point, fitted.stations
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


def on_edge(fitted: Fit) -> np.ndarray:
    """Return (F,) bool: frames so near instability that a tiny error of an end decides the shape.

    No linear prediction holds there, and no error of the ends is small.
    """
    noise = end_noise(fitted)
    length = float(fitted.point.setup.properties.length.sum())
    out = np.zeros(len(fitted.point.seen), dtype=bool)
    for sensitivities, most in (
        (noise.position, MOST_AMPLIFICATION),
        (noise.tilt, MOST_AMPLIFICATION * length),
    ):
        if sensitivities.size:
            far = np.abs(np.nan_to_num(sensitivities, nan=np.inf)).max(axis=(1, 2)) > most
            out[fitted.stations.frame[far]] = True
    return out


def _usual_frames(s: Stations, residual: np.ndarray) -> np.ndarray:
    """Return (M,) bool: stations outside the frames, a quarter at most, that are far worse than the
    others: something may act in these only."""
    frames = np.unique(s.frame)
    size = np.array([(residual[s.frame == t] ** 2).mean() for t in frames])
    usual = max(UNUSUAL_RATIO * float(np.median(size)), float(np.quantile(size, USUAL_SHARE)))
    return np.isin(s.frame, frames[size <= usual])
