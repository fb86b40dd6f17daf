"""What all marker formats share: which markers, in what order, which of them are held."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import field_validator

from ropefit.errors import BadInput, WrongUsage
from ropefit.importers.base import Options, thinned
from ropefit.importers.draft import Draft

MOST_MARKERS = 10_000


class MarkerOptions(Options):
    """markers: names in order from end 0 to end 1, with commas between; all if not given.

    held0, held1: the names of one or two markers held at an end, the outermost first; a free end
    has none. scale: metres per unit. rate: frames a second, where the file has no clock.
    up: the axis of the file that points up, y or z.
    """

    markers: str | None = None
    held0: str | None = None
    held1: str | None = None
    scale: float | None = None
    rate: float | None = None
    up: Literal["y", "z"] | None = None

    @field_validator("scale", "rate")
    @classmethod
    def _positive(cls, value: float | None) -> float | None:
        if value is not None and value <= 0:
            raise ValueError("must be positive")
        return value


def deliver(
    source: Path,
    options: MarkerOptions,
    draft: Draft,
    names: list[str],
    time: np.ndarray | None,
    positions: np.ndarray,
    scale: float,
    up: str = "z",
) -> None:
    """Put chosen markers of (F, M, 3) positions into the draft; `scale` and `up` if the options
    have none; time (F,) [s], if known. With Y up, (x, y, z) becomes (x, -z, y)."""
    if positions.shape[1] > MOST_MARKERS:
        raise BadInput(f"{source}: {positions.shape[1]} markers; at most {MOST_MARKERS} are read")
    chosen = _split(options.markers) or names
    missing = [name for name in chosen if name not in names]
    if missing:
        raise WrongUsage(f"--set markers: no marker {missing[0]!r}; there are {', '.join(names)}")
    if len(chosen) < 2 or len(set(chosen)) < len(chosen):
        raise WrongUsage(f"--set markers={','.join(chosen)}: two or more, each once")
    if options.markers is None:
        draft.note(
            f"markers are taken in the file's order, {chosen[0]} at end 0 to {chosen[-1]} at end "
            "1; give --set markers=... in the order along the rope if it is another"
        )
    rows = np.array(thinned(list(range(len(positions))), options, source), dtype=int)
    columns = [names.index(name) for name in chosen]
    picked = positions[rows][:, columns] * (options.scale or scale)
    if (options.up or up) == "y":
        picked = np.stack([picked[..., 0], -picked[..., 2], picked[..., 1]], axis=-1)
        draft.note("Y points up in the file: turned so that Z does; if it is wrong, --set up=z")
    own = None if time is None else time[rows]
    if np.isinf(picked).any() or not (own is None or np.isfinite(own).all()):
        raise BadInput(f"{source}: infinite positions or times that are no numbers")
    if not np.isfinite(picked).any():
        raise BadInput(f"{source}: no position of the chosen markers is a number")
    if own is not None and (np.diff(own) <= 0).any():
        raise BadInput(f"{source}: time does not increase from frame to frame")
    if own is None:
        draft.note(
            "the file has no times: its frames are taken for single shapes at rest; if they were "
            "filmed, give --set rate=... in frames a second"
        )
    held = _held(options, chosen)
    if held is None:
        draft.note("no held marker given (--set held0=, held1=): the outermost count as pinned")
    draft.markers(picked, own, source, held)


def _held(options: MarkerOptions, chosen: list[str]) -> str | None:
    if options.held0 is None and options.held1 is None:
        return None
    ends = []
    for name, text in (("held0", options.held0), ("held1", options.held1)):
        held = _split(text)
        missing = [marker for marker in held if marker not in chosen]
        if missing or len(held) > 2:
            raise WrongUsage(f"--set {name}={text}: one or two of {', '.join(chosen)}")
        ends.append(sorted(chosen.index(marker) for marker in held))
    return str(ends)


def _split(text: str | None) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()] if text else []
