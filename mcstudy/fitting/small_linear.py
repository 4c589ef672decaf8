"""Linear algebra of small matrices, compiled: handing these to BLAS threads costs more than doing them."""

from __future__ import annotations

import numpy as np
from numba import njit

from mcstudy.compiling.decorators import compiled

RELATIVE_RIDGE = 1e-14
"""Added to a diagonal, relative to it, so that a matrix with a direction of zero curvature has a factor."""


@compiled
def factor(A, n):  # type: ignore[no-untyped-def]
    """Cholesky factor of the leading n rows, in place; False when A is not positive definite.

    Reads the lower triangle of A and leaves its factor there.
    """
    for j in range(n):
        d = A[j, j]
        for k in range(j):
            d -= A[j, k] * A[j, k]
        if not d > 0.0:
            return False
        d = np.sqrt(d)
        A[j, j] = d
        for i in range(j + 1, n):
            v = A[i, j]
            for k in range(j):
                v -= A[i, k] * A[j, k]
            A[i, j] = v / d
    return True


@compiled
def solve_factored(A, b, n):  # type: ignore[no-untyped-def]
    """Solve A x = b in place for the leading n rows, with A as `factor` leaves it; x is left in b."""
    for i in range(n):
        v = b[i]
        for k in range(i):
            v -= A[i, k] * b[k]
        b[i] = v / A[i, i]
    for i in range(n - 1, -1, -1):
        v = b[i]
        for k in range(i + 1, n):
            v -= A[k, i] * b[k]
        b[i] = v / A[i, i]


@compiled
def solve(A, b, n):  # type: ignore[no-untyped-def]
    """Solve A x = b in place for the leading n rows, by Cholesky; False when A is not positive definite.

    Reads the lower triangle of A and leaves its factor there; x is left in b.
    """
    if not factor(A, n):
        return False
    solve_factored(A, b, n)
    return True


@compiled
def likelihood_ratios(gram, right, gradients, ratio, variance, explained):  # type: ignore[no-untyped-def]
    """Of D linear fits: likelihood ratios and variances (D, K) of K quantities, and the squares that they explain (D,).

    ``gram``: lower triangles by rows, (D, F (F + 1) / 2), or one for all fits. ``right``: (D, F). ``gradients``: (K, F)
    of the quantities. What no line determines has a variance of about 1 / `RELATIVE_RIDGE`, not an infinite one.
    """
    D, F = right.shape
    A, b, g = np.empty((F, F)), np.empty(F), np.empty(F)
    for d in range(D):
        if d < gram.shape[0]:
            k = 0
            for i in range(F):
                for j in range(i + 1):
                    A[i, j] = gram[d, k]
                    k += 1
                A[i, i] *= 1.0 + RELATIVE_RIDGE
            factor(A, F)
        explained[d] = 0.0
        for i in range(F):
            b[i] = right[d, i]
            for j in range(i):
                b[i] -= A[i, j] * b[j]
            b[i] /= A[i, i]
            explained[d] += b[i] * b[i]
        for k in range(gradients.shape[0]):
            along, size = 0.0, 0.0
            for i in range(F):
                g[i] = gradients[k, i]
                for j in range(i):
                    g[i] -= A[i, j] * g[j]
                g[i] /= A[i, i]
                along += g[i] * b[i]
                size += g[i] * g[i]
            ratio[d, k] = along * along / size
            variance[d, k] = size


@compiled
def gaussian_factor(A, b, variance):  # type: ignore[no-untyped-def]
    """ln Bayes factor (n,) of coefficients N(0, variance I) from b = F'r (K, n) and A = F'MF (K, K).

    b'(A + I / v)^-1 b / 2 - ln|I + v A| / 2 by Cholesky.
    """
    K, n = b.shape
    L = np.zeros((K, K))
    log_det = 0.0
    for j in range(K):
        for i in range(j, K):
            v = A[i, j]
            if i == j:
                v += 1.0 / variance
            for k in range(j):
                v -= L[i, k] * L[j, k]
            if i == j:
                v = max(v, 1.0 / variance)  # A is positive semidefinite, up to rounding
                L[j, j] = np.sqrt(v)
                log_det += np.log(variance * v)
            else:
                L[i, j] = v / L[j, j]
    out = np.zeros(n)
    x = np.empty((K, n))
    for i in range(K):
        for c in range(n):
            x[i, c] = b[i, c]
        for k in range(i):
            f = L[i, k]
            for c in range(n):
                x[i, c] -= f * x[k, c]
        for c in range(n):
            x[i, c] /= L[i, i]
            out[c] += x[i, c] * x[i, c]
    return 0.5 * out - 0.5 * log_det


@njit(nogil=True, inline="always")
def _length(row):  # type: ignore[no-untyped-def]
    """Root of the sum of squares; NumPy's sum would load numba's array mathematics, and SciPy's with it."""
    total = 0.0
    for d in range(row.size):
        total += row[d] * row[d]
    return np.sqrt(total)


@compiled
def orthonormal(J, X, least):  # type: ignore[no-untyped-def]
    """Orthonormal rows that span the rows of X (M, D) at right angles to those of J (P, D), and their number.

    Gram-Schmidt, twice; a row that keeps less than ``least`` of its length is dropped. Rows 0 ... P - 1 of the result
    span J; those of X follow.
    """
    P, D = J.shape
    M = X.shape[0]
    Q = np.zeros((P + M, D))
    count, first = 0, 0
    for m in range(P + M):
        row = J[m].copy() if m < P else X[m - P].copy()
        length = _length(row)
        if not length > 0.0:
            continue
        row /= length
        for _ in range(2):
            for k in range(count):
                inner = 0.0
                for d in range(D):
                    inner += Q[k, d] * row[d]
                for d in range(D):
                    row[d] -= inner * Q[k, d]
        left = _length(row)
        if left > (1e-9 if m < P else least):
            for d in range(D):  # a slice would be compiled with the text of its error, which takes two seconds
                Q[count, d] = row[d] / left
            count += 1
        if m == P - 1:
            first = count
    return Q[first:count]
