"""Where data and model differ beyond noise: regions in arc length and frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ropefit.inference.bins import Stations
from ropefit.inference.least_squares import Fit

SIGNIFICANT_SD = 3.5  # of a mean over three stations in three frames
FEWEST_STATIONS = 3  # of a region
MOST_REGIONS = 6


@dataclass(frozen=True)
class Mismatch:
    """arc (2,) share of the length, frames (2,) indices, rms [m], direction (3,) unit."""

    arc: tuple[float, float]
    frames: tuple[int, int]
    rms: float
    direction: np.ndarray


def misfit(fitted: Fit, bins: int) -> np.ndarray:
    """Return (F, bins, 3) [m] the mean offset of data from model, NaN where nothing was seen."""
    s = fitted.stations
    place = np.clip((s.share * bins).astype(int), 0, bins - 1) if _markers(s) else s.bin
    total = np.zeros((len(fitted.point.seen), bins, 3))
    count = np.zeros((*total.shape[:2], 1))
    np.add.at(total, (s.frame, place), s.offset)
    np.add.at(count, (s.frame, place), 1.0)
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)


def regions(fitted: Fit, bins: int) -> list[Mismatch]:
    """Return the largest connected regions of significant misfit."""
    s = fitted.stations
    place, edges = _places(s, bins)
    bins = len(edges) - 1
    rows, row = np.unique(s.frame, return_inverse=True)  # of a motion, not every frame counts
    offset = np.full((len(rows), bins, 3), np.nan)
    offset[row, place] = s.offset
    z = np.zeros((len(offset), bins, s.residual.shape[1]))
    z[row, place] = fitted.z.reshape(s.residual.shape)
    seen = np.isfinite(offset[..., 0]).astype(float)
    kernel = np.ones((3, 3))
    count = ndimage.convolve(seen, kernel, mode="constant")
    mean = (
        np.stack(
            [ndimage.convolve(z[..., d], kernel, mode="constant") for d in range(z.shape[2])],
            axis=-1,
        )
        / np.sqrt(np.maximum(count, 1))[..., None]
    )
    strong = (np.abs(mean).max(-1) > SIGNIFICANT_SD) & (seen > 0)
    labels, many = ndimage.label(strong, kernel)  # type: ignore[misc]
    out = []
    for k in range(1, many + 1):
        inside = labels == k
        if inside.sum() < FEWEST_STATIONS:
            continue
        frames, places = np.nonzero(inside)
        vectors = np.nan_to_num(offset[inside])
        direction = vectors.mean(0)
        size = np.linalg.norm(direction)
        out.append(
            Mismatch(
                (float(edges[places.min()]), float(edges[places.max() + 1])),
                (int(rows[frames.min()]), int(rows[frames.max()])),
                float(np.sqrt((vectors**2).sum(-1).mean())),
                direction / size if size > 0 else np.zeros(3),
            )
        )
    out.sort(key=lambda r: -r.rms * (r.arc[1] - r.arc[0]) * (r.frames[1] - r.frames[0] + 1))
    return out[:MOST_REGIONS]


def _markers(s: Stations) -> bool:
    return s.residual.shape[1] == 3


def _places(s: Stations, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the stretch of every station (M,), and the stretches' edges (B + 1,) as shares of the
    length: one stretch for each marker, halfway to the next."""
    if not _markers(s):
        return s.bin, np.linspace(0, 1, bins + 1)
    names, column = np.unique(s.bin, return_inverse=True)
    share = np.array([np.median(s.share[column == k]) for k in range(len(names))])
    order = np.argsort(share)
    share = share[order]
    return np.argsort(order)[column], np.concatenate([[0], 0.5 * (share[1:] + share[:-1]), [1]])
