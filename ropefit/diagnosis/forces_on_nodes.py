"""What forces on some of a rope's nodes would explain of what a fit leaves, to first order.

The responses to a unit force on every node are computed once; any field of force in space is then
a product with them. So thousands of fields are compared at the cost of none of their fits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.scan import Projection
from ropefit.inference.least_squares import Fit, by_parts
from ropefit.solvers.equilibrium.implicit import Directions, tangent

MOST_FRAMES = 16
NOTHING = 1e-12  # whitened change, squared: a force that changes no more explains nothing


class ForcesOnNodes:
    """Forces on nodes (L,) of a fitted rope at rest in F of its frames, evenly spaced; places
    (F, L, 3) [m]: where the data have these nodes. A force of place acts on the rope where it is,
    not where a fit has it."""

    def __init__(self, fitted: Fit, nodes: tuple[int, ...]) -> None:
        s, point = fitted.stations, fitted.point
        frames, every = point.seen.shape[:2]
        used = np.unique(np.linspace(0, frames - 1, min(frames, MOST_FRAMES)).round().astype(int))
        load = np.zeros((len(used), len(nodes), 3, every, 3))
        for k, node in enumerate(nodes):
            load[:, k, range(3), node, range(3)] = 1.0
        load = load.reshape(len(used), -1, every, 3)
        dx, _ = tangent(point.solution.frames(used), Directions(load=load))
        parts = iter([(used, np.moveaxis(np.nan_to_num(dx), 1, 0))])
        of = np.repeat(s.frame, s.residual.shape[1])
        mine = np.isin(of, used)
        columns = by_parts(fitted, parts, load.shape[1])[mine]
        self._rows = [of[mine] == t for t in used]
        self._columns = [columns[rows] for rows in self._rows]
        few = replace(fitted, jacobian=fitted.jacobian[mine], z=fitted.z[mine])
        self._project = Projection(few)
        share = (point.setup.arc / point.setup.arc[-1])[list(nodes)]
        self.places = np.nan_to_num(point.solution.x[np.ix_(used, np.array(nodes))])
        for place, t in zip(self.places, used, strict=True):
            at = np.flatnonzero(s.frame == t)
            if len(at):
                at = at[np.argsort(s.share[at])]
                offset = [np.interp(share, s.share[at], v) for v in s.offset[at].T]
                place += np.stack(offset, axis=-1)

    def gains(self, forces: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (Q,) by how many nats each of forces (Q, F, L, 3) [N] would lower the misfit, and
        (Q,) the multiple of it that does, of a size of at most `most`."""
        moved = np.empty((len(self._rows[0]), len(forces)))
        for t, (mine, columns) in enumerate(zip(self._rows, self._columns, strict=True)):
            moved[mine] = columns @ forces[:, t].reshape(len(forces), -1).T
        along = moved.T @ self._project.z
        square = (moved * self._project(moved)).sum(axis=0)
        multiple = np.clip(along / np.maximum(square, NOTHING), -most, most)
        return along * multiple - 0.5 * square * multiple**2, multiple
