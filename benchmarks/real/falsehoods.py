"""What a recording of a rope in motion, with two held markers at each end, may tell falsely."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.discovery.falsified import CLAMP, TILT, WEAK_GRAVITY, tilted_gravity, weak_gravity
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.parallel_transport import along

LENGTH = 0.02  # that is told too much
LATE = 3  # frames
STEP = 0.01  # s
OUTER, INNER = 0, 1  # the held pair of end 0
HELD = [0, 1, -2, -1]


@dataclass
class Told:
    """A recording of clips of one length, markers (C, T, M, 3) [m], that is changed in place."""

    folder: Path
    clips: int

    def changed(self, falsehood: Falsehood) -> None:
        falsehood.change(self)

    def markers(self, change: Callable[[np.ndarray], np.ndarray], drop: int = 0) -> None:
        """Change the markers; drop: frames at the beginning of each clip."""
        path = self.folder / "markers.npz"
        with np.load(path) as file:
            data = dict(file)
        clips = np.stack(np.split(data["positions"], self.clips))
        data["positions"] = np.concatenate(change(clips)[:, drop:])
        data["time"] = np.concatenate([part[drop:] for part in np.split(data["time"], self.clips)])
        np.savez(path, **data)

    def longer(self, share: float) -> None:
        """Tell the length of the rope, and the places of markers if they are told, too long."""
        path = self.folder / "recording.toml"

        def more(found: re.Match[str]) -> str:
            return found[1] + re.sub(
                r"[\d.]+", lambda v: f"{(1 + share) * float(v[0]):.6f}", found[2]
            )

        text = re.sub(r"(?m)^((?:length|arc_length) = )(.*)$", more, path.read_text())
        path.write_text(text)


def late_ends(clips: np.ndarray) -> np.ndarray:
    """Return the clips with held markers as they were some frames before."""
    out = clips.copy()
    out[:, LATE:, HELD] = clips[:, :-LATE, HELD]
    return out


def tilted_clamp(clips: np.ndarray) -> np.ndarray:
    """Return the clips with the clamp of end 0 tilted: its outer marker is turned about the inner
    one, by a constant angle in a frame that is carried along without roll."""
    out = clips.copy()
    for clip in out:
        way = clip[:, INNER] - clip[:, OUTER]
        size = np.linalg.norm(way, axis=1, keepdims=True)
        w, x, y, z = along(quaternion_along(way[0]), way / size).T
        frames = Rotation.from_quat(np.stack([x, y, z, w], axis=1))
        tilted = frames.apply([np.sin(CLAMP), 0.0, np.cos(CLAMP)])
        clip[:, OUTER] = clip[:, INNER] - size * tilted
    return out


@dataclass(frozen=True)
class Falsehood:
    """How a recording is changed, the names that are right for it, and the true sizes; beside: the
    size where another of the same kind is there, too."""

    change: Callable[[Told], None]
    names: tuple[str, ...]
    sizes: dict[str, float]
    beside: Callable[[float, float], float] = lambda size, other: (1 + size) * (1 + other) - 1


FALSEHOODS: dict[str, Falsehood] = {
    "length told 2 % too long": Falsehood(
        lambda told: told.longer(LENGTH), ("length_error",), {"excess": 1 / (1 + LENGTH) - 1}
    ),
    "a clamp tilted by 5°": Falsehood(
        lambda told: told.markers(tilted_clamp), ("clamped_end",), {"tilt": CLAMP}
    ),
    "gravity tilted by 3°": Falsehood(
        lambda told: tilted_gravity(told.folder), ("gravity_misalignment",), {"angle": TILT}
    ),
    "gravity of 4.81 m/s²": Falsehood(
        lambda told: weak_gravity(told.folder), ("weight_error",),
        {"excess": 9.81 / WEAK_GRAVITY - 1},
    ),
    "ends 30 ms late": Falsehood(
        lambda told: told.markers(late_ends, LATE), ("time_lag",), {"lag": LATE * STEP}
    ),
}  # fmt: skip
