"""The models of a run beside its recording, in the frames in which they were compared.

With a diagnosis: the nominal model and, where a cause was found, the model with the cause. Without:
the fitted model alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.artifacts import Observations
from ropefit.reporting.camera import upwards
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import evenly

MOST_FRAMES = 60  # of the picture, and of a run without a diagnosis, which compares all of them
ABOVE = 0.7  # cosine from which a direction is called upwards


@dataclass(frozen=True)
class Compared:
    """at (N,): indices of the observed frames; nominal, with_cause (N, K, 3) [m] at the nodes' arc
    lengths; station (S,) [m]; before, after (N, S): how far the recording lies from the models, in
    multiples of the noise, signed by `towards` (3,)."""

    at: np.ndarray
    nominal: np.ndarray
    with_cause: np.ndarray | None
    station: np.ndarray
    before: np.ndarray
    after: np.ndarray | None
    towards: np.ndarray
    up: np.ndarray

    @property
    def worst(self) -> int:
        """Return the frame in which the nominal model is farthest off."""
        total = np.nansum(self.before**2, axis=1) / np.maximum(np.isfinite(self.before).sum(1), 1)
        return int(np.argmax(total))

    @property
    def shown(self) -> np.ndarray:
        """Return which of the frames the picture shows."""
        return np.union1d(evenly(len(self.at), MOST_FRAMES), [self.worst])

    @property
    def sides(self) -> tuple[str, str]:
        """Return where the recorded rope lies in positive and negative cells, in words."""
        if self.towards @ self.up > ABOVE:
            return "above the simulated one", "below it"
        axis = "xyz"[int(np.argmax(np.abs(self.towards)))]
        sign = "+−" if self.towards.max() == np.abs(self.towards).max() else "−+"
        return f"to the {sign[0]}{axis} side of the simulated one", f"to its {sign[1]}{axis} side"


def noise_of(run: RunContents) -> float:
    """Return the one noise of a point [m] that the page tells."""
    if run.diagnosis is not None:
        return run.diagnosis.noise_white
    return run.observations.noise_distance


def compared(run: RunContents) -> Compared | None:
    """Return the models in the frames that the page shows; None where nothing was fitted."""
    o, f, d = run.observations, run.fitted, run.diagnosis
    if f is None:
        return None
    noise = max(noise_of(run), 1e-9)
    if d is not None:
        at = np.flatnonzero(np.isin(o.frames, d.frames))
        nominal, station, before = d.x_before, d.station_arc, d.misfit_before
        with_cause, after = (d.x_after, d.misfit_after) if d.causes else (None, None)
    else:
        at = evenly(len(o.frames), MOST_FRAMES)
        nominal, station, before = f.x[at], o.node_arc, f.residual[at]
        with_cause, after = None, None
    gaps = [o.centreline[at] - x for x in (nominal, with_cause) if x is not None]
    towards = _main_direction(gaps[0], upwards(o))
    maps = [
        _signed(size / noise, gap @ towards, o, station)
        for size, gap in zip((before, after), gaps, strict=False)
        if size is not None
    ]
    return Compared(
        at, nominal, with_cause, station, maps[0], maps[1] if after is not None else None,
        towards, upwards(o),
    )  # fmt: skip


def _main_direction(gap: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return (3,) the direction in which gaps (N, K, 3) are largest, upwards rather than
    downwards."""
    flat = gap.reshape(-1, 3)
    flat = flat[np.isfinite(flat).all(axis=1)]
    if not flat.any():
        return up
    main = np.linalg.svd(flat, full_matrices=False)[2][0]
    return main if main @ up >= 0 else -main


def _signed(size: np.ndarray, side: np.ndarray, o: Observations, station: np.ndarray) -> np.ndarray:
    """Return sizes (N, S) with the sign of side (N, K), which lies at the nodes."""
    sign = np.ones_like(size)
    for t, row in enumerate(side):
        seen = np.isfinite(row)
        if seen.any():
            sign[t] = np.where(np.interp(station, o.node_arc[seen], row[seen]) < 0, -1, 1)
    return size * sign
