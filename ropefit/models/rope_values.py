"""The values of a uniform rope: what searches by a loss are over, and what every fit at rest
states."""

from __future__ import annotations

from ropefit.rod.setup import Setup

NAMES = ("EI", "GJ", "EA", "length")


def rope_values(setup: Setup) -> dict[str, float]:
    """Return the values of NAMES in SI of a setup; EA is infinite where the rope does not
    stretch."""
    p = setup.properties
    values = (p.bend[0], p.twist[0], p.axial[0], p.length.sum())
    return {name: float(value) for name, value in zip(NAMES, values, strict=True)}
