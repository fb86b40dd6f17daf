"""Fixed bodies that a rope in motion touches, as functions in torch: `Moving.bodies`.

A step's own contact is in `solvers/dynamics/kernels/contact.py`.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.fields import NO_BODY, PLANE

TINY = 1e-16  # m²: keeps the distance from a bar's axis smooth


def pushed_out(bodies: Tensor, x: Tensor) -> Tensor:
    """Return nodes x (..., N+1, 3) [m] with those inside bodies (B, 8) on their surfaces, each
    along the normal of the body that it is deepest in; not the ends, which are held."""
    deepest, out = torch.zeros_like(x[..., :1]), x
    for body in bodies:
        if float(body[7]) == NO_BODY:
            continue
        arm, way = x - body[:3], body[3:6]
        along = (arm * way).sum(-1, keepdim=True)
        if float(body[7]) == PLANE:
            gap, normal = along, way.expand_as(x)
        else:
            across = arm - along * way
            far = torch.sqrt((across**2).sum(-1, keepdim=True) + TINY)
            gap, normal = far - body[6], across / far
        deeper = gap < deepest
        out = torch.where(deeper, x - gap * normal, out)
        deepest = torch.where(deeper, gap, deepest)
    inner = torch.zeros(x.shape[-2], 1, dtype=torch.bool)
    inner[1:-1] = True
    return torch.where(inner, out, x)


def change_pushed_out(bodies: Tensor, x: Tensor, dbodies: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """Return derivatives of `pushed_out` in P directions: dbodies (1, P, B, 8) and dx
    (C, P, N+1, 3), for nodes x (C, N+1, 3)."""
    out = np.empty_like(dx)
    for p in range(dx.shape[1]):
        moved = torch.from_numpy(dbodies[0, p]), torch.from_numpy(np.ascontiguousarray(dx[:, p]))
        out[:, p] = torch.func.jvp(pushed_out, (bodies, x), moved)[1].numpy()
    return out
