"""Fixed bodies that a rope in motion touches: `Moving.bodies`.

A step's own contact is in `solvers/dynamics/kernels/contact.py`.
"""

from __future__ import annotations

import numpy as np

from ropefit.rod.fields import NO_BODY, PLANE

TINY = 1e-16  # m²: keeps the distance from a bar's axis smooth


def pushed_out(bodies: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return nodes x (..., N+1, 3) [m] with those inside bodies (B, 8) on their surfaces, each
    along the normal of the body that it is deepest in; not the ends, which are held."""
    inside, out = _deepest(bodies, x), x.copy()
    for b, body in enumerate(bodies):
        mine = inside == b
        gap, normal = _distance(body, x[mine])
        out[mine] -= gap * normal
    return out


def change_pushed_out(
    bodies: np.ndarray, x: np.ndarray, dbodies: np.ndarray, dx: np.ndarray
) -> np.ndarray:
    """Return derivatives of `pushed_out` in P directions: dbodies (1, P, B, 8) and dx
    (C, P, N+1, 3), for nodes x (C, N+1, 3)."""
    inside, out = _deepest(bodies, x), np.moveaxis(dx, 1, 2).copy()  # (C, N+1, P, 3)
    for b, body in enumerate(bodies):
        mine = inside == b
        if not mine.any():
            continue
        gap, normal = (item[:, None] for item in _distance(body, x[mine]))
        change = dbodies[0, :, b]
        dgap, dnormal = _change_of_distance(body, x[mine][:, None], change, out[mine])
        out[mine] -= dgap * normal + gap * dnormal
    return np.moveaxis(out, 2, 1)


def _deepest(bodies: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return (..., N+1) which body each node is deepest in, -1 for none and for the ends."""
    deepest, out = np.zeros(x.shape[:-1]), np.full(x.shape[:-1], -1)
    for b, body in enumerate(bodies):
        if body[7] != NO_BODY:
            gap = _distance(body, x)[0][..., 0]
            out[gap < deepest] = b
            deepest = np.minimum(gap, deepest)
    out[..., [0, -1]] = -1
    return out


def _distance(body: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gap (..., 1) [m] from a body (8,) to places x (..., 3), and the normal there."""
    arm, way = x - body[:3], body[3:6]
    along = (arm * way).sum(-1, keepdims=True)
    if body[7] == PLANE:
        return along, np.broadcast_to(way, x.shape)
    across = arm - along * way
    far = np.sqrt((across**2).sum(-1, keepdims=True) + TINY)
    return far - body[6], across / far


def _change_of_distance(
    body: np.ndarray, x: np.ndarray, dbody: np.ndarray, dx: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return changes of the gap (M, P, 1) and of the normal (M, P, 3) when the body moves by
    dbody (P, 8) and places x (M, 1, 3) by dx (M, P, 3)."""
    arm, way = x - body[:3], body[3:6]
    darm, dway = dx - dbody[:, :3], dbody[:, 3:6]
    along = (arm * way).sum(-1, keepdims=True)
    dalong = (darm * way + arm * dway).sum(-1, keepdims=True)
    if body[7] == PLANE:
        return dalong, np.broadcast_to(dway, dx.shape)
    gap, normal = _distance(body, x)
    far = gap + body[6]
    dacross = darm - dalong * way - along * dway
    dfar = (normal * dacross).sum(-1, keepdims=True)
    return dfar - dbody[:, 6:7], (dacross - normal * dfar) / far
