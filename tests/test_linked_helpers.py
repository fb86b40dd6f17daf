"""Helpers are linked into entry points as they are: they compute the same, and make no code."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from ropefit.solvers.kernels.jit import helper, inlined, maker
from ropefit.solvers.kernels.linked import EntryCompiler, HelperLibrary


@helper
def _inner(a, k):
    if k < 0:
        raise ValueError("k is negative")
    return a[k] + 1.0


@inlined
def _merged(a, k):
    return 2.0 * _inner(a, k)


@helper
def _outer(a):
    total = 0.0
    for k in range(len(a)):
        total += _merged(a, k)
    return total


@maker
def _made(n):
    return np.arange(float(n)), n


def _total(n):
    a, count = _made(n)
    return _outer(a) + count + _inner(a, n - 1)


def _entry() -> Any:
    return njit(pipeline_class=EntryCompiler)(_total)


def test_helpers_of_helpers_are_linked_in() -> None:
    """The sum is that of the same functions in Python; so is the error."""
    entry = _entry()
    assert entry(5) == 2.0 * (10 + 5) + 5 + 5
    with pytest.raises(ValueError, match="k is negative"):
        entry(0)


def test_a_helper_makes_no_machine_code() -> None:
    """Only entry points are translated; a helper holds no code of what it calls."""
    entry = _entry()
    entry(5)
    [outer] = _outer.overloads.values()
    library = outer.library
    assert isinstance(library, HelperLibrary)
    [own] = [f.name for f in library.get_defined_functions() if "_outer" in f.name]
    assert not library.codegen._engine.is_symbol_defined(own)
    assert not any("_inner" in f.name for f in library.get_defined_functions())
    [made] = entry.overloads.values()
    assert made.library.codegen._engine.is_symbol_defined(made.fndesc.mangled_name)
