"""A model as it is without the frames that stand out.

What acts in some frames only (contact) distorts a fit to all of them: rope and calibration give
way, and then every frame is missed. Fitted to the other frames, the model shows where it acts.
"""

from __future__ import annotations

import numpy as np

from ropefit.diagnosis.coarse_mesh import on_coarse_mesh
from ropefit.diagnosis.inlier_frames import on_inlier_frames
from ropefit.effects.misfit import Push
from ropefit.inference.least_squares import Fit, attempted, by_parts

OUTSTANDING_SD = 3.0  # standard errors by which such a frame is worse than usual
MOST_DROPPED = 0.6  # of the frames
DISTORTED_SD = 6.0  # prior sd: a calibration error beyond stands for what the model lacks
ROUNDS, EVALUATIONS = 3, 8
PLACES = 31  # along the rope, at which a push is tried
WEAKEST_PUSH = 1e-3  # of the best: a direction in which the frame says nothing of a force


def distorted(smaller: Fit) -> bool:
    """Return whether a calibration error is too large to be one: it stands for missing physics."""
    return bool((np.abs(smaller.point.u) > DISTORTED_SD * smaller.prior.sd).any())


def excess(fitted: Fit) -> np.ndarray:
    """Return (F,) standard errors by which the frames' mean squares exceed the median one."""
    s, frames = fitted.stations, len(fitted.point.seen)
    square = (fitted.z.reshape(len(s.frame), -1) ** 2).mean(axis=1)
    count = np.bincount(s.frame, minlength=frames)
    mean = np.bincount(s.frame, square, frames) / np.maximum(count, 1)
    usual = float(np.median(mean[count > 0]))
    spread = np.sqrt(2 / np.maximum(count * s.residual.shape[1], 1))
    return np.where(count > 0, (mean / usual - 1) / spread, 0.0)


def calm(fitted: Fit) -> Fit:
    """Return the model, with all frames, as fitted to those that do not stand out; the fit itself
    where all are alike, and in motion, where what acts in one frame is seen in those after it."""
    if not fitted.forward.instantaneous:
        return fitted
    if fitted.calm is None:
        fitted.calm = _as_on_coarse_mesh(fitted) or _on_usual_frames(fitted)
    return fitted.calm


def _as_on_coarse_mesh(fitted: Fit) -> Fit | None:
    """Return the model with the values that it has on its coarser mesh; None where there is none,
    or it does not settle with them."""
    coarse = on_coarse_mesh(fitted)
    if coarse is fitted:
        return None
    found = calm(coarse)
    if found is coarse:
        return fitted
    states = found.point.solution.of_segments(fitted.forward.base.segments)
    forward = fitted.forward.starting_from(states)
    whole = attempted(forward, fitted.problem, found.point.u, 1, tolerance=1e-3)
    return whole if whole is not None and whole.point.converged.all() else None


def _on_usual_frames(fitted: Fit) -> Fit:
    """Return the model as fitted to the frames that do not stand out, or, where that is distorted,
    to those that it can explain."""
    found = _without_outstanding(fitted)
    inliers = on_inlier_frames(fitted) if distorted(found) else None
    return inliers or found


def _without_outstanding(fitted: Fit) -> Fit:
    now, before = fitted, None
    for _ in range(ROUNDS):
        far = excess(now)
        out = far > max(OUTSTANDING_SD, float(np.quantile(far, 1 - MOST_DROPPED)))
        if not out.any() or (before is not None and (out == before).all()):
            break
        before = out
        few = attempted(
            now.forward, fitted.problem.without(out), now.point.u, EVALUATIONS, tolerance=1e-3
        )
        if few is None:
            break
        whole = attempted(few.forward, fitted.problem, few.point.u, 1, tolerance=1e-3)
        if whole is None or not whole.point.converged.all():
            break
        now = whole
    return now


def pushes(fitted: Fit) -> list[Push]:
    """Return, of each frame that stands out, the force at one place that explains most of it, to
    first order; strongest evidence first."""
    s, point = fitted.stations, fitted.point
    outstanding = np.flatnonzero(excess(fitted) > OUTSTANDING_SD)
    if not len(outstanding):
        return []
    frames, nodes = point.seen.shape[:2]
    at = np.unique(np.linspace(2, nodes - 3, PLACES).astype(int))
    across = np.stack([_across(point.solution.x, node) for node in at])  # no friction
    load = np.zeros((frames, 2 * len(at), nodes, 3))
    for k, node in enumerate(at):
        load[:, 2 * k : 2 * k + 2, node] = across[k]
    columns = by_parts(fitted, point.by_loads(load.shape[1], load.__getitem__), load.shape[1])
    data = s.places(point.solution.x) + s.offset
    arc = point.setup.arc
    rows, out = np.repeat(s.frame, s.residual.shape[1]), []
    for t in outstanding:
        mine, best = rows == t, None
        for k, node in enumerate(at):
            one, z = columns[mine, 2 * k : 2 * k + 2], fitted.z[mine]
            force = np.linalg.lstsq(one, z, rcond=WEAKEST_PUSH**0.5)[0]
            gain = float(z @ one @ force)
            if best is None or gain > best[0]:
                best = gain, node, force @ across[k, t]
        assert best is not None
        gain, node, force = best
        of = np.flatnonzero(s.frame == t)
        near = of[np.abs(s.share[of] - arc[node] / arc[-1]).argmin()]
        out.append(Push(int(t), data[near], force, gain))
    return sorted(out, key=lambda push: -push.gain)


def _across(x: np.ndarray, node: int) -> np.ndarray:
    """Return (F, 2, 3) unit vectors across ropes x (F, N+1, 3) at a node."""
    along = x[:, node + 1] - x[:, node - 1]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    least = np.eye(3)[np.abs(along).argmin(axis=1)]
    first = np.cross(along, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(along, first)], axis=1)
