"""The rope in a cloud of a whole scene: within reach of the ends, off planes, thin, in clusters."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import KDTree

from ropefit.perception.background import FLAT, SLACK, sheet
from ropefit.perception.trace import FrameRejected

MANY = 20_000  # points: more are a scene, whatever they show
CELL = 1 / 400  # of the rope's length: one point in each is looked at
ROUND = 8  # cells: the neighbourhood in which a rope is a line and a surface is none
PLANES, LEAST_SHARE = 6, 0.05  # planes that are looked for; share of the points that makes one
APART = 6  # cells: a gap between clusters
LEAST_CELLS = 20  # cells with points in a cluster; fewer are no piece of rope


@dataclass
class Cues:
    """What each step left of a cloud, for a person to read."""

    steps: list[str] = field(default_factory=list)

    def left(self, points: np.ndarray, what: str) -> None:
        """Note how many points a step left. Raises FrameRejected where too few are left."""
        self.steps.append(f"{len(points):,} {what}")
        if len(points) < LEAST_CELLS:
            raise FrameRejected(
                f"no rope in the scene: of {self}; widen or give [clouds] crop, or check the ends "
                "and the rope's length"
            )

    def __str__(self) -> str:
        return ", ".join(self.steps)


def is_scene(points: np.ndarray, length: float | None) -> bool:
    """Return whether points (N, 3) [m] show more than a rope of this length can fill."""
    if len(points) > MANY:
        return True
    low, high = np.quantile(points, (0.25, 0.75), axis=0) if len(points) else (np.zeros(3),) * 2
    return length is not None and float(np.linalg.norm(high - low)) > length


def rope_in_scene(points: np.ndarray, ends: np.ndarray, length: float | None) -> np.ndarray:
    """Return (M, 3) [m] the points (N, 3) of a scene that may be rope.

    ends (2, 3): NaN where unknown. Raises FrameRejected with what each step left.
    """
    if length is None:
        raise FrameRejected(
            f"{len(points):,} points are a whole scene: give [rope] length, or [clouds] crop so "
            "that little more than the rope is left"
        )
    cues = Cues()
    cues.left(points, "points")
    cell = CELL * length
    known = ends[np.isfinite(ends).all(axis=1)]
    away = sum((np.linalg.norm(points - end, axis=1) for end in known), np.zeros(len(points)))
    near = points[away < (SLACK if len(known) == 2 else 1.0) * length] if len(known) else points
    cues.left(near, "within reach of the ends")
    kept = _clusters(_thin(_off_planes(_thinned(near, cell), cell, cues), cell, cues), cell, cues)
    kept = _joined(kept, len(known) > 0, length)
    close = KDTree(np.concatenate(kept)).query(near, distance_upper_bound=cell)[0]
    return near[np.isfinite(close)]


def _cloud(points: np.ndarray):
    import open3d as o3d  # 312 MB, a second to load: for whole scenes only

    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))


def _thinned(points: np.ndarray, cell: float) -> np.ndarray:
    """Return the mean of the points in each cell."""
    return np.asarray(_cloud(points).voxel_down_sample(cell).points)


def _off_planes(points: np.ndarray, cell: float, cues: Cues) -> np.ndarray:
    """Return what lies in no table, floor or wall."""
    rng = np.random.default_rng(0)
    for _ in range(PLANES):
        inside = sheet(points, cell / CELL, rng, LEAST_SHARE) if len(points) > LEAST_CELLS else None
        if inside is None:
            break
        points = points[~inside]
    cues.left(points, f"cells of {1e3 * cell:.2g} mm off planes")
    return points


def _flatness(points: np.ndarray, cell: float) -> np.ndarray:
    """Return (N,) the second over the first variance around each point: 0 on a line, 1 on a
    surface or in a lump."""
    import open3d as o3d

    cloud = _cloud(points)
    cloud.estimate_covariances(o3d.geometry.KDTreeSearchParamRadius(ROUND * cell))
    variance = np.linalg.eigvalsh(np.asarray(cloud.covariances))
    return variance[:, 1] / np.maximum(variance[:, 2], 1e-30)


def _thin(points: np.ndarray, cell: float, cues: Cues) -> np.ndarray:
    """Return points whose neighbourhood is a line."""
    flatness = _flatness(points, cell)
    thin = points[flatness < FLAT]
    cues.left(thin, f"on lines (flatness below {FLAT:g}; its median is {np.median(flatness):.2f})")
    return thin


def _clusters(points: np.ndarray, cell: float, cues: Cues) -> list[np.ndarray]:
    """Return clusters that are large enough for a piece of rope, by extent, the largest first."""
    label = np.asarray(_cloud(points).cluster_dbscan(eps=APART * cell, min_points=3))
    found = [points[label == k] for k in range(label.max() + 1)]
    large = [one for one in found if len(one) >= LEAST_CELLS]
    left = np.concatenate([np.zeros((0, 3)), *large])
    cues.left(left, f"in {len(large)} of {len(found)} clusters")
    return sorted(large, key=lambda one: -float(np.linalg.norm(np.ptp(one, axis=0))))


def _joined(clusters: list[np.ndarray], held: bool, length: float) -> list[np.ndarray]:
    """Return all clusters between known ends, else the longest with those that continue it."""
    if held:
        return clusters
    kept, rest = clusters[:1], clusters[1:]
    while rest:
        tree = KDTree(np.concatenate(kept))
        gaps = [float(np.min(tree.query(one)[0])) for one in rest]
        nearest = int(np.argmin(gaps))
        if gaps[nearest] > 0.1 * length:
            break
        kept.append(rest.pop(nearest))
    return kept
