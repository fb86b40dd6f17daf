"""A path corrected by the picture: over gaps, beyond its ends, and to a fraction of a pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter1d, median_filter, uniform_filter1d

from ropefit.perception.trace import polyline_arc, resample
from ropefit.perception.unrolled import Strip, edges, normals, pairs, unroll

REACH = 3.0  # widths to each side of the path in which the rope is looked for
STIFF = 6.0  # cost of moving sideways by one width per width of path
EVIDENT = 3.0  # times the usual evidence beside the path: there the rope shows
CHANGE = 12.0  # of colour in Lab: the rope between its edges has become another thing
BLEMISH = 4.0  # widths that may be unclear on the way
SHARPEST = 0.15  # rad per width of path by which a path carried on may turn
NEAR, FAINT = 6.0, 1.5  # widths of path over which evidence must exceed the usual, how many times
UNCLEAR = 30.0  # widths that may show no edges, where the colour stays the rope's
GROWTH = 8.0  # widths by which a path is carried on at a time


def even(path: np.ndarray, spacing: float) -> np.ndarray:
    """Return (N, D) points of a path (P, D) at even distances of about `spacing`."""
    arc = polyline_arc(path)
    keep = np.concatenate([[True], np.diff(arc) > 1e-9])
    count = max(round(arc[-1] / spacing) + 1, 2)
    return resample(path[keep], arc[keep], np.linspace(0, arc[-1], count))


def measured_width(lab: np.ndarray, path: np.ndarray, guess: float) -> float:
    """Return width [px] of the rope along a path (S, 2): that at which most stations show two
    edges."""
    strip = edges(lab, path, guess, 1.5 * guess)
    usual = np.median(strip.evidence, axis=1, keepdims=True) + 1e-3
    relative = Strip(np.log1p(strip.evidence / usual), strip.offsets, strip.step)
    widths = guess * np.arange(0.6, 2.01, 0.1)
    worth = [pairs(relative, w, 0.25 * guess).evidence.max(axis=1).mean() for w in widths]
    return float(widths[int(np.argmax(worth))])


def settle(
    lab: np.ndarray,
    path: np.ndarray,
    width: float,
    reach: float,
    held: np.ndarray | None = None,
    depth: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (path (S, 2), shown (S,)) moved sideways by at most `reach` [px] to where the rope
    shows.

    held (S,): stations that may hardly move (there the mask shows the rope). shown: how many times
    the evidence on the path exceeds the usual one beside it.
    """
    strip = unroll(lab, path, width, reach, depth=depth)
    usual = np.median(strip.evidence) + 1e-3
    local = np.median(strip.evidence, axis=1, keepdims=True)
    gain = np.log1p(strip.evidence / np.maximum(local, usual))
    if held is not None:
        far = np.abs(strip.offsets)[None] > 0.35 * width
        gain = np.where(held[:, None] & far, -5.0, gain)
    spacing = float(np.linalg.norm(np.diff(path, axis=0), axis=1).mean())
    choice = _smoothest(gain * spacing / width, strip.step, spacing, width)
    shift = strip.offsets[choice] + strip.step * _between(gain, choice)
    shift = gaussian_filter1d(shift, width / spacing, mode="nearest")
    side = normals(path, max(width / spacing, 1.0))
    rows = np.arange(len(path))
    shown = strip.evidence[rows, choice] / np.maximum(local[:, 0], usual)
    return path + shift[:, None] * side, shown


def _between(gain: np.ndarray, choice: np.ndarray) -> np.ndarray:
    """Return (S,) steps, half a one at most, from chosen offsets to the top of the parabola through
    the gain (S, O) there and to both sides."""
    inner = np.clip(choice, 1, gain.shape[1] - 2)
    low, middle, high = (gain[np.arange(len(gain)), inner + k] for k in (-1, 0, 1))
    bend = low - 2 * middle + high
    steps = 0.5 * (low - high) / np.where(bend < -1e-6, bend, np.inf)
    return np.where(inner == choice, np.clip(steps, -0.5, 0.5), 0.0)


def _smoothest(gain: np.ndarray, step: float, spacing: float, width: float) -> np.ndarray:
    """Return (S,) index of the offset at each station: most gain, least sideways movement
    (Viterbi)."""
    stations, count = gain.shape
    most = max(int(np.ceil(0.5 * spacing / step)), 1)
    moves = np.arange(-most, most + 1)
    price = STIFF * (moves * step / spacing) ** 2 * spacing / width
    padded = np.full(count + 2 * most, -1e9)
    best = padded[most : most + count]
    best[:] = gain[0]
    shifted = sliding_window_view(padded, count)  # row m: best, moved by moves[m]
    options = np.empty(shifted.shape)
    choice = np.empty((stations, count), dtype=np.intp)
    for s in range(1, stations):
        np.subtract(shifted, price[:, None], out=options)
        options.argmax(axis=0, out=choice[s])
        np.add(options.max(axis=0), gain[s], out=best)
    out = np.empty(stations, dtype=np.int64)
    out[-1] = int(best.argmax())
    for s in range(stations - 1, 0, -1):
        out[s - 1] = np.clip(out[s] + moves[choice[s, out[s]]], 0, count - 1)
    return out


