"""First-order changes of friction along a walk, see `rod/friction.py`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.models.slopes import Change
from ropefit.rod import friction
from ropefit.rod.differences import DIFFERENCE_STEP, slope
from ropefit.rod.friction import Grip
from ropefit.rod.potential import Potential
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.potentials import force_and_stiffness


@dataclass(frozen=True)
class Rubbing:
    """One contact in H frames: stiffness (N+1,) [N/m] of the springs that hold the nodes; by_node
    and by_place (H, N+1, 3, 3): derivatives of where they are held once a frame has settled; missed
    (H, N+1, 3, 3) [N/m]: stiffness that the solver's supports have too much; of P changes, at nodes
    and places that stay: force, held (P, H, N+1, 3)."""

    stiffness: np.ndarray
    by_node: np.ndarray
    by_place: np.ndarray
    missed: np.ndarray
    force: np.ndarray
    held: np.ndarray

    def drawn(self, t: int, moved: np.ndarray) -> np.ndarray:
        """Return (P, N+1, 3) [N] further force in frame t where the places have moved so far."""
        place = np.einsum("nab,pnb->pna", self.by_place[t], moved)
        return self.force[:, t] + self.stiffness[:, None] * place

    def then(self, t: int, moved: np.ndarray, dx: np.ndarray) -> np.ndarray:
        """Return the places' moves after frame t, whose nodes move by dx (P, N+1, 3)."""
        place = np.einsum("nab,pnb->pna", self.by_place[t], moved)
        return place + np.einsum("nab,pnb->pna", self.by_node[t], dx) + self.held[:, t]


def loose(nodes: int) -> Grip:
    """Return the grip of a frame in which nothing is held."""
    return Grip(np.zeros((nodes, 3)), np.zeros(nodes, dtype=bool))


def rubbings(
    whole: Setup, changes: list[Change], grips: list[list[Grip]], x: np.ndarray
) -> list[Rubbing]:
    """Return for every contact with friction, for changes of the setup; grips of each frame, before
    it; x (H, N+1, 3) [m]."""
    rough = [k for k, p in enumerate(whole.potentials) if p.friction is not None]
    if not rough:
        return []
    sides = [(c(-DIFFERENCE_STEP).potentials, c(DIFFERENCE_STEP).potentials) for c in changes]
    out = []
    for number, k in enumerate(rough):
        grip = Grip(*(np.stack(f) for f in zip(*(g[number] for g in grips), strict=True)))
        out.append(_of(whole.potentials[k], grip, x, [(a[k], b[k]) for a, b in sides]))
    return out


def _of(
    contact: Potential, grip: Grip, x: np.ndarray, sides: list[tuple[Potential, Potential]]
) -> Rubbing:
    assert contact.hardness is not None
    assert contact.rubbing is not None
    stiffness = contact.hardness * contact.rubbing
    by_node, by_place = friction.slopes(contact, grip, x)
    _, supports = force_and_stiffness((friction.potential(contact, grip),), x)
    # dragged moves with a node that nothing holds: no force changes there.
    true = stiffness[:, None, None] * (np.eye(3) - by_node)
    force, held = [], []
    for a, b in sides:
        same = np.array_equal(a.energy(x), b.energy(x)) and a.friction == b.friction
        for into, law in ((force, friction.force), (held, friction.dragged)):
            low, high = (law(p, grip, x) for p in (a, b))
            into.append(np.zeros(x.shape) if same else slope(low, high))
    return Rubbing(stiffness, by_node, by_place, supports - true, np.stack(force), np.stack(held))
