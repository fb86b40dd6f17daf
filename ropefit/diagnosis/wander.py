"""How many samples of a motion's residual count as one.

What an open-loop motion misses wanders for a swing or so, and neighbouring markers miss it alike:
thousands of samples are worth as many as there are independent ones (effective sample size, Geyer
1992, in time; participation ratio of the covariance along the rope).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.scan import Projection
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.inference.discrepancy import orders, repeats, repeats_in, unequal
from ropefit.inference.least_squares import Fit
from ropefit.inference.noise import Noise

MESH_ERROR = 5e-4  # of the length: by which ropes of other meshes, steps and solvers differ


def wandering_noise(fitted: Fit, sensitivities: list[Sensitivity]) -> Noise:
    """Return the noise of markers, with the repeats that one independent sample has.

    Both are those of what the best single effect leaves, at its best place and to first order: a
    mismatch with a cause is no noise. All effects at once would explain noise as well: a few swings
    are fewer samples than there are effects and places.
    """
    left = _left_by_the_best(fitted, sensitivities)
    residual = fitted.whitener.undo(left).reshape(fitted.stations.residual.shape)
    clips, s = fitted.forward.clips, fitted.stations
    clipwise = unequal(s, residual, clips, len(fitted.point.seen))
    residual = residual / np.sqrt(clipwise[s.frame])[:, None]
    marker = float(np.sqrt((residual**2).mean()))
    # What the mesh misses is the same in all frames of a clip and along much of the rope.
    length = float(fitted.point.setup.properties.length.sum())
    alike = len(residual) / max(len(clips), 1)
    mesh = alike * (MESH_ERROR * length / marker) ** 2
    many = max(repeats_in(s, residual, clips), 1 + mesh)
    noise = fitted.problem.noise
    return replace(noise, marker=marker, repeats=many, unequal=tuple(clipwise))


def with_what_is_missed_alike(noise: Noise, fitted: Fit, sensitivities: list[Sensitivity]) -> Noise:
    """Return the noise of markers of which a part is what the rope misses in another recording,
    too: that is no fresh error in every frame, and counts as often as what is left here does."""
    if not noise.sensor or noise.marker <= noise.sensor:
        return noise
    left = _left_by_the_best(fitted, sensitivities)
    s = fitted.stations
    residual = fitted.whitener.undo(left).reshape(s.residual.shape)
    share = 1 - (noise.sensor / noise.marker) ** 2
    many = repeats(s, residual, orders(s, fitted.point.seen))
    return replace(noise, repeats=1 + share * (many - 1))


def no_larger_than_left(noise: Noise, fitted: Fit, sensitivities: list[Sensitivity]) -> Noise:
    """Return the noise of markers, no larger than what the best single effect leaves: preprocess
    only bounds it from above where frames are few."""
    if not fitted.problem.data.material or noise.repeats > 1:
        return noise
    left = fitted.whitener.undo(_left_by_the_best(fitted, sensitivities))
    return replace(noise, marker=min(noise.marker, float(np.sqrt(left @ left / fitted.freedom))))


def _left_by_the_best(fitted: Fit, sensitivities: list[Sensitivity]) -> np.ndarray:
    """Return (M D,) the whitened residual beside the effect that explains most of it."""
    project = Projection(fitted)
    best, most = project.z, 0.0
    for one in sensitivities:
        kept = project(one.values)
        for place in range(kept.shape[1]):
            columns = kept[:, place]
            sizes = np.linalg.lstsq(columns, project.z, rcond=1e-6)[0]
            gain = float(project.z @ columns @ sizes)
            if gain > most:
                best, most = project.z - columns @ sizes, gain
    return best
