"""The noise of a recording from its own data, mismatch set aside: DIAGNOSIS, section 1.

What is left after the most flexible credible fit (nominal, calibration, and every steady effect at
every place, all at once) is noise; its correlation along the rope is measured there, never on the
nominal residual, which would swallow the mismatch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.inference.diagnosis.columns import Columns
from ropefit.inference.least_squares import Fit, Noise
from ropefit.inference.noise import estimate
from ropefit.inference.stations import Stations

RIDGE = 30.0  # usual sizes: effects may be as large as that


def measure(found: Fit, columns: list[Columns], noise: Noise) -> Noise:
    """White and correlated noise of the stations of a nominal fit."""
    physics = [c.values for c in columns if c.family.effect.kind == "physics"]
    steady = [values.reshape(len(values), -1) for values in physics]
    design = np.concatenate([found.jacobian, *steady], axis=1)
    held = np.isfinite(found.prior)
    loose = np.full(design.shape[1], 1 / RIDGE**2)
    loose[: len(held)] = np.where(held, 1 / found.prior**2, 0.0)
    information = design.T @ design + np.diag(loose)
    gain = design.T @ found.z
    left = found.z - design @ np.linalg.solve(information, gain)
    taken = float(np.trace(np.linalg.solve(information, design.T @ design)))
    grow = np.sqrt(len(left) / max(len(left) - taken, len(left) / 4))
    residual = found.whitener.undo(left * grow).reshape(found.stations.residual.shape)
    usual = _usual_frames(replace(found.stations, residual=residual))
    return estimate(usual, noise.marker, noise.white)


def _usual_frames(s: Stations) -> Stations:
    """Without the quarter of the frames that are left worst: there something else may act."""
    frames = np.unique(s.frame)
    size = np.array([(s.residual[s.frame == t] ** 2).mean() for t in frames])
    kept = frames[size <= np.quantile(size, 0.75)]
    mine = np.isin(s.frame, kept)
    return Stations(*(getattr(s, name)[mine] for name in Stations.__dataclass_fields__))
