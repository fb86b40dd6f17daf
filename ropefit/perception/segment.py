"""Which pixels are rope: several cues, each followed as a rope, the most rope-like one chosen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from ropefit.perception.cues import (
    colour_masks,
    depth_mask,
    lab_of,
    near_colour,
    nearness,
    unlike_masks,
)
from ropefit.perception.follow import even, grow, measured_width, settle, visible
from ropefit.perception.looks import Looks
from ropefit.perception.mask_candidate import COMPARABLE, Candidate, candidate_of
from ropefit.perception.strands import THICK
from ropefit.perception.trace import FrameRejected, polyline_arc

FINALISTS = 3
SMALLEST = 16  # px
LARGE_PICTURE = 1600  # px: larger pictures are worked on at a fraction of their size
FAMILIAR_CUE = "as in other pictures"
FAMILIAR = 0.4  # of the score of the picture the looks are from: less, and all cues are tried
SHOWS = 0.7  # of the path in the mask: less, and the picture is asked about the rest
SEE = "; --debug-images DIR shows every step"
SURE, DOUBTFUL = 0.25, 0.02  # scores above which a choice is sure, below which there is none


@dataclass(frozen=True)
class Segmentation:
    """What was taken for the rope in one picture.

    mask (H, W) bool; path (P, 2) ordered pixels (u, v); seen (P,): False where the path bridges
    what does not show; width [px]; score 0..1; cue: what distinguished rope and surroundings;
    runners_up: (cue, score) of the other candidates; pieces: strands the path was made from;
    several: whether something else is about as much like a rope, and no two known ends decide.
    """

    mask: np.ndarray
    path: np.ndarray
    seen: np.ndarray
    width: float
    score: float
    cue: str
    pieces: int = 1
    runners_up: list[tuple[str, float]] = field(default_factory=list)
    several: bool = False

    @property
    def confidence(self) -> float:
        """Return 0..1: the score, less where another candidate was nearly as good."""
        second = max((score for _, score in self.runners_up), default=0.0)
        return float(self.score / (self.score + SURE) * (self.score / (self.score + second + 1e-9)))


@dataclass(frozen=True)
class Looked:
    """What is known of the rope in the picture beforehand.

    From a person: its colour (r, g, b); roi (u, v, width, height) [px], the part of the picture it
    is in; mask (H, W) bool. From other pictures of the recording: its looks.
    """

    color: tuple[int, int, int] | None = None
    roi: tuple[int, int, int, int] | None = None
    mask: np.ndarray | None = None
    looks: Looks | None = None


def segment_rope(
    color: np.ndarray,
    ends: np.ndarray,
    depth: np.ndarray | None = None,
    looked: Looked | None = None,
) -> Segmentation:
    """Find the rope in an image (H, W, 3) uint8 RGB. ends (2, 2) [px], NaN where unknown.

    depth (H, W) [m], 0 = none, gives one more cue. Pictures larger than `LARGE_PICTURE` are worked
    on at a whole fraction of their size. Raises FrameRejected where nothing is like a rope.
    """
    looked = looked or Looked()
    if min(color.shape[:2]) < SMALLEST:
        raise FrameRejected(f"a picture of {color.shape[1]}x{color.shape[0]} pixels is too small")
    shrink = min(-(-max(color.shape[:2]) // LARGE_PICTURE), min(color.shape[:2]) // SMALLEST)
    if shrink > 1:
        return _enlarged(segment_rope(*_shrunk(color, ends, depth, looked, shrink)), color, shrink)
    allowed = region(color.shape[:2], looked.roi)
    if looked.mask is not None and not (looked.mask & allowed).any():
        raise FrameRejected("the mask is empty")
    specified = looked.mask is not None or looked.color is not None
    lab = lab_of(color)
    found: list[Candidate] = []
    failed: dict[str, str] = {}  # {cue: why it shows no rope}
    if looked.looks is not None and not specified:
        near = None if depth is None else nearness(depth)
        quick = candidate_of(
            FAMILIAR_CUE, looked.looks.mask(color, near) & allowed, lab, ends, depth
        )
        if isinstance(quick, Candidate):
            if quick.score > FAMILIAR * looked.looks.score:
                return _finished(quick, lab, ends, depth is None)
            found.append(quick)
    for cue, guess in _masks(lab, color, depth, looked):
        candidate = candidate_of(cue, guess & allowed, lab, ends, depth)
        if isinstance(candidate, Candidate):
            found.append(candidate)
        else:
            failed[cue] = candidate
    if not found:
        raise FrameRejected(
            "no long thin region of one colour in the image: "
            + "; ".join(f"{cue}: {why}" for cue, why in failed.items())
            + _what_helps(looked)
        )
    # A mask may show little of a rope that the picture shows more of: that is asked of the best.
    found.sort(key=lambda item: -item.score * float(np.sqrt(item.path.seen.mean())))
    chosen = [
        _finished(item, lab, ends, depth is None) for item in found[: 1 if specified else FINALISTS]
    ]
    best = max(chosen, key=lambda item: item.score)
    if best.score < DOUBTFUL and not specified:
        raise FrameRejected(
            "nothing in the image is long and thin enough to be the rope: the best cue "
            f"({best.cue}) scores {best.score:.3f}, {DOUBTFUL:g} is needed{_what_helps(looked)}"
        )
    others = sorted(
        [(item.cue, item.score) for item in found if not _same(item.path.points, best)],
        key=lambda item: -item[1],
    )
    least = COMPARABLE * best.score
    several = not np.isfinite(ends).all() and any(score > least for _, score in others)
    return replace(best, runners_up=others[:5], several=best.several or (several and not specified))


def _what_helps(looked: Looked) -> str:
    """Return what a person may give besides what was given."""
    if looked.mask is not None:
        return SEE
    given = {"--color": looked.color is not None, "--roi": looked.roi is not None}
    *others, last = [*(name for name, known in given.items() if not known), "--mask"]
    ways = f"{', '.join(others)} or {last}" if others else last
    return f"; give {ways} (masks drawn by hand help where the rope is like its ground){SEE}"


def _shrunk(
    color: np.ndarray, ends: np.ndarray, depth: np.ndarray | None, looked: Looked, by: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, Looked]:
    size = (max(color.shape[1] // by, 1), max(color.shape[0] // by, 1))
    small = cv2.resize(color[: size[1] * by, : size[0] * by], size, interpolation=cv2.INTER_AREA)
    near = lambda x: None if x is None else x[by // 2 :: by, by // 2 :: by][: size[1], : size[0]]  # noqa: E731
    roi = looked.roi and tuple(int(value // by) for value in looked.roi)
    return (
        small,
        (ends + 0.5) / by - 0.5,
        near(depth),
        replace(looked, roi=roi, mask=near(looked.mask)),
    )


def _enlarged(found: Segmentation, color: np.ndarray, by: int) -> Segmentation:
    size = (color.shape[1], color.shape[0])
    mask = cv2.resize(found.mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    path = (found.path + 0.5) * by - 0.5
    return replace(found, mask=mask, path=path, width=found.width * by)


def region(shape: tuple[int, ...], roi: tuple[int, int, int, int] | None) -> np.ndarray:
    """Return (H, W) bool: the part of the picture that may hold the rope."""
    allowed = np.ones(shape[:2], dtype=bool)
    if roi is not None:
        u, v, width, height = roi
        allowed[:] = False
        allowed[max(v, 0) : max(v + height, 0), max(u, 0) : max(u + width, 0)] = True
    return allowed


def _masks(
    lab: np.ndarray,
    color: np.ndarray,
    depth: np.ndarray | None,
    looked: Looked,
) -> Iterator[tuple[str, np.ndarray]]:
    if looked.mask is not None:
        yield "the given mask", looked.mask
        return
    if looked.color is not None:
        yield "the given colour", near_colour(lab_of(color, 1.0), looked.color)
        return
    yield from unlike_masks(lab)
    yield from colour_masks(lab_of(color, 1.0))
    if depth is not None and depth.any():
        yield "nearer than its surroundings", depth_mask(depth)


def _finished(item: Candidate, lab: np.ndarray, ends: np.ndarray, by_picture: bool) -> Segmentation:
    """Return the candidate's path at even distances, to the rope's ends; where its mask shows
    little of it (or `by_picture`) corrected by the picture."""
    path, width, mask = item.path, item.strands.width, item.mask
    points = even(path.points, 1.0)
    arc = polyline_arc(path.points)
    share = np.interp(polyline_arc(points), arc, path.seen.astype(float))
    seen = share > 0.5
    free = [end for end in (1, 0) if not np.isfinite(ends[end]).all()]
    if by_picture or seen.mean() < SHOWS:
        # A mask of marks or of the core of a rope is narrower than the rope.
        points, _ = settle(lab, points, 1.2 * width, 1.5 * width, seen)
        width = measured_width(lab, points, width)
        points = even(points, 1.0)
        trim = int(2 * width)
        for end in free:
            turn = slice(None, None, 1 if end else -1)
            if len(points) > 10 * trim:
                points = grow(lab, points[turn][:-trim], width, 1.0)[turn]
        points, shown = settle(lab, even(points, 1.0), width, 0.5 * width)
        seen = visible(lab, points, shown, width)
        mask = mask | _stroke(points, seen, width, mask.shape)
    else:
        radius = cv2.distanceTransform(item.mask.astype(np.uint8), cv2.DIST_L2, 3)
        for end in free:
            before = len(points)
            turn = slice(None, None, 1 if end else -1)
            points = _to_the_tip(points[turn], radius, width)[turn]
            more = np.ones(len(points) - before, dtype=bool)
            seen = np.concatenate([seen, more] if end else [more, seen])
    score = item.score * float(seen.mean())
    return Segmentation(
        mask, points, seen, width, score, item.cue, path.bridged + 1, several=item.others
    )


def _stroke(
    points: np.ndarray, seen: np.ndarray, width: float, shape: tuple[int, ...]
) -> np.ndarray:
    """Return (H, W) bool: a band as wide as the rope along the seen stretches of a path."""
    out = np.zeros(shape, np.uint8)
    fixed = np.round(points * 16).astype(np.int32)
    for part in np.split(np.arange(len(points)), np.flatnonzero(np.diff(seen.astype(int))) + 1):
        if len(part) > 1 and seen[part[0]]:
            cv2.polylines(out, [fixed[part][:, None]], False, 1, max(round(width), 1), shift=4)
    return out > 0


def _to_the_tip(points: np.ndarray, radius: np.ndarray, width: float) -> np.ndarray:
    """Return a skeleton stops half a width and more before the tip: on, straight, while the mask is
    as wide as the rope. radius (H, W) [px]: distance to the mask's edge."""
    back = points[-1 - min(int(2 * width), len(points) - 1)]
    ahead = (points[-1] - back) / max(float(np.linalg.norm(points[-1] - back)), 1e-9)
    more = points[-1] + np.arange(1, int(3 * width) + 1)[:, None] * ahead
    at = np.round(more).astype(int)
    inside = ((at >= 0) & (at < radius.shape[::-1])).all(axis=1)
    at = np.clip(at, 0, np.array(radius.shape[::-1]) - 1)
    r = radius[at[:, 1], at[:, 0]]
    good = inside & (r > 0) & (r <= THICK * width / 2 + 1)
    count = len(good) if good.all() else int(np.argmin(good))
    return np.concatenate([points, more[:count]])


def _same(points: np.ndarray, best: Segmentation) -> bool:
    """Return whether a path runs along the chosen one."""
    some = points[:: max(len(points) // 50, 1)]
    gap = np.linalg.norm(some[:, None] - best.path[None, :: max(len(best.path) // 300, 1)], axis=2)
    return bool(np.median(gap.min(axis=1)) < 2 * best.width + 5)
