"""Where recording and models differ: maps over arc length and frame, without and with the cause."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis, Observations
from ropefit.reporting.compared import Compared, compared
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import NOMINAL, WITH_CAUSE, Figure, axis, heat, plane
from ropefit.reporting.html import pair, paragraph
from ropefit.reporting.sections.base import Section

EXTREME = 0.99  # quantile of the misfit at which the colours end
LEAST_TOP = 1.0  # times the noise: smaller misfits are pale, as no reader is to see more in them


class WhereSection(Section):
    """Signed misfit in multiples of the noise, on one scale; regions beyond noise are boxed."""

    title = "Where"

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None

    def render(self, run: RunContents) -> Markup:
        c = compared(run)
        assert c is not None
        both = [m for m in (c.before, c.after) if m is not None]
        sizes = np.abs(np.concatenate([m[np.isfinite(m)] for m in both]))
        top = max(float(np.quantile(sizes, EXTREME)) if sizes.size else 0.0, LEAST_TOP)
        above, below = c.sides
        boxed = " Boxed: beyond noise." if run.diagnosis and run.diagnosis.mismatch else ""
        text = (
            "How far the recorded rope lies from the simulated one, in multiples of the noise of a "
            f"point. Orange: {above}; blue: {below}; blank: not seen.{boxed} A click on a cell "
            "shows its frame in the picture. s = 0 is the gripper’s end."
        )
        maps = [_map(run.observations, c, c.before, top, run.diagnosis, "nominal", NOMINAL)]
        if c.after is not None:
            maps.append(_map(run.observations, c, c.after, top, None, "with the cause", WITH_CAUSE))
        return paragraph(text, "note") + pair(*maps)


def _map(
    o: Observations, c: Compared, values: np.ndarray, top: float, d: Diagnosis | None, name: str,
    colour: str,
) -> Figure:  # fmt: skip
    frames = o.frames[c.at]
    rows = np.isfinite(values).any(axis=0) | (o.source != "markers")
    cells = heat(frames, c.station[rows], values.T[rows], "times the noise")
    cells |= {"zmin": -top, "zmax": top}
    boxes = [] if d is None else [_box(r.frames, r.arc_length) for r in d.mismatch]
    return Figure(
        f"Where the recording differs from the model, {name}",
        [cells],
        plane(axis("frame"), axis("arc length s (m)"), shapes=boxes),
        title=(name, colour),
        columns=[int(np.argmin(np.abs(c.shown - k))) for k in range(len(frames))],
    )


def _box(frames: tuple[int, int], arc: tuple[float, float]) -> dict[str, list[float]]:
    return {"x": [frames[0] - 0.5, frames[1] + 0.5], "y": [arc[0], arc[1]]}
