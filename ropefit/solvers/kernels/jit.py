"""How the compiled loops are compiled and kept: numba's options and cache.

numba caches an entry point on disk by its arguments' types, its bytecode and what it closes over,
and drops the cache when the file that holds it changes. Changes of the functions that it calls, in
other files, go unnoticed: an entry point therefore closes over `source_key` of all of them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zlib import crc32

import numba
from numba import njit

from ropefit.solvers.compiling import listen
from ropefit.solvers.kernels.linked import EntryCompiler, HelperCompiler, NotInlinedCompiler

listen()  # whoever computes meanwhile says that it is compiled

FUSED = {"contract"}  # a multiplication and an addition may be one instruction
SHARED = Path(__file__).parent
TEMPORARY = "ropefit-numba-"  # how a cache folder begins that goes with the process

# Helpers are not called from Python: wrappers for that would be a quarter of their compilation.
BARE = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
BARE |= {"pipeline_class": HelperCompiler}
# Nor do they count references to arrays (`_nrt`), which would take half of the time in a loop of
# views: their callers keep them. So a helper makes no array and returns none; a `maker` may.
helper = njit(**BARE, _nrt=False, fastmath=FUSED)  # type: ignore[call-overload]
# Not inlined by LLVM: vector loops that are called from many places are optimised once.
NOT_INLINED = BARE | {"pipeline_class": NotInlinedCompiler}
not_inlined = njit(**NOT_INLINED, _nrt=False, fastmath=FUSED)  # type: ignore[call-overload]
maker = njit(**BARE, fastmath=FUSED)
# Merged into its callers: a call costs as much as ten segments where it hands over a whole record.
inlined = njit(**BARE, inline="always", fastmath=FUSED)
exact_helper = njit(**BARE)  # division by zero gives inf or NaN, as in torch


@helper
def copy_rows(source, target):
    """Copy a matrix; an assignment to a slice takes numba half a second to compile."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile an entry point, kept on disk."""
    return _cached(function, fastmath=FUSED)


def exact_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile an entry point, kept on disk, with every operation rounded by itself."""
    return _cached(function)


def _cached(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """Compile with numba's cache, or a temporary one where none can be written.

    numba keeps compiled code beside the source or in the user's cache folder. Where neither can be
    written it is compiled anew in every process, or set NUMBA_CACHE_DIR.
    """
    options |= {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    compile_it = njit(**options, pipeline_class=EntryCompiler)
    try:
        return compile_it(function)
    except RuntimeError:
        numba.config.CACHE_DIR = tempfile.mkdtemp(prefix=TEMPORARY)  # type: ignore[attr-defined]
        return compile_it(function)


def source_key(*paths: Path) -> int:
    """Return a hash of source files and of all those in folders: names and contents."""
    key = 0
    for path in paths:
        for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            key = crc32(file.read_bytes(), crc32(file.name.encode(), key))
    return key or 1
