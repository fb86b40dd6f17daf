"""Where is the gripper, or where must it go: the control point as the gradient variable, frame by
frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ropefit.inference import bfgs
from ropefit.inference.bfgs import Search
from ropefit.inference.sandwich import sandwich, slopes_of
from ropefit.losses.objectives import Objective, Scene
from ropefit.losses.primary import Observed, Residual, point_to_line
from ropefit.models.rope import Rope
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.runs.journal import journal
from ropefit.solvers.xpbd.reference import State

Compare = Callable[[Tensor, Tensor], list[Residual]]  # (x (b, K, 3), rows (b,)) -> residuals


@dataclass(frozen=True)
class Gripper:
    """F independent searches for the control point of `rope`, compared by `residuals`.

    eta (F, n). The unknowns of a frame are the move of the control point over `scale` [m], then
    (with `turns`) a rotation vector [rad] of the first segment's frame.
    """

    rope: Rope
    eta: Tensor
    residuals: Compare
    scale: float
    turns: bool

    @property
    def unknowns(self) -> int:
        return 6 if self.turns else 3

    def state(self, u: Tensor, rows: Tensor) -> State:
        """Return ropes of frames `rows` (b,) for unknowns u (..., b, 3 or 6)."""
        rope = self.rope.frames(rows.numpy())
        frame = None
        if self.turns:
            frame = multiply(from_rotation_vector(u[..., 3:]), rope.start.q[:, 0])
        return rope.settle(self.eta[rows], move=self.scale * u[..., :3], frame=frame)

    def loss(self, u: Tensor, rows: Tensor) -> Tensor:
        """Return (b,) loss [m]."""
        x = self.state(u, rows).x
        return torch.stack([term.loss() for term in self.residuals(x, rows)]).sum(0)

    def search(
        self,
        evaluations: int,
        report: Callable[[Search], None] | None = None,
        tolerance: float = 1e-5,
    ) -> Search:
        """Minimise every frame's loss by BFGS from its start, or from what the journal has kept."""
        start = torch.zeros(len(self.eta), self.unknowns, dtype=torch.float64)
        name, search = bfgs.resumed(lambda _: bfgs.begin(self.loss, start, reach=0.2))
        while search.running and search.evaluations < evaluations:
            bfgs.step(self.loss, search, tolerance=tolerance, largest=0.5)
            journal().keep(name, lambda: bfgs.kept(search))
            if report:
                report(search)
        bfgs.stop_at_limit(search)
        return search

    def position(self, u: Tensor) -> np.ndarray:
        """Return (F, 3) [m] control points."""
        start = self.rope.start.x[:, self.rope.control_node]
        return (start + self.scale * u[:, :3]).numpy()

    def orientation(self, u: Tensor) -> np.ndarray:
        """Return (F, 4) held frames of the first segment."""
        return multiply(from_rotation_vector(u[:, 3:]), self.rope.start.q[:, 0]).numpy()

    def position_sd(self, u: Tensor, clusters: int, floor: float) -> np.ndarray:
        """Return (F, 3) [m] standard deviation of the control point from the scatter of its frame's
        residuals.

        Points are grouped into `clusters` stretches, which count as independent. NaN where the
        data do not determine it.
        """
        n, step = self.unknowns, self.rope.step
        rows = torch.arange(len(u))
        moves = torch.zeros(2 * n + 1, 1, n, dtype=u.dtype)
        for k in range(n):
            moves[2 * k + 1, 0, k], moves[2 * k + 2, 0, k] = step, -step
        with torch.no_grad():
            terms = self.residuals(self.state(u + moves, rows).x, rows)
        out = np.full((len(u), 3), np.nan)
        for t in range(len(u)):
            vectors, cluster = [], []
            for number, term in enumerate(terms):
                mask = term.mask[t].numpy()
                vectors.append(term.vectors[:, t].numpy()[:, mask])
                place = np.arange(mask.sum()) * clusters // max(int(mask.sum()), 1)
                cluster.append(place + number * clusters)
            jacobian, base = slopes_of(vectors, step)
            if not np.isfinite(jacobian).all():
                continue
            found = sandwich(jacobian, base, np.concatenate(cluster), floor, dead_below=0.0)
            sd = found.sd[:3] * self.scale
            out[t] = np.where(np.isfinite(sd), sd, np.nan)
        return out


def to_observations(objective: Objective, scene: Scene) -> Compare:
    """Compare with what was observed in each frame."""
    return lambda x, rows: objective.residuals(x, scene.frames(rows))


def to_targets(arc: np.ndarray, points: np.ndarray, length: float) -> Compare:
    """Compare with target points (F, M, 3) [m] at arc lengths (F, M) [m].

    Points that are NaN do not count; where the arc length is NaN any place on the rope will do.
    """
    mask = torch.from_numpy(np.isfinite(points).all(axis=-1))
    goal = torch.from_numpy(np.nan_to_num(points))
    known = torch.from_numpy(np.isfinite(arc)) & mask
    share = torch.from_numpy(np.nan_to_num(arc) / length)

    def compare(x: Tensor, rows: Tensor) -> list[Residual]:
        at = interpolate(x, share[rows])
        loose = mask[rows] & ~known[rows]
        empty = torch.zeros_like(loose)
        data = Observed(goal[rows], loose, empty.long(), goal[rows], empty)
        return [Residual(goal[rows] - at, known[rows]), point_to_line(x, data)]

    return compare


def interpolate(x: Tensor, share: Tensor) -> Tensor:
    """Return (..., F, M, 3) points of ropes x (..., F, K, 3) at fractions (F, M) of their
    length."""
    place = (share * (x.shape[-2] - 1)).clamp(0, x.shape[-2] - 1)
    index = place.floor().clamp(max=x.shape[-2] - 2).long()
    rest = (place - index)[..., None]
    wide = index[..., None].expand(*x.shape[:-2], index.shape[-1], 3)
    return torch.gather(x, -2, wide) * (1 - rest) + torch.gather(x, -2, wide + 1) * rest
