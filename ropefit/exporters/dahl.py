"""Friction of bending as Dahl's law has it, in Newton and Isaac Lab."""

from __future__ import annotations

import numpy as np

from ropefit.attachments import BendingFriction
from ropefit.exporters.description import RopeDescription


def dahl(rope: RopeDescription, bend: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the largest strain and the decay (J,), (J,) [rad] at J joints, zero without friction.

    bend (J,) [N m/rad]: their stiffness; reach (J,) [m]: of rope that bends there. Of friction that
    slips (Prandtl) the range is the decay: a cycle of curvature ± A then loses 4 moment (A - range
    tanh(A / range)) a length, beside 4 moment (A - range): 4 % more at A = 2 range. What builds up
    exponentially is Dahl's own.
    """
    found = [e for e in rope.effects if isinstance(e, BendingFriction)]
    moment = sum(e.moment for e in found)
    span = max((e.range for e in found), default=0.0)
    return moment / bend, span * reach
