"""What a model misses beyond noise: it is no fresh error in every sample.

A shape that is missed is missed alike in neighbouring frames and along the rope. Such a residual is
worth as many samples as there are independent ones (effective sample size, Geyer 1992, in time;
participation ratio of the covariance along the rope), and so are evidence and intervals.

Of the same rope at rest under other loads, or in another recording, it is missed by as much, and by
a law: no number of frames averages that out. A part of it may look like just what is estimated.
"""

from __future__ import annotations

import numpy as np

from ropefit.inference.bins import Stations

MOST_POSES = 500  # more are a motion
TYPICAL = 4.0  # independent samples that a clip's typical variance counts for
ALIGNED = 0.65  # of what is missed, one sigma: the part that looks like what is estimated
LEAST_CORRELATION = 0.05  # of the residual with itself: later lags count as independent


def inflation(
    s: Stations, z: np.ndarray, scale: float, seen: np.ndarray, known: bool
) -> tuple[float, float]:
    """Return by how much the variance of estimates exceeds that by the noise alone, and the share
    of the samples by which that variance is known (Satterthwaite 1946).

    seen (F, K, 3): the rope; z (M D,): whitened residual of sd `scale`: 1 from noise,
    and what is beyond from what the model misses, of which several samples count as one. Below 1
    noise was taken as too large, unless it is known from elsewhere.
    """
    beyond = scale**2 - 1
    if beyond <= 0:
        return (1.0 if known else max(scale**2, 1e-12)), 1.0
    many = repeats(s, z.reshape(s.residual.shape), orders(s, seen))
    missed = beyond * many  # known as well as so many fewer samples tell
    return 1 + missed, min((1 + missed) ** 2 / (1 + missed**2 * many), 1.0)


def inflation_of_repeated(z: np.ndarray, repeats: float, free: int) -> float:
    """Return by how much the variance of estimates exceeds that by a noise of which `repeats`
    samples count as one, from whitened residuals z (M D,) of a fit of `free` values; at least 1,
    as that noise is known from elsewhere."""
    return max(float(z @ z) / max(len(z) / repeats - free, 1.0), 1.0)


def misled(s: Stations, lever: np.ndarray, least: float, sensor: float = 0.0) -> np.ndarray:
    """Return (P,) one sigma of the errors of estimates by what their model misses of markers at
    rest (model inadequacy: Kennedy & O'Hagan 2001).

    lever (P, M, D) [1/m]: how far an error of each sample moves each estimate; least [m]: rms of
    what is missed, at least; sensor [m]: noise of a marker by itself, which is in it and averages
    out, if that is known. The part of the misfit that an estimate takes for its own is not seen in
    the residual; `ALIGNED` is from 26 pairs of recordings of simulated cables with friction, sharp
    bends and unknown weights (seeds 1 to 22 and 101 to 108).
    """
    size = np.zeros_like(s.residual)
    for place in np.unique(s.bin):
        mine = s.bin == place
        size[mine] = np.sqrt((s.residual[mine] ** 2).mean(axis=0))
    size *= max(1.0, least / max(float(np.sqrt((s.residual**2).mean())), 1e-12))
    missed = np.sqrt(np.maximum(size**2 - sensor**2, 0.0))
    return ALIGNED * np.einsum("pmd,md->p", np.abs(lever), missed)


def orders(s: Stations, seen: np.ndarray) -> list[np.ndarray]:
    """Return orders of the frames with stations: in time, and from each pose to the nearest that is
    left, as poses at rest may be recorded in any order."""
    rows = np.unique(s.frame)
    shapes = np.nan_to_num(seen[rows]).reshape(len(rows), -1)
    if len(rows) >= MOST_POSES:
        return [rows]
    apart = np.array([np.linalg.norm(shapes - one, axis=-1) for one in shapes])
    at = int(np.unravel_index(apart.argmax(), apart.shape)[0])  # from one of the outermost
    chain, left = [at], set(range(len(rows))) - {at}
    while left:
        chain.append(min(left, key=lambda t: apart[chain[-1], t]))
        left.remove(chain[-1])
    return [rows, rows[chain]]


def repeats(s: Stations, residual: np.ndarray, series: list[np.ndarray]) -> float:
    """Return of how many samples (M, D) one is independent, along the rope and in the most alike
    of some series of frames."""
    return max(repeats_in(s, residual, [one]) for one in series)


def repeats_in(s: Stations, residual: np.ndarray, clips: list[np.ndarray]) -> float:
    """Return the same over clips, each a series of frames."""
    rows = np.unique(s.frame)
    table = np.zeros((len(rows), int(s.bin.max()) + 1, residual.shape[1]))
    table[np.searchsorted(rows, s.frame), s.bin] = residual
    table = table.reshape(len(rows), -1)
    covariance, columns = table.T @ table, np.count_nonzero(table.any(0))
    alike = (covariance**2).sum() / np.trace(covariance) ** 2 * columns
    alike -= columns / len(rows)  # so much of it is chance
    parts = [table[np.searchsorted(rows, clip[np.isin(clip, rows)])] for clip in clips]
    whole, lag, correlation = float((table**2).mean()), 1, 0.0
    while True:
        pairs = [(part[:-lag] * part[lag:]).ravel() for part in parts if len(part) > lag]
        shared = float(np.concatenate(pairs).mean()) / whole if pairs else 0.0
        if shared < LEAST_CORRELATION:
            return float(max(1 + 2 * correlation, 1.0) * max(alike, 1.0))
        correlation, lag = correlation + shared, lag + 1


def unequal(s: Stations, residual: np.ndarray, clips: list[np.ndarray], frames: int) -> np.ndarray:
    """Return (F,) the variance of each frame's residual, that of its clip over the typical clip's.

    A motion that goes the wrong way in one clip misses it by far more than the others, and would
    count for most of them together. A clip's variance is shrunk towards the typical one, as its
    samples (M, D) are not independent.
    """
    own = [(residual[np.isin(s.frame, clip)] ** 2).sum(1) for clip in clips]
    shown = [k for k, part in enumerate(own) if len(part)]
    mean = {k: float(own[k].mean()) for k in shown}
    typical = float(np.median(list(mean.values())))
    out = np.ones(frames)
    for k in shown:
        out[clips[k]] = mean[k] / typical
    many = repeats_in(s, residual / np.sqrt(out[s.frame])[:, None], clips)
    for k in shown:
        count = residual.shape[1] * len(own[k]) / many
        out[clips[k]] = (TYPICAL + count * mean[k] / typical) / (TYPICAL + count)
    return out
