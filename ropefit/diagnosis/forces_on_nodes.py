"""What forces on some of a rope's nodes would explain of what a fit leaves, to first order.

The responses to a unit force on every node are computed once; any field of force in space is then
a product with them. So thousands of fields are compared at the cost of none of their fits.
"""

from __future__ import annotations

import numpy as np

from ropefit.diagnosis.scan import Projection
from ropefit.diagnosis.sensitivities import loads_to_nodes
from ropefit.inference.least_squares import Fit, sensitivity

NOTHING = 1e-12  # whitened change, squared: a force that changes no more explains nothing


class ForcesOnNodes:
    """Forces on nodes (L,) of a fitted rope at rest; places (F, L, 3) [m]: where the data have
    these nodes. A force of place acts on the rope where it is, not where a fit has it."""

    def __init__(self, fitted: Fit, nodes: tuple[int, ...]) -> None:
        s, point = fitted.stations, fitted.point
        frames, every = point.seen.shape[:2]
        load = np.zeros((frames, len(nodes), 3, every, 3))
        for k, node in enumerate(nodes):
            load[:, k, range(3), node, range(3)] = 1.0
        moved = np.nan_to_num(loads_to_nodes(point, load.reshape(frames, -1, every, 3)))
        columns = sensitivity(moved, s, s, fitted.whitener)
        of = np.repeat(s.frame, s.residual.shape[1])
        self._rows = [of == t for t in range(frames)]
        self._columns = [columns[mine] for mine in self._rows]
        self._project = Projection(fitted)
        arc = point.setup.arc.detach().numpy()
        at = np.array(nodes)
        self.places = np.nan_to_num(point.solution.x[:, at])
        for t in np.unique(s.frame):
            mine = np.flatnonzero(s.frame == t)
            mine = mine[np.argsort(s.share[mine])]
            for axis in range(3):
                self.places[t, :, axis] += np.interp(
                    arc[at] / arc[-1], s.share[mine], s.offset[mine, axis]
                )

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