def visible(lab: np.ndarray, path: np.ndarray, shown: np.ndarray, width: float) -> np.ndarray:
    """Return (S,) whether the rope is seen at the stations of a path (S, 2), a pixel apart.

    Over some widths its evidence must be more than chance's. It may be faint for longer where what
    is between its edges keeps the rope's colour; what hides a rope has another.
    """
    near = 2 * int(NEAR * width / 2) + 1
    seen = median_filter(shown, near, mode="nearest") > FAINT
    if not seen.any():
        return seen
    inner = _inside(lab, path, width)
    palette = inner[seen][:: max(int(width), 1)]
    away = np.linalg.norm(inner[:, None] - palette[None], axis=2).min(axis=1)
    alike = median_filter(away, near, mode="nearest") <= CHANGE
    change = np.flatnonzero(np.diff(np.concatenate([[1], seen.astype(int), [1]])))
    for first, last in change.reshape(-1, 2):
        if last - first < UNCLEAR * width and alike[first:last].all():
            seen[first:last] = True
    return seen


def grow(lab: np.ndarray, path: np.ndarray, width: float, spacing: float) -> np.ndarray:
    """Return the path (S, 2), evenly spaced, carried on beyond its last point as long as the rope
    shows.

    It goes on with the curvature it has, is corrected sideways, and stops where two edges a width
    apart are no longer there or the colour between them changes: at a clamp, a gripper, a tip.
    """
    chunk = max(round(GROWTH * width / spacing), 4)
    short = max(round(width / spacing), 1)
    palette = _inside(lab, path, width)[::short]
    before = len(path)
    for _ in range(200):
        back = path[-3 * chunk :]
        held = np.arange(len(back) + chunk) < len(back)
        best, kept, longer = 0.0, 0, back
        for ahead in _onward(back, chunk, spacing, width):
            tried, shown = settle(lab, np.concatenate([back, ahead]), width, 1.5 * width, held)
            new = slice(len(back), None)
            count, worth = _usable(lab, tried[new], shown[new], palette, width, short)
            if worth > best:
                best, kept, longer = worth, count, tried
        path = np.concatenate([path, longer[len(back) :][:kept]])
        if kept < chunk - BLEMISH * short:
            break
    return _cut(lab, path, before, width, short)


def _cut(lab: np.ndarray, path: np.ndarray, before: int, width: float, short: int) -> np.ndarray:
    """Return the path less what was added (after `before` stations) once its edges had faded:
    evidence gathered along a path is half as strong where the rope ends."""
    evidence = unroll(lab, path, width, 0.3 * width, along=2.0).evidence.max(axis=1)
    level = np.percentile(evidence[: max(before - short, 1)], 25)
    faded = evidence < 0.5 * level
    # Faded for good, not for a moment.
    lasting = uniform_filter1d(faded.astype(float), 2 * short + 1, mode="nearest") > 0.9
    lasting[: max(before - 2 * short, 0)] = False
    if not lasting.any():
        return path
    first = int(np.argmax(lasting)) - short
    return path[: max(first, before - 2 * short)]


def _usable(
    lab: np.ndarray,
    ahead: np.ndarray,
    shown: np.ndarray,
    palette: np.ndarray,
    width: float,
    short: int,
) -> tuple[int, float]:
    """Return how many stations of a way ahead (S, 2) are rope, and the evidence that they hold.

    The rope may be unclear for some widths, but where its colour goes it has ended.
    """
    inner = _inside(lab, ahead, width)
    away = np.linalg.norm(inner[:, None] - palette[None], axis=2).min(axis=1)
    good = (shown > EVIDENT) & (away <= CHANGE)
    height, breadth = lab.shape[:2]
    good &= (ahead >= 0).all(axis=1) & (ahead <= [breadth - 1, height - 1]).all(axis=1)
    other = uniform_filter1d((away > CHANGE).astype(float), 2 * short + 1, mode="nearest") > 0.5
    turned = int(np.argmax(other)) if other.any() else len(ahead)
    good[turned:] = False
    blemish = int(BLEMISH * short)
    kept = _first_run(good, blemish)
    if turned < len(ahead) and turned - kept <= blemish:
        kept = turned  # evidence is blurred along the path, its colour is not
    return kept, float(np.minimum(shown[:kept], 10.0).sum())


def _onward(path: np.ndarray, count: int, spacing: float, width: float) -> list[np.ndarray]:
    """Return ways (count, 2) to carry a path (S, 2) on: with the curvature it has, more and
    less."""
    part = path[-count:]
    trim = len(part) // 6
    smooth = gaussian_filter1d(part, max(len(part) / 6, 0.5), axis=0, mode="nearest")
    step = np.diff(smooth[trim : len(part) - trim] if trim > 2 else smooth, axis=0)
    angle = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    at = np.arange(len(angle), dtype=float)
    rate, start = np.polyfit(at, angle, 1) if len(angle) > 3 else (0.0, float(angle.mean()))
    last = start + rate * (at[-1] + trim)
    ways = []
    for bend in np.linspace(-1, 1, 7) * SHARPEST * spacing / width:
        turn = last + (0.5 * rate + bend) * np.arange(1, count + 1)
        heading = np.column_stack([np.cos(turn), np.sin(turn)])
        ways.append(path[-1] + spacing * np.cumsum(heading, axis=0))
    return ways


def _inside(lab: np.ndarray, path: np.ndarray, width: float) -> np.ndarray:
    """Return (S, 3) colour of the middle of the rope."""
    side = normals(path, 3.0)
    at = (path[:, None] + np.linspace(-0.25, 0.25, 5)[:, None] * width * side[:, None]).astype(
        np.float32
    )
    flat = cv2.remap(lab, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return flat.reshape(len(path), 5, -1).mean(axis=1)


def _first_run(good: np.ndarray, blemish: int) -> int:
    """Return how many of the first stations are good, short interruptions not counted."""
    last = 0
    for i in np.flatnonzero(good):
        if i - last > blemish:
            break
        last = i + 1
    return int(last)
