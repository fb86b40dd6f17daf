"""Algorithm 1 of the paper in plain torch: all frames at once, no loop over particles, autograd
through the iterations. It shares no code with ropefit, which must agree with it.
"""

from __future__ import annotations

import torch
from torch import Tensor

RIDGE = 1e-6  # on the tridiagonal system, which a taut rope makes singular


def settle(
    x: Tensor,
    q: Tensor,
    length: Tensor,
    gravity: Tensor,
    eta: list[Tensor],
    steps: int,
    iterations: int,
    thomas: bool,
    dt: float = 0.1,
) -> tuple[Tensor, Tensor]:
    """Return x (F, K, 3) [m] with both ends held and q (F, K-1, 4) after steps x iterations.

    length (K-1,) [m]; gravity (3,) [m/s²]; eta: gravity, distance, shear in x and in q, bend, sor.
    Unit masses, hard constraints, a straight rest shape.
    """
    by_gravity, by_distance, shear_x, shear_q, bend, sor = eta
    nodes = x.shape[1]
    free = torch.ones(nodes, 1, dtype=x.dtype)
    free[0] = free[-1] = 0.0
    weight = free[1:, 0] + free[:-1, 0]
    mean = free / 2  # an inner particle is touched by two constraints
    touching = torch.full((nodes - 1, 1), 0.5, dtype=x.dtype)
    touching[0] = touching[-1] = 1.0
    unit = length[:, None]
    stiffness = weight[:, None] / unit**2 + 4
    fall = free * gravity * (0.5 * dt**2) * by_gravity
    for _ in range(steps):
        x = x + fall
        for _ in range(iterations):
            edge = x[:, 1:] - x[:, :-1]
            w, a, b, c = q.unbind(-1)
            # Derivative of the third director in q; the director is half of it times q.
            rows = torch.stack(
                [
                    2 * torch.stack([b, c, w, a], -1),
                    2 * torch.stack([-a, -w, c, b], -1),
                    2 * torch.stack([w, -a, -b, c], -1),
                ],
                -2,
            )
            director = 0.5 * (rows * q[:, :, None]).sum(-1)
            shear = -(edge / unit - director) / stiffness
            pull = shear / unit
            moved = torch.nn.functional.pad(-pull, (0, 0, 0, 1)) + torch.nn.functional.pad(
                pull, (0, 0, 1, 0)
            )
            turned = -(shear[..., None] * rows).sum(-2)

            first, second = q[:, :-1], q[:, 1:]
            strain = _imaginary(first, second)
            change = -0.5 * strain
            by_first, by_second = _back(change, first, second)
            bent = torch.nn.functional.pad(by_first, (0, 0, 0, 1)) + torch.nn.functional.pad(
                by_second, (0, 0, 1, 0)
            )

            norm = torch.sqrt((edge * edge).sum(-1) + 1e-24)
            along = edge / norm[..., None]
            gap = norm - length
            if thomas:
                cosine = (along[:, 1:] * along[:, :-1]).sum(-1)
                matrix = torch.diag_embed(-cosine, 1) + torch.diag_embed(-cosine, -1)
                matrix = matrix + torch.diag(weight * (1 + RIDGE) + RIDGE)
                step = -torch.linalg.solve(matrix, gap[..., None])
            else:
                step = -(gap / weight)[..., None]
            impulse = step * along
            shift = torch.nn.functional.pad(-impulse, (0, 0, 0, 1)) + torch.nn.functional.pad(
                impulse, (0, 0, 1, 0)
            )
            share = free if thomas else mean
            x = x + 0.5 * sor * (shear_x * mean * moved + by_distance * share * shift)
            q = q + 0.5 * sor * (shear_q * turned + bend * touching * bent)
            q = q / q.norm(dim=-1, keepdim=True)
    return x, q


def _imaginary(p: Tensor, q: Tensor) -> Tensor:
    """Return the vector part of p* q."""
    a, u = p[..., :1], p[..., 1:]
    b, v = q[..., :1], q[..., 1:]
    return a * v - b * u - torch.linalg.cross(u, v)


def _back(change: Tensor, p: Tensor, q: Tensor) -> tuple[Tensor, Tensor]:
    """Return the derivatives of change · Im(p* q) with respect to p and q."""
    a, u = p[..., :1], p[..., 1:]
    b, v = q[..., :1], q[..., 1:]
    by_p = torch.cat(
        [(change * v).sum(-1, keepdim=True), -b * change - torch.linalg.cross(v, change)], -1
    )
    by_q = torch.cat(
        [-(change * u).sum(-1, keepdim=True), a * change - torch.linalg.cross(change, u)], -1
    )
    return by_p, by_q
