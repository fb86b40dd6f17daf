"""What makes a process of the command line lighter; set before a stage imports anything."""

from __future__ import annotations

import gc
import os
import sys
from types import ModuleType

OBJECTS = 200_000  # new ones, before the collector looks for cycles among them
# Shapes of tensors without data, for torch.compile: a fifth of torch's import, and no use here.
UNUSED = "torch._meta_registrations"


def lighten() -> None:
    """Let later imports take less time: fewer collections, quicker compilation, less of torch; and
    let threads sleep while they wait."""
    gc.set_threshold(OBJECTS)  # a tenth of the time of imports goes into collections that find none
    # numba's third level compiles 1.4 times as long and gives loops that are no faster.
    os.environ.setdefault("NUMBA_OPT", "1")
    # Between two operators of torch a thread that looks out for the next takes a whole processor.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    sys.modules.setdefault(UNUSED, ModuleType(UNUSED))
