"""Linear algebra of small matrices, compiled: handing these to BLAS threads costs more than doing them."""

from __future__ import annotations

import numpy as np

from mcstudy.stance.compiled import compiled


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
        length = np.sqrt(np.sum(row * row))
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
        left = np.sqrt(np.sum(row * row))
        if left > (1e-9 if m < P else least):
            Q[count] = row / left
            count += 1
        if m == P - 1:
            first = count
    return Q[first:count]
