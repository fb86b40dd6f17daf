"""How much of a residual is correlated along the rope, by maximum likelihood over frames."""

from __future__ import annotations

import numpy as np

from ropefit.inference.least_squares import FLOOR, Noise
from ropefit.inference.stations import Stations

LENGTHS = (0.03, 0.06, 0.12, 0.25)  # of the rope
RATIOS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0)  # correlated to white sd


def estimate(s: Stations, marker: float = 0.0, white: tuple[float, ...] | None = None) -> Noise:
    """The noise model under which the stations' residuals (M, D) are most likely.

    marker [m]: white sd of a marker; white is handed on. Whatever the model misses counts as noise
    here: intervals become wider, never narrower.
    """
    own = s.scatter / s.count[:, None] + FLOOR**2 + marker**2
    typical = float(np.sqrt(np.median(own)))
    starts = np.flatnonzero(np.diff(s.frame, prepend=-1))
    frames = np.split(np.arange(len(s.frame)), starts[1:])
    best, chosen = np.inf, Noise(marker=marker, white=white)
    for length in LENGTHS:
        for ratio in RATIOS:
            sd = ratio * typical
            total = 0.0
            for part in frames:
                apart = np.abs(s.share[part, None] - s.share[None, part])
                common = sd**2 * np.exp(-apart / length)
                for d in range(s.residual.shape[1]):
                    factor = np.linalg.cholesky(common + np.diag(own[part, d]))
                    z = np.linalg.solve(factor, s.residual[part, d])
                    total += 0.5 * float(z @ z) + float(np.log(np.diag(factor)).sum())
            # A correlated part must earn its place.
            total += 2.0 if ratio else 0.0
            if total < best:
                best, chosen = total, Noise(sd, length, marker, white)
    return chosen
