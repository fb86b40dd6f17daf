"""How many threads a measurement uses."""

from __future__ import annotations

import os
import sys


def use_threads(count: int) -> None:
    """Do all work on so many threads from here on, that of torch too where it is imported."""
    os.environ["OMP_NUM_THREADS"] = str(count)
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(count)
