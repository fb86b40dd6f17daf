"""One RGB-D frame: the rope in the picture, back-projected onto its axis, arc length."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from ropefit.perception.camera import Camera
from ropefit.perception.cloud import LONGEST, SHORTEST, without_overshoot
from ropefit.perception.cues import lab_of
from ropefit.perception.follow import even, settle
from ropefit.perception.segment import Looked, Segmentation, segment_rope
from ropefit.perception.trace import FrameRejected, Trace, polyline_arc, resample

LEAST_DEPTHS = 20
RUNNING = 31  # px: width of the running median of depths
STRETCH = 12  # px along the path, to each side
AGREE = 0.006  # of the depth, and 4 mm: depths of one place on the rope differ by less
FAR_JUMP = 0.2  # of the picture's diagonal
WRONG_SCALE = 3.0  # a factor that neither slack nor a leaning rope explain
PLAUSIBLE = (0.05, 30.0)  # m
MEAN_HEIGHT = 0.95  # mean height of the middle of a rope over its axis, in radii
SPARSE = 2.0  # px between the places at which the path is centred
INNER = 0.35  # widths to each side of the path: depths further out may be the background's


def trace_rgbd(
    color: np.ndarray,
    depth: np.ndarray,
    camera: Camera,
    ends: np.ndarray,
    length: float | None,
    radius: float | None,
    looked: Looked | None = None,
) -> tuple[Trace, Segmentation]:
    """Trace a rope in colour (H, W, 3) and depth (H, W) [m], 0 = none.

    ends (2, 3) [m], NaN where unknown. Depths near the middle of the rope are moved back to its
    axis by the height that a round rope of `radius` [m] has there. Raises FrameRejected.
    """
    known = np.asarray(np.isfinite(ends).all(axis=1))
    tips = np.full((2, 2), np.nan)
    tips[known] = camera.project(ends[known])
    check_tips(tips, color.shape[:2])
    found = segment_rope(color, tips, depth, looked)
    check_near(found, tips)
    path, seen = centred(color, depth, found, camera, radius)
    at = depth_along(path, found, depth, camera, radius)
    good = (at > 0) & seen
    if good.sum() < LEAST_DEPTHS:
        raise FrameRejected(
            f"depth at {int(good.sum())} of {len(at)} skeleton pixels: wrong depth_scale, or the "
            "depth images do not show the rope"
        )
    good &= ~_flying(at, good)
    check_scale(path[good], np.maximum(at[good] - (radius or 0.0), 1e-6), camera, ends, length)
    pixels = path[good]
    # Depth is noisy from pixel to pixel and the rope is smooth: the picture says where it bends.
    smooth = _smooth_depth(at, good, max(found.width, 5.0))
    points = camera.unproject(pixels, at[good])
    line = camera.unproject(path, smooth)
    index = _untangle(line, np.arange(*np.flatnonzero(good)[[0, -1]] + [0, 1]))
    line = line[index]
    first = index.astype(float)
    if known[0]:
        line, first = np.vstack([ends[0], line]), np.r_[-1.0, first]
    if known[1]:
        line, first = np.vstack([line, ends[1]]), np.r_[first, len(path)]
    line, first = _within(line, first)
    arc = polyline_arc(line)
    if arc[-1] <= 0:
        raise FrameRejected("the points do not extend along a line")
    check_length(float(arc[-1]), length, bool(known.all()))
    scale = length / arc[-1] if length and known.all() else 1.0
    total = length if length and known.all() else float(arc[-1])
    # By place along the path, not by nearness: near a crossing another stretch may be nearer.
    path_arc = np.interp(np.arange(len(path)), first, arc) * scale
    point_arc = path_arc[good]
    trace = Trace(
        points=points,
        point_arc=point_arc,
        centreline=line,
        arc=arc * scale,
        length=total,
        reach=total / 60,
        pixels=path[seen],
        pixel_arc=path_arc[seen],
        quality=quality(found, seen),
        traced=float(arc[-1]),
    )
    return trace, found


def check_tips(tips: np.ndarray, shape: tuple[int, ...]) -> None:
    """Refuse known ends (2, 2) [px] that are not in a picture of that shape. FrameRejected."""
    size = np.array([shape[1], shape[0]], dtype=float)
    for end in np.flatnonzero(np.isfinite(tips).all(axis=1)):
        if (tips[end] < -0.1 * size).any() or (tips[end] > 1.1 * size).any():
            u, v = tips[end]
            raise FrameRejected(
                f"end {end} falls at ({u:.0f}, {v:.0f}) px, outside the picture: intrinsics of "
                "another resolution, a rotated picture, or wrong camera_pose or ends"
            )


def check_near(found: Segmentation, tips: np.ndarray) -> None:
    """Refuse a rope that is seen far from its known ends (2, 2) [px] only. FrameRejected."""
    on = found.path[found.seen]
    if len(on) == 0:
        raise FrameRejected("the rope is visible along too little of its expected path")
    most = FAR_JUMP * float(np.hypot(*found.mask.shape))
    for end in np.flatnonzero(np.isfinite(tips).all(axis=1)):
        gap = float(np.linalg.norm(on - tips[end], axis=1).min())
        if gap > most:
            raise FrameRejected(
                f"the rope is seen no nearer than {gap:.0f} px to end {end}: a rotated picture, "
                "intrinsics of another resolution, or wrong camera_pose or ends"
            )


def check_scale(
    path: np.ndarray, depth: np.ndarray, camera: Camera, ends: np.ndarray, length: float | None
) -> None:
    """Refuse depths (P,) [m] that contradict known ends or length by a factor (FrameRejected)."""
    usual = float(np.median(depth))
    known = np.isfinite(ends).all(axis=1)
    least = 1 / WRONG_SCALE
    if known.any():
        expected = float(np.mean(camera.local(ends[known])[:, 2]))
        why = f"its ends are {expected:.3g} m away"
    elif length:
        flat = float(polyline_arc(camera.unproject(path[::8], np.ones(len(path[::8]))))[-1])
        expected, why = length / max(flat, 1e-9), f"it is {length:g} m long"
        least /= WRONG_SCALE  # a rope that leans towards the camera looks shorter than it is
    else:
        expected, why = float(np.clip(usual, *PLAUSIBLE)), "that is no distance of a camera"
    if not least < usual / max(expected, 1e-9) < WRONG_SCALE:
        power = round(np.log10(max(usual, 1e-9) / max(expected, 1e-9)))
        raise FrameRejected(
            f"depth puts the rope {usual:.3g} m away, but {why}: depth_scale is wrong, about "
            f"{10.0 ** abs(power):g} times too {'large' if power > 0 else 'small'}"
        )


def check_length(traced: float, length: float | None, between_ends: bool) -> None:
    """Refuse a line [m] that is plainly longer than the rope, or shorter between its known ends.
    FrameRejected."""
    if length and not (SHORTEST if between_ends else 0.0) < traced / length < LONGEST:
        raise FrameRejected(
            f"the line that was followed is {traced:.4g} m long, the rope {length:.4g} m: a wrong "
            "turn at a crossing, something else taken for the rope, or [rope] length is wrong"
        )


def quality(found: Segmentation, seen: np.ndarray) -> float:
    """Return 0..1: how sure the choice of the rope is, times how much of it was seen."""
    return float(found.confidence * seen.mean())


def centred(
    color: np.ndarray,
    depth: np.ndarray,
    found: Segmentation,
    camera: Camera,
    radius: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (path (P, 2), seen (P,)) moved sideways to the middle between the rope's two edges,
    which are as far apart as its radius [m] says where that is known: a shaded side may be as dark
    as the ground, and missing from the mask."""
    if len(found.path) < 4:
        return found.path, found.seen
    low = np.floor(found.path.min(axis=0) - 4 * found.width - 4).astype(int).clip(0)
    high = np.ceil(found.path.max(axis=0) + 4 * found.width + 5).astype(int).clip(1)
    crop = np.ascontiguousarray(color[low[1] : high[1], low[0] : high[0]])
    around = np.ascontiguousarray(depth[low[1] : high[1], low[0] : high[0]])
    path = even(found.path - low, 1.0)
    old = polyline_arc(found.path)
    seen = np.interp(polyline_arc(path), old, found.seen.astype(float)) > 0.5
    width = max(found.width, 2.0)
    on = around[tuple(np.round(path).astype(int).clip(0, np.array(around.shape)[::-1] - 1).T[::-1])]
    if radius and (on > 0).any():
        # Within what the mask leaves open: a wrong depth_scale is reported later.
        expected = 2 * radius * camera.fx / float(np.median(on[on > 0]))
        width = float(np.clip(expected, max(0.5 * width, 2.0), 2.0 * width))
    some = even(path, SPARSE)
    shown = np.interp(polyline_arc(some), polyline_arc(path), seen.astype(float)) > 0.5
    reach = 0.35 * max(found.width, width)
    moved, _ = settle(lab_of(crop), some, width, reach, shown, around)
    shift = resample(moved - some, polyline_arc(some), polyline_arc(path))
    return path + np.where(seen[:, None], shift, 0.0) + low, seen


