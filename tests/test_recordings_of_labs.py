"""What labs have: ends whose direction is known and whose roll is not, masks of some frames, a
picture in which no cue shows the rope."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ropefit.errors import BadInput
from ropefit.perception.segment import Looked, segment_rope
from ropefit.perception.trace import FrameRejected
from ropefit.perception.tracing import Tracer, tangents
from ropefit.recordings import Masks, open_recording
from ropefit.recordings.clocks import at_times
from tests.conftest import SAMPLES
from tests.factories import marker_recording
from tests.test_perception_samples import observe

UNKNOWN = np.full((2, 2), np.nan)


def with_tangents(where, column: str = "tx,ty,tz", given: str = "1,0,-1"):
    """A recording of markers whose ends have tangents."""
    directory = marker_recording(where)
    head, *rows = (directory / "ends.csv").read_text().split()
    lines = [f"{head},{column}", *(f"{row},{given}" for row in rows)]
    (directory / "ends.csv").write_text("\n".join(lines) + "\n")
    return directory


def test_a_tangent_clamps_and_says_nothing_of_roll(tmp_path) -> None:
    where = with_tangents(tmp_path / "r")
    recording = open_recording(where)
    assert recording.ends is not None
    for end in recording.ends:
        assert (end.kind, end.roll_known) == ("clamped", False)
        direction = tangents(np.stack(list(end.orientation.values())))
        np.testing.assert_allclose(direction, [[0.5**0.5, 0, -(0.5**0.5)]] * 3, atol=1e-12)
        later = at_times(where, 0, end, {0: 0.0, 1: 0.5, 2: 1.0}, {0: 0.25, 1: 0.75})
        assert not later.roll_known
    seen = observe(where, tmp_path / "run")
    assert seen.end_kind == ("clamped", "clamped")
    assert not seen.end_twist_known


@pytest.mark.parametrize(
    ("column", "given", "message"),
    [
        ("tx,ty", "1,0", "needs all of tx,ty,tz"),
        ("tx,ty,tz", "0,0,0", "no length"),
        ("tx,ty,tz", "1,,0", "missing entry"),
        ("tx,ty,tz,qw,qx,qy,qz", "1,0,0,1,0,0,0", "not both"),
    ],
)
def test_tangents_that_cannot_be(tmp_path, column: str, given: str, message: str) -> None:
    with pytest.raises(BadInput, match=message):
        open_recording(with_tangents(tmp_path / "r", column, given))


def test_frames_without_a_mask_are_excluded_alone(tmp_path) -> None:
    recording = open_recording(SAMPLES / "rgbd")
    first, second = recording.frames[:2]
    sight = recording.source.sight(first)
    assert sight.color is not None
    (tmp_path / "masks").mkdir()
    nothing = np.zeros(sight.color.shape[:2], np.uint8)
    cv2.imwrite(str(tmp_path / "masks" / f"{first:06d}.png"), nothing)
    tracer = Tracer(recording, masks=Masks(tmp_path / "masks"))
    with pytest.raises(FrameRejected, match="the mask is empty"):
        tracer.trace(first)
    with pytest.raises(FrameRejected, match="no mask of this frame"):
        tracer.trace(second)


def test_white_on_white_says_which_cue_failed() -> None:
    white = np.full((200, 300, 3), 240, np.uint8)
    with pytest.raises(
        FrameRejected, match=r"colour 1: 100% .*--color, --roi or --mask .*; --debug"
    ):
        segment_rope(white, UNKNOWN)
    with pytest.raises(FrameRejected, match=r"give --color or --mask"):
        segment_rope(white, UNKNOWN, looked=Looked(roi=(50, 50, 100, 100)))
    with pytest.raises(FrameRejected, match="the given colour: 100% of the picture, a rope fills"):
        segment_rope(white, UNKNOWN, looked=Looked(color=(240, 240, 240)))
    dot = white.copy()
    cv2.circle(dot, (150, 100), 8, (200, 0, 0), -1)
    with pytest.raises(FrameRejected, match=r"the given colour: .*px, a rope at least 30|no line"):
        segment_rope(dot, UNKNOWN, looked=Looked(color=(200, 0, 0)))
