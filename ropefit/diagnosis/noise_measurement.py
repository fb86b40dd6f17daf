"""The noise of a recording, estimated from its own data without the mismatch.

Noise is what the most flexible credible fit leaves (nominal, calibration, and every steady effect
at every place, all at once). Its correlation along the rope is estimated there by restricted
maximum likelihood, never on the nominal residual, which contains the mismatch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.inference.bins import Stations, collected
from ropefit.inference.least_squares import Fit
from ropefit.inference.noise import EndNoise, Noise, likeliest
from ropefit.models.response import in_parts
from ropefit.solvers.equilibrium.implicit import Directions, tangent

AT_ONCE = 2048  # rows
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
    design = _design(fitted, sensitivities, moves)
    residual = fitted.whitener.undo(fitted.z).reshape(fitted.stations.residual.shape)
    every = replace(fitted.stations, residual=residual)
    mine = _usual_frames(every, residual)
    few = Stations(*(getattr(every, name)[mine] for name in Stations.__dataclass_fields__))
    design = design[np.repeat(mine, fitted.stations.residual.shape[1])]
    return likeliest(few, replace(fitted.problem.noise, ends=end_noise(fitted)), design)


def _design(fitted: Fit, sensitivities: list[Sensitivity], moves: list[np.ndarray]) -> np.ndarray:
    """Return (M D, P) [m] what may be in the residual besides noise: of what the rope's parameters,
    the calibration and every steady effect do, the directions that move stations; and the moves.

    All columns together are large: they are put together some rows at a time.
    """
    physics = [c.values for c in sensitivities if c.hypothesis.effect.kind == "physics"]
    steady = [values.reshape(len(values), -1) for values in physics]
    spread = np.where(fitted.prior.held, fitted.prior.sd, FREE_PRIOR_SD)
    many = sum(block.shape[1] for block in steady)
    scale = np.concatenate([spread, np.full(many, EFFECT_PRIOR_SD)])
    some = [slice(k, k + AT_ONCE) for k in range(0, len(fitted.jacobian), AT_ONCE)]

    def every(rows: slice) -> np.ndarray:
        return np.concatenate([block[rows] for block in (fitted.jacobian, *steady)], 1) * scale

    gram = np.zeros((len(scale), len(scale)))
    for rows in some:
        part = every(rows)
        gram += part.T @ part
    strength, directions = np.linalg.eigh(gram)
    directions = directions[:, strength > WEAKEST_MODE**2]
    out = np.empty((len(fitted.jacobian), directions.shape[1] + len(moves)))
    of_all = out[:, : directions.shape[1]]
    for rows in some:
        of_all[rows] = every(rows) @ directions
    fitted.whitener.undo(of_all, of_all)
    for k, move in enumerate(moves):
        out[:, directions.shape[1] + k] = FITTED_PRIOR_SD * move.ravel()
    return out


def end_noise(fitted: Fit) -> EndNoise:
    """Return the response of the fitted rope to an error of an end in one frame."""
    point, s = fitted.point, fitted.stations
    frames = len(point.seen)
    held = [end for end in range(2) if not np.isnan(point.setup.ends[:, end]).any()]
    clamps = [end for end in range(2) if point.setup.clamped[end]]
    places = [(end, axis) for end in held for axis in range(3)]
    turns = [(end, axis) for end in clamps for axis in range(2)]  # about the tangent: twist
    many = len(places) + len(turns)
    ends, clamp = np.zeros((2, frames, many, 2, 3))
    for k, (end, axis) in enumerate(places):
        ends[:, k, end, axis] = 1.0
    for k, (end, axis) in enumerate(turns, len(places)):
        clamp[:, k, end, axis] = 1.0
    parts = (
        (t, np.moveaxis(tangent(few, Directions(ends=ends[t], clamp=clamp[t]))[0], 1, 0))
        for t, few in in_parts(point.solution, many)
    )
    values = collected(s, s, parts, many)
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
