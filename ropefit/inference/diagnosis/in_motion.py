"""Inertia, proposed wherever a recording shows motion.

A rope at rest that is fitted to one in motion ends up too stiff, the stiffer the faster it moves:
a rigid one leaves out what the ends do least badly. There no force shows, and the scan, which
looks at small changes of that fit, is blind to inertia. A full fit of both is not.
"""

from __future__ import annotations

import numpy as np

from ropefit.effects import Inertia
from ropefit.inference.diagnosis.contact import Start
from ropefit.inference.diagnosis.families import Family
from ropefit.inference.least_squares import Fit


def inertial(found: Fit) -> list[list[Start]]:
    """Starts of full fits, as of contact: the whole of the rope's inertia, if none acts yet."""
    setup = found.point.setup
    if setup.motion is None or any(t.name == Inertia.name for t in found.forward.terms):
        return []
    return [[(Family(Inertia(), np.zeros((1, 0))), np.ones(1))]]
