"""What it costs to link one end of a strand to another: length, and the energy of the bend."""

from __future__ import annotations

import numpy as np

STIFF = 5.0  # widths: a bend of this radius costs as much as its length
FARTHEST = 0.3  # of the extent of all strands: a wider gap is not bridged
CLOSE = 4.0  # widths: nearer ends meet at a crossing; only their directions say which go together
AT_ONCE = 3.0  # widths that every link counts as long at least
LOOK = 2.0  # widths over which the direction of a strand's end is taken
FOCAL = 0.6  # of the picture's longer side: rough, for comparing depth with distance across


def tips_of(pieces: list[np.ndarray], width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (2N, 2) ends of the pieces and (2N, 2) outward unit directions there, zero for
    points."""
    tips, ways = np.zeros((2 * len(pieces), 2)), np.zeros((2 * len(pieces), 2))
    reach = max(int(LOOK * width), 4)
    for i, piece in enumerate(pieces):
        tips[2 * i], tips[2 * i + 1] = piece[0], piece[-1]
        if len(piece) < 3:
            continue
        # Skeletons bend towards corners at the very tip: the direction is from a little inside.
        inner = min(reach, len(piece) - 1)
        skip = min(int(width / 2), inner // 3)
        ways[2 * i] = piece[skip] - piece[inner]
        ways[2 * i + 1] = piece[-1 - skip] - piece[-1 - inner]
    size = np.linalg.norm(ways, axis=1, keepdims=True)
    return tips, ways / np.maximum(size, 1e-9)


def distances(pieces: list[np.ndarray], width: float, depth: np.ndarray) -> np.ndarray:
    """Return (2N,) distances from the camera, in pixels as wide as they are there, of the ends of
    pieces; NaN where there is no depth."""
    out = np.full(2 * len(pieces), np.nan)
    reach = max(int(LOOK * width), 4)
    limit = np.array(depth.shape[::-1]) - 1
    for i, piece in enumerate(pieces):
        if len(piece) < 2:
            continue
        for side, part in enumerate((piece[:reach], piece[-reach:])):
            column, row = np.clip(np.round(part).astype(int), 0, limit).T
            z = depth[row, column]
            if (z > 0).any():
                out[2 * i + side] = np.median(z[z > 0])
    usual = np.nanmedian(out) if np.isfinite(out).any() else 1.0
    return out / usual * FOCAL * max(depth.shape)


def costs(
    pieces: list[np.ndarray],
    tips: np.ndarray,
    ways: np.ndarray,
    away: np.ndarray,
    count: int,
    width: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (cost (2N, 2N) [px] of a link from end to end, infinite where there can be none, turn
    (2N, 2N) [rad] of the first of them). away (2N,): see distances.

    A link costs its length and the energy of the elastic curve that makes its turns.
    """
    extent = float(np.linalg.norm(np.ptp(np.concatenate(pieces), axis=0)))
    gap = tips[None] - tips[:, None]
    distance = np.linalg.norm(gap, axis=2)
    # Turn from the direction of an end to the way to the other, left or right.
    side = ways[:, None, 0] * gap[..., 1] - ways[:, None, 1] * gap[..., 0]
    leave = np.arctan2(side, np.einsum("ad,abd->ab", ways, gap))
    arrive = -leave.T
    # Ends that touch have no way between them that means anything: compare their directions.
    close = distance < CLOSE * width
    bend = np.arccos(np.clip(-(ways @ ways.T), -1, 1)) / 2
    leave, arrive = np.where(close, bend, leave), np.where(close, bend, arrive)
    point = (ways == 0).all(axis=1)  # an end of the rope turns freely
    either = point[:, None] | point[None]
    free = np.where(point[:, None], arrive / 2, leave), np.where(point[None], leave / 2, arrive)
    leave = np.where(either, np.where(close, 0.0, free[0]), leave)
    arrive = np.where(either, np.where(close, 0.0, free[1]), arrive)
    deep = np.nan_to_num(away[None] - away[:, None])
    length = np.hypot(distance, deep) + AT_ONCE * width
    energy = 4 * (leave**2 - leave * arrive + arrive**2) / length
    cost = length + (STIFF * width) ** 2 * energy
    owner = np.arange(len(tips)) // 2
    known = owner >= count
    bad = owner[:, None] == owner[None]
    bad |= (distance > FARTHEST * extent) & ~(known[:, None] | known[None])
    bad |= known[:, None] & known[None]
    second = known & (np.arange(len(tips)) % 2 == 1)  # a point has one end to link
    bad |= second[:, None] | second[None]
    return np.where(bad, np.inf, cost), np.abs(leave)
