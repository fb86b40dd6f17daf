"""Looks of a rope learned from a few pictures of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ropefit.perception.cues import lab_of, nearness
from ropefit.perception.looks import Looks, learn
from ropefit.perception.mask_candidate import Candidate, candidate_of
from ropefit.perception.segment import FAMILIAR_CUE, Segmentation


@dataclass(frozen=True)
class Picture:
    """color (H, W, 3), depth (H, W) [m] or None, ends (2, 2) [px], and what was taken for the
    rope."""

    color: np.ndarray
    depth: np.ndarray | None
    ends: np.ndarray
    found: Segmentation


def best_looks(pictures: list[Picture]) -> Looks | None:
    """Return, of the looks of the rope in some pictures, those by which it is found best in all of
    them; None where no looks serve."""
    best: Looks | None = None
    labs = [lab_of(picture.color) for picture in pictures]
    nears = [None if p.depth is None else nearness(p.depth) for p in pictures]
    for one, near in zip(pictures, nears, strict=True):
        found = one.found
        looks = learn(one.color, near, found.mask, found.path, found.width, found.score)
        scores = []
        for lab, other, beside in zip(labs, pictures, nears, strict=True):
            mask = looks.mask(other.color, beside)
            quick = candidate_of(FAMILIAR_CUE, mask, lab, other.ends, other.depth)
            shows = isinstance(quick, Candidate)
            scores.append(quick.score * float(quick.path.seen.mean()) if shows else 0.0)
        score = float(np.mean(scores))
        if score > 0 and (best is None or score > best.score):
            best = replace(looks, score=score)
    return best
