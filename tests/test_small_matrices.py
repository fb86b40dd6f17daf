"""Signs of eigenvalues in the compiled loops."""

import numpy as np
import pytest
from numba import njit

from ropefit.solvers.equilibrium.kernels import small_matrices
from ropefit.solvers.kernels.linked import EntryCompiler

_counted = small_matrices.negative_eigenvalues
_definite = small_matrices._negative_definite


def _both(matrix, size, scratch):
    return _counted(matrix, size, scratch), _definite(matrix, size, scratch)


@pytest.mark.parametrize("negative", [0, 1, 5, 11, 12])
def test_negative_eigenvalues_are_counted(negative: int):
    """Also where all are, which a factorisation of a tenth of the work shows."""
    rng, size = np.random.default_rng(negative), 12
    turn, _ = np.linalg.qr(rng.normal(size=(size, size)))
    values = np.geomspace(1e-6, 1e3, size) * np.where(np.arange(size) < negative, -1.0, 1.0)
    matrix = (turn * values) @ turn.T
    lower = np.tril(matrix) + np.triu(np.full((size, size), 7.0), 1)  # the other half is not read
    scratch = np.full((size + 2, size), np.nan)
    entry = njit(pipeline_class=EntryCompiler)(_both)
    assert entry(lower, size, scratch) == (negative, negative == size)
