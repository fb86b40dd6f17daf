"""The paper's simulation from observations, and as model.h5 has it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ropefit.adapters.rope_setup import setup_of
from ropefit.adapters.scene import control_positions
from ropefit.artifacts import FittedModel, Observations
from ropefit.models.algorithm import Algorithm
from ropefit.models.xpbd import Xpbd
from ropefit.solvers.xpbd.settings import Settings

if TYPE_CHECKING:
    from ropefit.models.xpbd_rope import XpbdRope


def xpbd_of(o: Observations, algorithm: Algorithm, weights: np.ndarray) -> Xpbd:
    """Return the model of all frames with weights (n,) or (F, n), ends where the observations have
    them."""
    setup = setup_of(o, len(o.node_arc) - 1)._replace(weights=weights)
    return Xpbd(
        setup, [], algorithm=algorithm,
        control_position=control_positions(o, algorithm.control_node),
    )  # fmt: skip


def restored_xpbd(o: Observations, model: FittedModel) -> Xpbd:
    """Return the model as it was fitted."""
    return xpbd_of(o, algorithm_of(model), _weights(o, model))


def moved_rope(
    o: Observations, model: FittedModel, position: np.ndarray, hold_frame: bool
) -> tuple[XpbdRope, np.ndarray]:
    """Return the fitted rope with its control point at `position` (F, 3) [m], and the weights
    (F, n); hold_frame: see `build_rope`."""
    from ropefit.models.xpbd_rope import build_rope

    fitted = restored_xpbd(o, model)
    assert fitted.base.weights is not None
    setup, node = fitted.base, model.control_node
    if node in (0, setup.segments):
        ends = setup.ends.copy()
        ends[:, 0 if node == 0 else 1] = position
        setup = setup._replace(ends=ends)
    return build_rope(setup, fitted.algorithm, position, hold_frame), fitted.base.weights


def algorithm_of(model: FittedModel) -> Algorithm:
    """Return how Algorithm 1 was run for a fit."""
    it = model.iterated
    assert it is not None
    settings = Settings(it.steps, it.iterations, it.dt, *it.compliance)
    return Algorithm(model.solver, settings, model.control_node, model.two_sided)


def _weights(o: Observations, model: FittedModel) -> np.ndarray:
    """Return (F, n) the weights of each frame's group."""
    names = algorithm_of(model).names
    eta = np.full((len(o.frames), len(names)), np.nan)
    for group in model.groups.values():
        rows = np.isin(o.frames, group.frames)
        eta[rows] = [group.parameters[name].value for name in names]
    return eta
