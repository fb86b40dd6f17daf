"""Two clocks: poses of an end are interpolated to the times at which the markers were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.gaps import LONGEST_GAP
from ropefit.recordings.recording import End

SAME_TIME = 0.01  # of the step between poses: rows whose times differ by less are of one moment
LEAST_FOR_CUBIC = 4  # poses; fewer are joined by straight lines


def at_times(
    path: Path, which: int, end: End, own: Mapping[int, float], wanted: Mapping[int, float]
) -> End:
    """Return the end at the markers' times `wanted` {frame: [s]}; its poses are at `own`.

    Where every frame that both have is at one time in both, poses are taken by frame. Otherwise
    positions are interpolated by a cubic spline, orientations on the shortest arc (slerp). Frames
    outside the poses' times, or in a gap between them, get no pose. A constant offset of the
    clocks stays; `time_lag` is its name in the diagnosis. Raises BadInput where no frame is covered
    or time does not increase.
    """
    rows = sorted(end.position, key=lambda frame: own[frame])
    time = np.array([own[row] for row in rows])
    steps = np.diff(time)
    step = float(np.median(steps)) if steps.size else 0.0
    slack = max(SAME_TIME * step, 1e-6)
    common = [frame for frame in wanted if frame in end.position]
    if common and all(abs(own[frame] - wanted[frame]) <= slack for frame in common):
        return end
    if (steps <= 0).any():
        row = rows[int(np.argmax(steps <= 0)) + 1]
        raise BadInput(
            f"{path}: end {which}, frame {row}: time does not increase, and it is not the markers' "
            "time either; give both on one clock"
        )
    frames = np.array(list(wanted))
    at = np.array(list(wanted.values()))
    after = np.clip(np.searchsorted(time, at), 1, max(len(time) - 1, 1))
    covered = (at >= time[0] - slack) & (at <= time[-1] + slack)
    if len(time) > 1:
        covered &= steps[after - 1] <= LONGEST_GAP * step
    if not covered.any():
        raise BadInput(
            f"{path}: end {which} has poses at {time[0]:.6g} to {time[-1]:.6g} s, the markers are "
            f"at {at.min():.6g} to {at.max():.6g} s: no marker frame has a pose; give both on one "
            "clock"
        )
    from scipy.interpolate import CubicSpline, interp1d  # what answers at once loads no scipy
    from scipy.spatial.transform import Rotation, Slerp

    frames, at = frames[covered].tolist(), np.clip(at[covered], time[0], time[-1])
    given = np.array([end.position[row] for row in rows])
    if len(time) == 1:
        position = np.repeat(given, len(at), axis=0)
    elif len(time) < LEAST_FOR_CUBIC:
        position = interp1d(time, given, axis=0)(at)
    else:
        position = CubicSpline(time, given)(at)
    turned: dict[int, np.ndarray] = {}
    if end.kind == "clamped":
        scalar_last = np.array([end.orientation[row] for row in rows])[:, [1, 2, 3, 0]]
        turns = Rotation.from_quat(scalar_last)
        between = Slerp(time, turns)(at).as_quat() if len(time) > 1 else scalar_last
        quaternion = np.broadcast_to(between[:, [3, 0, 1, 2]], (len(at), 4))
        turned = dict(zip(frames, quaternion, strict=True))
    positions = dict(zip(frames, position, strict=True))
    return replace(end, position=positions, orientation=turned)
