"""Algorithm 1 in compiled code, on arrays.

A rope of a batch does not see the others, so each runs through all its iterations alone, in memory
that fits the first cache; the derivative is the exact adjoint of the iterations, see `kernels/`.
"""

from __future__ import annotations

import math

import numpy as np

from ropefit.rod.strains import TINY
from ropefit.solvers.arrays import in_threads
from ropefit.solvers.shapes import check_shapes
from ropefit.solvers.xpbd.kernels import tables
from ropefit.solvers.xpbd.kernels.entries import pull_ropes, run_ropes
from ropefit.solvers.xpbd.settings import RIDGE, Settings

COMPILED = ("jacobi", "thomas")
# Iterations that the derivative records at once; longer runs are recorded in blocks of √n, which
# costs one more run. 5000 iterations of 40 particles are 35 MB, per thread.
LONGEST_RECORD = 5000

Constants = tuple[np.ndarray, tables.Options]


def constants(
    length: np.ndarray,
    darboux: np.ndarray,
    weight: np.ndarray,
    weight_q: np.ndarray,
    solver: str,
    gravity: np.ndarray,
    settings: Settings,
) -> Constants:
    """Return the constants of the compiled loops: (K, ROD_COLUMNS), and the scalars.

    Of K particles: rest length (K-1,) [m] and rest Darboux quaternions darboux (K-2, 4); inverse
    masses weight (K,), weight_q (K-1,), zero where held; gravity (3,) [m/s²]. Raises ValueError for
    a solver that is not compiled.
    """
    if solver not in COMPILED:
        raise ValueError(f"no compiled version of the solver {solver!r}")
    thomas = solver == "thomas"
    weight_sum = weight[1:] + weight[:-1]
    shear = weight_sum / length**2 + 4 * weight_q + settings.alpha_shear
    bend = weight_q[1:] + weight_q[:-1] + settings.alpha_bend
    distance = weight_sum + settings.alpha_distance
    fall = 0.5 * settings.dt**2 * gravity

    nodes = len(weight)
    rod = np.zeros((nodes, tables.ROD_COLUMNS))
    rod[:-1, tables.LENGTH] = length
    rod[:, tables.WEIGHT] = weight
    rod[:, tables.SHARE] = weight / _touching(nodes)
    rod[:, tables.SHARE_D] = weight if thomas else weight / _touching(nodes)
    rod[:-1, tables.WEIGHT_Q] = weight_q
    rod[:-1, tables.SHARE_Q] = weight_q / _touching(nodes - 1)
    rod[:-1, tables.DIAGONAL] = (
        distance * (1 + RIDGE) + RIDGE if thomas else np.maximum(distance, 1e-30)
    )
    rod[:-1, tables.INVERSE_SHEAR] = 1 / np.maximum(shear, 1e-30)
    rod[:-2, tables.INVERSE_BEND] = 1 / np.maximum(bend, 1e-30)
    rod[:, tables.FALL : tables.FALL + 3] = np.where(weight[:, None] > 0, fall, 0.0)
    rod[:-2, tables.DARBOUX : tables.DARBOUX + 4] = darboux
    options = tables.Options(
        alpha_shear=float(settings.alpha_shear),
        alpha_bend=float(settings.alpha_bend),
        alpha_distance=float(settings.alpha_distance),
        tiny=TINY,
        thomas=thomas,
        iterations=settings.iterations,
        total=settings.total,
    )
    return rod, options


def run(
    x: np.ndarray, q: np.ndarray, gravity: np.ndarray, eta: np.ndarray, known: Constants
) -> tuple[np.ndarray, np.ndarray]:
    """Return x (B, K, 3) [m] and q (B, K-1, 4) of B ropes after all iterations from x and q.

    gravity (B, K), eta (B, 5): their weights. A rope that blows up, or whose distance system is not
    positive definite, is NaN; the other ropes do not notice. Raises ShapeError.
    """
    rod, options = known
    state = _packed(x, q)
    _check(state, gravity, eta, rod)

    def work(mine: slice) -> None:
        run_ropes(state[mine], gravity[mine], eta[mine], rod, options)

    in_threads(work, len(state), fewest=1)
    return _unpacked(state)


def pull(
    x: np.ndarray, q: np.ndarray, gravity: np.ndarray, eta: np.ndarray, known: Constants,
    gx: np.ndarray, gq: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return the gradients in what `run` was given, of x to eta, from those in what it returned."""
    rod, options = known
    total = options.total
    block = total if total <= LONGEST_RECORD else math.isqrt(total - 1) + 1
    state, out = _packed(x, q), _packed(gx, gq)
    g_gravity, g_eta = np.zeros_like(gravity), np.zeros_like(eta)

    def work(mine: slice) -> None:
        pull_ropes(
            state[mine], gravity[mine], eta[mine], rod, options, block,
            out[mine], g_gravity[mine], g_eta[mine],
        )  # fmt: skip

    in_threads(work, len(state), fewest=1)
    return *_unpacked(out), g_gravity, g_eta


def _touching(n: int) -> np.ndarray:
    """Return (n,) how many of the n-1 links of a chain touch each of its n items."""
    links = np.full(n, 2.0)
    links[0] = links[-1] = 1.0
    return links


def _packed(x: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (B, K, STATE_COLUMNS) of x (B, K, 3) and q (B, K-1, 4), the multipliers zero."""
    state = np.zeros((*x.shape[:-1], tables.STATE_COLUMNS))
    state[:, :, tables.X : tables.X + 3] = x
    state[:, :-1, tables.Q : tables.Q + 4] = q
    return state


def _unpacked(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = state[:, :, tables.X : tables.X + 3]
    q = state[:, :-1, tables.Q : tables.Q + 4]
    return x.copy(), q.copy()


def _check(state: np.ndarray, gravity: np.ndarray, eta: np.ndarray, rod: np.ndarray) -> None:
    """Check what the compiled loops are given, once a call. Raises ShapeError."""
    ropes, nodes = len(state), len(rod)
    check_shapes(
        state=(state, (ropes, nodes, tables.STATE_COLUMNS)),
        gravity=(gravity, (ropes, nodes)),
        eta=(eta, (ropes, 5)),
        rod=(rod, (nodes, tables.ROD_COLUMNS)),
    )
