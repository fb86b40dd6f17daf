"""Says when compiled code is made: once for a machine and a version, about a minute in silence."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

COMPILING = (
    "compiling the solver for this machine; this happens once and takes about a minute (nothing is "
    "wrong)"
)


def telling(say: Callable[[str], None]) -> AbstractContextManager[object]:
    """Say the first compilation by numba meanwhile, once; loading its cache is not said.

    Costs nothing where numba is not in use.
    """
    if "numba" not in sys.modules:
        return nullcontext()
    from numba.core import event

    class Telling(event.Listener):
        told = False

        def on_start(self, event: object) -> None:
            if not self.told:
                self.told = True
                say(COMPILING)

        def on_end(self, event: object) -> None:
            pass

    return event.install_listener("numba:compile", Telling())
