"""Minimise many small independent problems at once: batched BFGS with a backtracking line search.

The rows of a batch (frames, or groups of frames) share every simulation but nothing else: each has
its own curvature estimate, step and end. A row that blows up (NaN, infinity) only shortens its own
step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ropefit.runs.journal import Arrays, journal

Function = Callable[[Tensor, Tensor], Tensor]  # (u (b, n), rows (b,)) -> losses (b,)

ACTIVE, SMALL_GRADIENT, NO_DECREASE, NO_DIRECTION, DIVERGED, LIMIT = range(6)
REASONS = {
    ACTIVE: "still running",
    SMALL_GRADIENT: "gradient is small",
    NO_DECREASE: "loss no longer decreases",
    NO_DIRECTION: "no direction decreases the loss",
    DIVERGED: "the start itself gives no finite loss",
    LIMIT: "evaluation limit reached",
}
CONVERGED = (SMALL_GRADIENT, NO_DECREASE, NO_DIRECTION)
POLL = 1e-3  # in units of u: how far a stuck row looks around


@dataclass
class Search:
    """Everything a search knows; saving and restoring it resumes the search exactly.

    u (B, n), loss (B,), gradient (B, n), inverse Hessian (B, n, n), status (B,), calm (B,)
    iterations in a row without a worthwhile decrease, trace: losses (B,) after every
    step.
    """

    u: Tensor
    loss: Tensor
    gradient: Tensor
    inverse: Tensor
    status: Tensor
    calm: Tensor
    evaluations: int = 0
    trace: list[Tensor] = field(default_factory=list)

    def rows(self, index: Tensor) -> Search:
        """Return the same search, some of its rows only."""
        return Search(
            self.u[index],
            self.loss[index],
            self.gradient[index],
            self.inverse[index],
            self.status[index],
            self.calm[index],
            self.evaluations,
            [item[index] for item in self.trace],
        )

    @property
    def running(self) -> bool:
        return bool((self.status == ACTIVE).any())

    @property
    def converged(self) -> Tensor:
        """Return (B,) bool."""
        return torch.isin(self.status, torch.tensor(CONVERGED))


ARRAYS = ("u", "loss", "gradient", "inverse", "status", "calm")


def kept(search: Search) -> Arrays:
    """Return a search as arrays."""
    found = {name: getattr(search, name).detach().numpy() for name in ARRAYS}
    trace = torch.stack(search.trace).numpy()
    return {**found, "trace": trace, "evaluations": np.array(search.evaluations)}


def resumed(start: Callable[[str], Search]) -> tuple[str, Search]:
    """Return the name of the next search in the journal, and what was kept of it; else what `start`
    gives for that name."""
    name = journal().next("search")
    known = journal().recall(name)
    return name, restored(known) if known else start(name)


def restored(arrays: Arrays) -> Search:
    """Return the search that was kept."""
    rows = {name: torch.from_numpy(arrays[name].copy()) for name in ARRAYS}
    trace = list(torch.from_numpy(arrays["trace"].copy()))
    return Search(**rows, evaluations=int(arrays["evaluations"]), trace=trace)


def begin(function: Function, u: Tensor, reach: float = 0.1) -> Search:
    """Evaluate the start u (B, n); the first step has length `reach` in the units of u."""
    loss, gradient = _evaluate(function, u, torch.arange(len(u)))
    size = gradient.norm(dim=1).clamp_min(1e-300)
    eye = torch.eye(u.shape[1], dtype=u.dtype).expand(len(u), -1, -1)
    status = torch.where(torch.isfinite(loss), ACTIVE, DIVERGED)
    status = torch.where((status == ACTIVE) & (size < 1e-280), SMALL_GRADIENT, status)
    return Search(
        u=u.clone(),
        loss=loss,
        gradient=gradient,
        inverse=(reach / size)[:, None, None] * eye,
        status=status,
        calm=torch.zeros(len(u), dtype=torch.int64),
        evaluations=1,
        trace=[loss.clone()],
    )


def step(
    function: Function,
    search: Search,
    tolerance: float = 1e-5,
    patience: int = 2,
    halvings: int = 10,
    largest: float = 1.0,
) -> None:
    """Take one BFGS iteration of every running row, in place.

    A row ends when its relative decrease stays under `tolerance` for `patience` iterations running,
    or when no step along the negative gradient helps. No component of u moves more than `largest`.
    """
    rows = torch.nonzero(search.status == ACTIVE)[:, 0]
    u, loss, gradient = search.u[rows], search.loss[rows], search.gradient[rows]
    direction = -(search.inverse[rows] @ gradient[..., None])[..., 0]
    slope = (direction * gradient).sum(1)
    uphill = ~(slope < 0)
    size = gradient.norm(dim=1, keepdim=True).clamp_min(1e-300)
    direction = torch.where(uphill[:, None], -0.1 * gradient / size, direction)
    direction = direction / (direction.abs().amax(1, keepdim=True) / largest).clamp_min(1.0)
    slope = (direction * gradient).sum(1)

    length = torch.ones_like(loss)
    new_u, new_loss, new_gradient = u.clone(), loss.clone(), gradient.clone()
    pending = torch.arange(len(rows))
    for _ in range(halvings):
        trial = u[pending] + length[pending, None] * direction[pending]
        value, slopes = _evaluate(function, trial, rows[pending])
        search.evaluations += 1
        enough = value <= loss[pending] + 1e-4 * length[pending] * slope[pending]
        good = pending[enough]
        new_u[good], new_loss[good], new_gradient[good] = (
            trial[enough],
            value[enough],
            slopes[enough],
        )
        pending = pending[~enough]
        if len(pending) == 0:
            break
        # Interpolate the parabola through loss, slope and trial; within [0.1, 0.5] of the last
        # step.
        fall = value[~enough] - loss[pending] - length[pending] * slope[pending]
        best = -slope[pending] * length[pending] / (2 * fall).clamp_min(1e-300)
        factor = torch.where(torch.isfinite(fall), best, 0.1).nan_to_num(0.1).clamp(0.1, 0.5)
        length[pending] = length[pending] * factor

    stuck = torch.zeros(len(rows), dtype=torch.bool)
    stuck[pending] = True
    s, y = new_u - u, new_gradient - gradient
    search.inverse[rows] = _update(search.inverse[rows], s, y)
    little = (loss - new_loss) <= tolerance * loss.abs()
    calm = torch.where(little, search.calm[rows] + 1, torch.zeros_like(search.calm[rows]))
    small = (new_gradient.abs().amax(1) * 1e3) <= tolerance * new_loss.abs()
    status = torch.full_like(calm, ACTIVE)
    status = torch.where(calm >= patience, NO_DECREASE, status)
    status = torch.where(small, SMALL_GRADIENT, status)
    search.u[rows], search.loss[rows], search.gradient[rows] = new_u, new_loss, new_gradient
    search.status[rows], search.calm[rows] = status, calm
    if stuck.any():
        _look_around(function, search, rows[stuck], tolerance)
    search.trace.append(search.loss.clone())


def _look_around(function: Function, search: Search, rows: Tensor, tolerance: float) -> None:
    """Try each coordinate, up and down, for rows on which no step along the gradient helped.

    A sum of norms has its minimum at a kink more often than not, where no gradient vanishes. If no
    neighbour is better the row has arrived; else it goes on from the best one, curvature forgotten.
    """
    n = search.u.shape[1]
    moves = POLL * torch.cat([torch.eye(n), -torch.eye(n)]).to(search.u)
    trials = search.u[rows, None, :] + moves
    with torch.no_grad():
        losses = [function(trials[:, k], rows).nan_to_num(torch.inf) for k in range(2 * n)]
    search.evaluations += 2  # about what 2 n results without gradients cost
    value, best = torch.stack(losses, dim=1).min(dim=1)
    better = value < search.loss[rows] * (1 - tolerance)
    search.status[rows[~better]] = NO_DIRECTION
    if not better.any():
        return
    moved = rows[better]
    u = trials[better, best[better]]
    search.u[moved] = u
    search.loss[moved], search.gradient[moved] = _evaluate(function, u, moved)
    size = search.gradient[moved].norm(dim=1).clamp_min(1e-300)
    search.inverse[moved] = (10 * POLL / size)[:, None, None] * torch.eye(n, dtype=u.dtype)
    search.status[moved], search.calm[moved] = ACTIVE, 0


def stop_at_limit(search: Search) -> None:
    """Mark rows that still run: they did not converge."""
    search.status = torch.where(search.status == ACTIVE, LIMIT, search.status)


def _evaluate(function: Function, u: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
    u = u.detach().requires_grad_()
    loss = function(u, rows)
    finite = torch.isfinite(loss)
    if not finite.any():
        return torch.full_like(loss.detach(), torch.inf), torch.zeros_like(u.detach())
    (gradient,) = torch.autograd.grad(torch.where(finite, loss, 0.0).sum(), u)
    usable = finite & torch.isfinite(gradient).all(1)
    loss = torch.where(usable, loss.detach(), torch.inf)
    return loss, torch.where(usable[:, None], gradient, 0.0)


def _update(inverse: Tensor, s: Tensor, y: Tensor) -> Tensor:
    """Return BFGS update of the inverse Hessian (b, n, n) where the curvature s·y is safely
    positive."""
    curvature = (s * y).sum(1)
    good = curvature > 1e-8 * s.norm(dim=1) * y.norm(dim=1)
    rho = torch.where(good, 1.0 / torch.where(good, curvature, 1.0), 0.0)[:, None, None]
    # Before the first update, scale the guess by the curvature just seen.
    eye = torch.eye(s.shape[1], dtype=s.dtype)
    left = eye - rho * s[:, :, None] * y[:, None, :]
    updated = left @ inverse @ left.transpose(1, 2) + rho * s[:, :, None] * s[:, None, :]
    return torch.where(good[:, None, None], updated, inverse)
