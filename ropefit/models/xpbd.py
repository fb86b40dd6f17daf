"""The paper's simulation as a model: every frame iterated by Algorithm 1 from its catenary.

Its terms are the weights and whatever acts on what the algorithm knows of a setup: ends, clamps,
gravity, length, rest shape, sensor. Effects on rigidity or by forces leave it as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ropefit.models.algorithm import STEP, Algorithm
from ropefit.models.model import Model
from ropefit.models.response import Parts, Point
from ropefit.models.slopes import Change
from ropefit.rod.setup import Setup
from ropefit.runs.journal import Arrays
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.status import Status
from ropefit.solvers.xpbd.settings import Settings

if TYPE_CHECKING:
    from ropefit.models.xpbd_rope import XpbdRope


@dataclass
class XpbdPoint(Point):
    """A `Point` of the paper's simulation."""

    model: Xpbd

    def parts(
        self, changes: list[Change], turned: bool = False, nodes: np.ndarray | None = None
    ) -> Parts:
        moved = self.respond(changes)
        yield np.arange(len(self.seen)), moved if nodes is None else moved[:, :, nodes]

    def respond(self, changes: list[Change], turned: bool = False) -> np.ndarray:
        """Return (P, F, K, 3) first-order changes of the nodes as seen, zero in frames that
        diverge: by central differences of the iterations, which are no solution of equations whose
        derivative could be solved for."""
        out = np.zeros((len(changes), *self.seen.shape))
        for moved, changed in zip(out, changes, strict=True):
            low, high = (self.model.seen_of(changed(way * STEP)) for way in (-1, 1))
            moved += np.nan_to_num((high - low) / (2 * STEP))
        return out


@dataclass
class Xpbd(Model):
    """Frames by Algorithm 1. The weights are those of the setup; control_position (F, 3) [m] is
    needed where the gripper holds an inner particle."""

    algorithm: Algorithm = field(default=Algorithm("thomas", Settings()))
    control_position: np.ndarray | None = None

    def rope_at(self, setup: Setup) -> XpbdRope:
        """Return a setup's rope, ready to be simulated, in torch."""
        from ropefit.models.xpbd_rope import build_rope

        return build_rope(setup, self.algorithm, self.control_position)

    def at(self, u: np.ndarray, start: States | None = None) -> XpbdPoint:
        """Simulate at u. Frames that diverge are NaN in `seen`. It always sets out from the
        catenaries: the answer belongs to the number of iterations."""
        setup = self.setup_at(u)
        x, q = self._iterated(setup)
        frames, n = q.shape[:2]
        held = Conditions(setup.ends, setup.clamp)
        diverged = ~np.isfinite(x).all(axis=(1, 2))
        status = np.where(diverged, int(Status.NOT_FINITE), int(Status.CONVERGED))
        unknown = np.full((frames, held.supports), np.nan)  # no balance of forces: no reactions
        solution = Solution(
            q, x, x[:, 0], unknown, np.full((frames, n, 3), np.nan), status,
            np.full(frames, self.algorithm.settings.total), np.full(frames, np.nan), setup.rod(),
            held,
        )  # fmt: skip
        return XpbdPoint(u, setup, solution, setup.seen(x, q), self)

    def seen_of(self, setup: Setup) -> np.ndarray:
        """Return (F, K, 3) [m] where a setup's nodes are seen."""
        return setup.seen(*self._iterated(setup))

    def kept(self, point: Point) -> Arrays:
        """Return nothing: the iterations are run again, and take a second."""
        return {}

    def restored(self, u: np.ndarray, arrays: Arrays) -> XpbdPoint:
        return self.at(u)

    def _iterated(self, setup: Setup) -> tuple[np.ndarray, np.ndarray]:
        """Return x (F, K, 3) [m] and q (F, K-1, 4) of every frame, by its own weights."""
        assert setup.weights is not None
        weights = np.broadcast_to(setup.weights, (len(setup.ends), setup.weights.shape[-1]))
        return self.rope_at(setup).settle_all(weights)
