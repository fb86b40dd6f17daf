"""Where fits of a force of place begin: its shapes compared to first order, then refined.

Sign and size of the best multiple of every shape follow from the data. A shape that moves the rope
as the data ask is not always one that points as the misfit does: a push here bends the rope there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ropefit.effects.force_in_space import Field, lumped
from ropefit.effects.misfit import Misfit

AT_ONCE = 128  # shapes that are scored: each has a response of all stations
REFINED = 6  # shapes, the best that differ
ROUNDS, TRIALS = 5, 32  # of each, drawn about the best so far
NARROWER = 0.6  # from round to round
SHARES = (1.0, 0.4, 0.15)  # of the best multiple, until every frame settles


def best_shapes(
    misfit: Misfit,
    shapes: np.ndarray,
    field: Callable[[np.ndarray], Field],
    widths: np.ndarray,
    alike: Callable[[np.ndarray, np.ndarray], bool],
    count: int,
    most: float,
) -> list[tuple[float, np.ndarray]]:
    """Return the multiples [N/m] and shapes (n,) of the fields that explain most, best first, of a
    size of at most `most`.

    shapes (Q, n): tried first; field(shapes (q, n)): the fields of unit size with these shapes;
    widths (n,): by how much shapes are varied to refine them; alike(a, b): whether two are one.
    """
    share = lumped(misfit.setup.arc)
    nodes = np.flatnonzero(share)
    forces = misfit.forces(tuple(nodes.tolist()))

    def scored(some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts = []
        for part in np.array_split(some, len(some) // AT_ONCE + 1):
            push = field(part).force_at(forces.places) * share[nodes, None]
            parts.append(forces.gains(push, most))
        gains, multiples = (np.concatenate(v) for v in zip(*parts, strict=True))
        return gains, multiples

    best = _different(shapes[np.argsort(-scored(shapes)[0], kind="stable")], alike, REFINED)
    gains, rng = np.empty(0), np.random.default_rng(0)
    for k in range(ROUNDS):
        steps = rng.normal(size=(TRIALS, *best.shape)) * widths * NARROWER**k
        steps[0] = 0.0
        tried = best + steps
        gains = scored(tried.reshape(-1, best.shape[1]))[0].reshape(TRIALS, -1)
        best = tried[gains.argmax(axis=0), np.arange(len(best))]
    found = _different(best[np.argsort(-gains.max(axis=0), kind="stable")], alike, count)
    return list(zip(scored(found)[1].tolist(), found, strict=True))


def _different(
    shapes: np.ndarray, alike: Callable[[np.ndarray, np.ndarray], bool], count: int
) -> np.ndarray:
    """Return (at most count, n) the first of shapes (Q, n) that are not like one before them."""
    out: list[np.ndarray] = []
    for shape in shapes:
        if not any(alike(shape, other) for other in out):
            out.append(shape)
        if len(out) == count:
            break
    return np.stack(out)
