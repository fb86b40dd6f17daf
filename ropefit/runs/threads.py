"""How many threads a process may use."""

from __future__ import annotations

import os


def processors() -> int:
    """Return processors that this process may run on."""
    try:
        return max(len(os.sched_getaffinity(0)), 1)
    except AttributeError:  # macOS, Windows
        return os.cpu_count() or 1


def threads() -> int:
    """Return threads for work of our own: as many as processors, or as OMP_NUM_THREADS says.

    joblib and dask set it in their workers, so that workers side by side do not get in each
    other's way.
    """
    text = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    return min(processors(), int(text)) if text.isdigit() and int(text) > 0 else processors()