def depth_along(
    path: np.ndarray,
    found: Segmentation,
    depth: np.ndarray,
    camera: Camera,
    radius: float | None,
) -> np.ndarray:
    """Return (P,) [m] depth of the rope's axis at each path pixel; 0 where there is none.

    At the rope's edge a depth pixel belongs to the background or lies between (flying pixels),
    always behind the rope. So only depths near the middle count, the nearest of those along a
    stretch of path say where the rope is, and each place takes the median of those that agree.
    """
    inner = np.arange(-max(INNER * found.width, 0.5), max(INNER * found.width, 0.5) + 0.01, 0.5)
    tangent = np.gradient(gaussian_filter1d(path, 2.0, axis=0, mode="nearest"), axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    side = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    at = np.round(path[:, None] + inner[:, None] * side[:, None]).astype(int)
    height, width = depth.shape
    inside = ((at >= 0) & (at < [width, height])).all(axis=2)
    columns, rows = np.clip(at[..., 0], 0, width - 1), np.clip(at[..., 1], 0, height - 1)
    raw = np.where(inside & found.mask[rows, columns], depth[rows, columns], 0.0)
    if radius:
        # Pixel centres lie where they lie, not where the offset says.
        off = ((np.stack([columns, rows], axis=2) - path[:, None]) * side[:, None]).sum(axis=2)
        across = off * raw / camera.fx
        raw = np.where(raw > 0, raw + np.sqrt(np.maximum(radius**2 - across**2, 0.0)), 0.0)
    values = np.where(raw > 0, raw, np.inf)
    padded = np.pad(values, ((STRETCH, STRETCH), (0, 0)), constant_values=np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * STRETCH + 1, axis=0)
    front = _quantile(windows.reshape(len(path), -1), 0.3)
    some = np.isfinite(front)
    limit = np.maximum(AGREE * front[some], 0.004)
    agree = np.abs(values[some] - front[some, None]) < limit[:, None]
    out = np.zeros(len(path))
    middle = _quantile(np.where(agree, values[some], np.inf), 0.5)
    out[some] = np.where(np.isfinite(middle), middle, 0.0)
    there = out > 0
    if radius and there.sum() > LEAST_DEPTHS:
        # Along the viewing direction a rope that recedes is thicker than across it.
        smooth = _smooth_depth(out, there, max(2 * found.width, 8.0))
        slope = np.gradient(smooth) / np.maximum(smooth / camera.fx, 1e-9)
        out[there] += MEAN_HEIGHT * radius * (np.sqrt(1 + slope[there] ** 2) - 1)
    return out


def _quantile(values: np.ndarray, share: float) -> np.ndarray:
    """Return (P,) the quantile of the finite entries of each row of (P, N); infinite where none
    is."""
    ordered = np.sort(values, axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    place = share * np.maximum(count - 1, 0)
    low, rows = np.floor(place).astype(int), np.arange(len(values))
    high = np.minimum(low + 1, np.maximum(count - 1, 0))
    with np.errstate(invalid="ignore"):
        mixed = ordered[rows, low] + (place - low) * (ordered[rows, high] - ordered[rows, low])
    return np.where(count > 0, mixed, np.inf)


def _smooth_depth(at: np.ndarray, good: np.ndarray, sigma: float) -> np.ndarray:
    """Return (P,) depth smoothed along the path, straight over gaps, weighted by where there is
    any."""
    index = np.flatnonzero(good)
    filled = np.interp(np.arange(len(at)), index, median_filter(at[good], 5, mode="nearest"))
    once = gaussian_filter1d(filled, sigma, mode="nearest")
    # A Gaussian takes from a bend half its variance times the curvature; the second pass gives
    # that back.
    return once + gaussian_filter1d(filled - once, sigma, mode="nearest")


def _flying(depth: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return (P,) bool: depths far from the running median along the path (background seen at the
    edge)."""
    smooth = np.zeros_like(depth)
    smooth[good] = median_filter(depth[good], size=min(RUNNING, int(good.sum())), mode="nearest")
    gap = np.abs(depth - smooth)
    usual = 1.4826 * np.median(gap[good])
    return good & (gap > max(5 * usual, 0.005))


def _untangle(line: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return those of the indices (N,) of a line (P, 3) that advance: steps back along it (noise in
    depth) are ignored."""
    direction = np.gradient(gaussian_filter1d(line, 8, axis=0, mode="nearest"), axis=0)
    keep = [int(index[0])]
    for i in index[1:].tolist():
        if (line[i] - line[keep[-1]]) @ direction[i] > 0:
            keep.append(i)
    return np.array(keep)


def _within(line: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the line (M, 3) and its places (M,) without vertices that overshoot its ends."""
    kept = without_overshoot(np.column_stack([line, place]), 3)
    return kept[:, :3], kept[:, 3]
