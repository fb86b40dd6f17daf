"""The pictures themselves, with what was taken for the rope drawn in."""

from __future__ import annotations

import base64

import numpy as np
from markupsafe import Markup

from ropefit.reporting.camera import project
from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import paragraph
from ropefit.reporting.sections.base import Section


class PicturesSection(Section):
    """A few frames of the camera: the path that was followed, where it was seen, and why."""

    title = "Pictures"
    folded = True

    def applies(self, run: RunContents) -> bool:
        o = run.observations
        return o.pictures is not None and o.picture_start is not None and o.pictures.size > 0

    def render(self, run: RunContents) -> Markup:
        o = run.observations
        assert o.pictures is not None
        assert o.picture_start is not None
        body = paragraph(
            "Red: the rope where it was seen. Blue: where it was hidden and its way assumed. Green "
            "rings: its ends." + (" Yellow: the nominal model." if run.fitted else ""),
            "note",
        )
        if not o.depth_measured:
            body += paragraph(
                "The pictures have no depth. Points in space are pixels projected onto an assumed "
                "plane: only losses in the image plane compare what was measured."
            )
        frames = [] if o.picture_frame is None else o.picture_frame.tolist()
        bounds = zip(o.picture_start[:-1], o.picture_start[1:], strict=True)
        for i, (frame, (first, last)) in enumerate(zip(frames, bounds, strict=False)):
            why = o.picture_text[i] if i < len(o.picture_text) else ""
            data = base64.b64encode(o.pictures[first:last].tobytes()).decode()
            body += Markup(
                '<figure class="picture"><svg viewBox="0 0 {} {}" role="img" '
                'aria-label="Frame {}: the rope as found in the picture, and as simulated">'
                '<image width="{}" height="{}" href="data:image/jpeg;base64,{}"/>{}</svg>'
                "<figcaption>Frame {}: {}.</figcaption></figure>\n"
            ).format(
                o.view.width, o.view.height, frame, o.view.width, o.view.height, data,
                _simulated(run, frame), frame, why,
            )  # fmt: skip
        return body


def _simulated(run: RunContents, frame: int) -> Markup:
    """Return the nominal model as a line over the picture."""
    o, f = run.observations, run.fitted
    at = np.flatnonzero(o.frames == frame)
    if f is None or at.size == 0:
        return Markup("")
    uv = project(o.view, f.x[at[0]])
    points = " ".join(f"{u:.1f},{v:.1f}" for u, v in uv[np.isfinite(uv).all(axis=1)])
    return Markup('<polyline points="{}"/>').format(points)
