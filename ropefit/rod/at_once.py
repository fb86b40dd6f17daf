"""The rods of many setups of one rope, built at once: by numpy that costs hardly more than one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ropefit.rod.bending import Bending
from ropefit.rod.rod import Properties, Rod
from ropefit.rod.setup import Setup

BUILT_FROM = ("moment", "clamp_compliance", "kinks", "stretch")  # besides the properties


def rods(setups: Sequence[Setup]) -> Rod:
    """Return what `Setup.rod` returns, of one or more setups that differ in values only, each in a
    row of its own; without loads."""
    properties = Properties(*map(np.stack, zip(*(s.properties for s in setups), strict=True)))
    fields = {name: np.stack([getattr(s, name) for s in setups]) for name in BUILT_FROM}
    unloaded = {"mass": np.zeros(1), "load": np.zeros(3), "gravity": np.zeros(3)}
    return setups[0]._replace(properties=properties, **fields, **unloaded).rod()


def laws(setups: Sequence[Setup]) -> Bending:
    """Return the laws of bending of setups that all have one, each in a row."""
    every = (s.bending for s in setups if s.bending is not None)
    return Bending(*map(np.stack, zip(*every, strict=True)))
