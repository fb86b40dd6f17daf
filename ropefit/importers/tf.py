"""Chains of transforms over time, as ROS publishes them on /tf and /tf_static."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ropefit.errors import BadInput, WrongUsage
from ropefit.importers.base import Entry
from ropefit.importers.numbers import pose_at, product, rotation

Pose = tuple[np.ndarray, np.ndarray]
DEEPEST = 100  # links of a chain; more is a circle


@dataclass
class Link:
    """child in parent: times [s], positions [m], quaternions w x y z."""

    parent: str
    static: bool
    times: list[float] = field(default_factory=list)
    positions: list[np.ndarray] = field(default_factory=list)
    quaternions: list[np.ndarray] = field(default_factory=list)
    _sorted: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def at(self, time: float, gap: float) -> Pose | None:
        """Return the link's pose at a time; a static one holds for ever."""
        if self.static:
            return self.positions[-1], self.quaternions[-1]
        if self._sorted is None:
            order = np.argsort(self.times, kind="stable")
            self._sorted = (
                np.array(self.times)[order],
                np.array(self.positions)[order],
                np.array(self.quaternions)[order],
            )
        return pose_at(*self._sorted, time, gap)


class Transforms:
    """All links of a bag."""

    def __init__(self) -> None:
        self.links: dict[str, Link] = {}

    def add(self, parent: str, child: str, time: float, pose: Pose, static: bool) -> None:
        """Add one transform: child in parent at a time [s]."""
        parent, child = parent.strip("/"), child.strip("/")
        link = self.links.setdefault(child, Link(parent, static))
        link.parent = parent
        link.times.append(time)
        link.positions.append(pose[0])
        link.quaternions.append(pose[1])

    def frames(self) -> list[str]:
        """Return names of every frame."""
        return sorted(set(self.links) | {link.parent for link in self.links.values()})

    def entries(self) -> list[Entry]:
        """Return the frames as `--set end0=` takes them, with their parents and samples."""
        found = []
        for name in self.frames():
            link = self.links.get(name)
            kind = f"tf frame in {link.parent}" if link else "tf frame (root)"
            found.append(Entry(f"tf:{name}", kind, len(link.times) if link else 0))
        return found

    def find(self, frame: str, fixed: str, time: float, gap: float) -> Pose | None:
        """Return pose of `frame` in `fixed`; None without a sample within `gap` [s] of the time.

        Raises WrongUsage when no chain joins the two.
        """
        own, other = (
            self._root(frame.strip("/"), time, gap),
            self._root(fixed.strip("/"), time, gap),
        )
        if own is None or other is None:
            return None
        (a, first), (b, second) = own, other
        if first != second:
            raise WrongUsage(
                f"no transform joins {frame!r} and {fixed!r}; there are {', '.join(self.frames())}"
            )
        back = b[1] * [1, -1, -1, -1]
        return rotation(back) @ (a[0] - b[0]), product(back, a[1])

    def _root(self, frame: str, time: float, gap: float) -> tuple[Pose, str] | None:
        """Return a frame's pose in the frame at the top of its tree, and that frame's name."""
        position, quaternion = np.zeros(3), np.array([1.0, 0, 0, 0])
        for _ in range(DEEPEST):
            link = self.links.get(frame)
            if link is None:
                return (position, quaternion), frame
            pose = link.at(time, gap)
            if pose is None:
                return None
            position = pose[0] + rotation(pose[1]) @ position
            quaternion = product(pose[1], quaternion)
            frame = link.parent
        raise BadInput("the transforms form a circle")
