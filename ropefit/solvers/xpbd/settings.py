"""Settings of Algorithm 1, without its code."""

from __future__ import annotations

from dataclasses import dataclass

# Relative to the diagonal. A taut straight rope held at both ends has one multiplier too many (its
# tension moves nothing): without a ridge rounding would be amplified without bound. It slows the
# convergence of the others by a factor of 1e-6 an iteration, which is nothing.
RIDGE = 1e-6


@dataclass(frozen=True)
class Settings:
    """steps x iterations, the time step [s] of the gravity prediction, and compliances.

    Compliances are those of eq. (3), in the units of the projected system: dimensionless strains
    with unit weights for shear and bend, m² for the distance. 0 (the default) is a hard constraint.
    """

    steps: int = 50
    iterations: int = 20
    dt: float = 0.1
    alpha_shear: float = 0.0
    alpha_bend: float = 0.0
    alpha_distance: float = 0.0

    @property
    def total(self) -> int:
        return self.steps * self.iterations
