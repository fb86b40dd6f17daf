"""An axial strain that is a nonlinear function of tension, in place of Hooke's n / EA.

The strain is what it would be in a linear rope times a factor, see
`solvers/equilibrium/kernels/axial.py`.
"""

from __future__ import annotations

import numpy as np

from ropefit.rod.fields import PER_OCTAVE, TENSION_OCTAVES

OCTAVES = np.arange(TENSION_OCTAVES[0], TENSION_OCTAVES[1] + 1 / PER_OCTAVE, 1 / PER_OCTAVE)
TENSIONS = 2.0**OCTAVES  # [N]: at these the factor is given


def at_tension(axial: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """Return the logarithm of the factor, or what is linear in it, at tensions (...) [N], by its
    values at TENSIONS."""
    octave = np.log2(np.maximum(np.abs(tension), float(TENSIONS[0])))
    return np.interp(octave, OCTAVES, axial)
