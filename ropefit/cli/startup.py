"""What makes a process of the command line lighter; set before a stage imports anything."""

from __future__ import annotations

import atexit
import ctypes
import gc
import os
import sys
from types import ModuleType

# Of glibc's mallopt: what is given back at once when it is freed, and by all threads' heaps.
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENAS = -1, -3, -8
LARGE, SPARE = 4_000_000, 32_000_000  # bytes of an array; at the end of the heap
OBJECTS = 600_000  # new ones, before the collector looks for cycles among them: more than imports
# Shapes of tensors without data, for torch.compile: a fifth of torch's import, and no use here.
UNUSED = "torch._meta_registrations"


def lighten() -> None:
    """Let later imports take less time: fewer collections, quicker compilation, less of torch; let
    threads sleep while they wait, and large arrays that are freed go back to the system."""
    gc.set_threshold(OBJECTS)  # a tenth of the time of imports goes into collections that find none
    atexit.register(gc.freeze)  # nor is anything to be found in all that goes when a process ends
    # numba's third level compiles 1.4 times as long and gives loops that are no faster.
    os.environ.setdefault("NUMBA_OPT", "1")
    # Between two operators of torch a thread that looks out for the next takes a whole processor.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    sys.modules.setdefault(UNUSED, ModuleType(UNUSED))
    _give_back()


def _give_back() -> None:
    """Keep no freed arrays for later: glibc would, of up to 32 MB each, in a heap for every thread,
    and between them lie small objects that stay. Elsewhere nothing is changed."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None
    if mallopt is not None:
        mallopt(MMAP_THRESHOLD, LARGE)
        mallopt(TRIM_THRESHOLD, SPARE)  # less costs more time: every page is cleared again
        mallopt(ARENAS, 1)
