"""Where data and model differ beyond noise: regions in arc length and frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ropefit.inference.least_squares import Fit

SIGNIFICANT = 3.0  # sd of a mean over three stations in three frames
MOST = 6


@dataclass(frozen=True)
class Mismatch:
    """arc (2,) share of the length, frames (2,) indices, rms [m], direction (3,) unit."""

    arc: tuple[float, float]
    frames: tuple[int, int]
    rms: float
    direction: np.ndarray


def misfit(found: Fit, bins: int) -> np.ndarray:
    """(F, bins, 3) [m] mean offset of data from model, NaN where nothing was seen."""
    s = found.stations
    out = np.full((len(found.point.seen), bins, 3), np.nan)
    out[s.frame, s.bin] = np.einsum("md,mda->ma", s.residual, s.basis)
    return out


def regions(found: Fit, bins: int) -> list[Mismatch]:
    """The largest connected regions of significant misfit."""
    s = found.stations
    bins = max(bins, int(s.bin.max(initial=0)) + 1)
    offset = misfit(found, bins)
    z = np.zeros((len(offset), bins, s.residual.shape[1]))
    z[s.frame, s.bin] = found.z.reshape(s.residual.shape)
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
    strong = (np.abs(mean).max(-1) > SIGNIFICANT + 0.5) & (seen > 0)
    labels, many = ndimage.label(strong, kernel)  # type: ignore[misc]
    out = []
    for k in range(1, many + 1):
        inside = labels == k
        if inside.sum() < 3:
            continue
        frames, places = np.nonzero(inside)
        vectors = np.nan_to_num(offset[inside])
        direction = vectors.mean(0)
        size = np.linalg.norm(direction)
        out.append(
            Mismatch(
                (float(places.min() / bins), float((places.max() + 1) / bins)),
                (int(frames.min()), int(frames.max())),
                float(np.sqrt((vectors**2).sum(-1).mean())),
                direction / size if size > 0 else np.zeros(3),
            )
        )
    out.sort(key=lambda r: -r.rms * (r.arc[1] - r.arc[0]) * (r.frames[1] - r.frames[0] + 1))
    return out[:MOST]
