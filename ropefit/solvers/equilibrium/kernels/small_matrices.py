"""Small dense matrices in compiled loops; numba takes seconds to compile its calls of LAPACK."""

from __future__ import annotations

import math

from ropefit.solvers.kernels.jit import helper

LEAST_PIVOT = 1e-200  # stands for a pivot of zero


@helper
def solve_border(matrix, right, m):
    """Solve matrix y = right (S, P), y in the place of right; return False when singular.

    Gaussian elimination with partial pivoting. m: scratch of at least (S, S).
    """
    size, columns = right.shape
    for i in range(size):
        for j in range(size):
            m[i, j] = matrix[i, j]
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(m[i, k]) > abs(m[best, k]):
                best = i
        if m[best, k] == 0.0:
            return False
        if best != k:
            for j in range(size):
                m[k, j], m[best, j] = m[best, j], m[k, j]
            for c in range(columns):
                right[k, c], right[best, c] = right[best, c], right[k, c]
        for i in range(k + 1, size):
            f = m[i, k] / m[k, k]
            for j in range(k + 1, size):
                m[i, j] -= f * m[k, j]
            for c in range(columns):
                right[i, c] -= f * right[k, c]
    for k in range(size - 1, -1, -1):
        for c in range(columns):
            total = right[k, c]
            for j in range(k + 1, size):
                total -= m[k, j] * right[j, c]
            right[k, c] = total / m[k, k]
    return True


@helper
def _negative_definite(matrix, size, m):
    """Return whether matrix[:size, :size] is: the pivots of its LDLᵀ, a tenth of the work of a
    reduction to tridiagonal form, are all negative then."""
    for i in range(size):
        for j in range(i + 1):
            m[j, i] = matrix[i, j]
    for k in range(size):
        if not m[k, k] < 0.0:
            return False
        for i in range(k + 1, size):
            f = m[k, i] / m[k, k]
            if f != 0.0:
                for j in range(i, size):
                    m[i, j] -= f * m[k, j]
    return True


@helper
def negative_eigenvalues(matrix, size, m):
    """Return how many eigenvalues of the symmetric matrix[:size, :size] are negative.

    Where not all are, Householder's reduction to tridiagonal form, then the signs of its pivots
    (Golub and Van Loan, Matrix Computations, 8.3.1 and 8.4.1). The lower triangle is read.
    m: scratch of at least (size + 2, size).
    """
    if _negative_definite(matrix, size, m):
        return size
    v, p = m[size], m[size + 1]
    for i in range(size):
        for j in range(i + 1):
            m[i, j] = m[j, i] = matrix[i, j]
    for k in range(size - 2):
        square = 0.0
        for i in range(k + 2, size):
            square += m[i, k] * m[i, k]
        if square == 0.0:
            continue
        norm = math.copysign(math.sqrt(m[k + 1, k] * m[k + 1, k] + square), m[k + 1, k])
        v[k + 1] = m[k + 1, k] + norm
        for i in range(k + 2, size):
            v[i] = m[i, k]
        factor = 2.0 / (v[k + 1] * v[k + 1] + square)
        along = 0.0
        for i in range(k + 1, size):
            p[i] = 0.0
            for j in range(k + 1, size):
                p[i] += factor * m[i, j] * v[j]
            along += 0.5 * factor * p[i] * v[i]
        for i in range(k + 1, size):
            p[i] -= along * v[i]
        for i in range(k + 1, size):
            for j in range(k + 1, size):
                m[i, j] -= v[i] * p[j] + p[i] * v[j]
        m[k + 1, k] = -norm
    negative, pivot = 0, 1.0
    for i in range(size):
        beside = m[i, i - 1] if i > 0 else 0.0
        pivot = m[i, i] - beside * beside / pivot
        if abs(pivot) < LEAST_PIVOT:
            pivot = LEAST_PIVOT
        if pivot < 0.0:
            negative += 1
    return negative
