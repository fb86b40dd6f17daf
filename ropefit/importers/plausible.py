"""Are these numbers metres? Wrong units are what goes wrong most in imports."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings import check_spread

NEAREST, FARTHEST = 0.05, 12.0  # m: no depth camera on a rope sees nearer or farther than this
SHORTEST, LONGEST = 0.02, 50.0  # m: the spread of what is recorded in a laboratory
SCALES = {0.001: "a millimetre", 0.0002: "a fifth of a millimetre", 0.0001: "a tenth of one"}


def check_depth(path: Path, frame: int, depth: np.ndarray, scale: float) -> float | None:
    """Return the middle distance [m] of a depth image (H, W), None where it is empty.

    Raises BadInput where that distance is impossible.
    """
    seen = depth[depth > 0]
    if seen.size == 0:
        return None
    middle = float(np.median(seen)) * scale
    if NEAREST <= middle <= FARTHEST:
        return middle
    other = [
        f"{value:g} (a unit is {name})"
        for value, name in SCALES.items()
        if value != scale and NEAREST <= np.median(seen) * value <= FARTHEST
    ]
    hint = f"; --set depth_scale={' or '.join(other)} would fit" if other else ""
    raise BadInput(
        f"{path}: frame {frame}: half of the depth image lies nearer than {middle:.3g} m with "
        f"{scale:g} m per unit, which no camera sees{hint}; correct depth_scale"
    )


def check_points(
    path: Path, frame: int, points: np.ndarray, length: float | None, times: float = 1.0
) -> None:
    """Refuse points (N, 3) that spread as nothing of `times` the rope's length does. Raises
    BadInput."""
    if len(points) >= 2:
        _check_unit(path, frame, points)
    check_spread(path, frame, points, length, times)


def _check_unit(path: Path, frame: int, points: np.ndarray) -> None:
    low, high = np.quantile(points, (0.02, 0.98), axis=0)
    spread = float(np.linalg.norm(high - low))
    if not np.isfinite(spread) or SHORTEST / 10 <= spread <= LONGEST or spread == 0:
        return
    unit = 0.001 if spread > LONGEST else 1000.0
    fits = SHORTEST <= spread * unit <= LONGEST
    hint = f"--set scale={unit:g} would fit" if fits else "give --set scale"
    raise BadInput(
        f"{path}: frame {frame}: the points spread over {spread:.4g} m, no rope in a laboratory; "
        f"{hint} (metres per unit)"
    )
