"""Ropes and what drives them in torch, for gradients."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from ropefit.solvers.equilibrium.conditions import Conditions

DIFFERENTIABLE = ("ends", "clamp", "direction", "offset", "compliance")  # of conditions


def tensors(item: Any) -> Any:
    """Return copies, as tensors, of an array or of all those in a tuple or in conditions."""
    if isinstance(item, np.ndarray):
        return torch.from_numpy(item.copy())
    if isinstance(item, Conditions):
        given = {name: getattr(item, name) for name in DIFFERENTIABLE}
        return replace(item, **{name: tensors(value) for name, value in given.items()})
    if isinstance(item, tuple):
        copies = map(tensors, item)
        return type(item)(*copies) if hasattr(item, "_fields") else tuple(copies)
    return item
