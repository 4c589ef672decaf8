"""The compiled linear step of the linearised start: the re-weighted equation error and its bounded least squares.

With FRFs z in place of the model's, A(s; theta) z - b(s; theta) is linear in the gains. Weighted with the inverse of A
at earlier parameters theta_w it is the output error to first order (Sanathanan & Koerner 1963),

    e(theta) = W ( A(theta_w)^-1 [b(theta) - A(theta) z] + z - y ),     z = mix * y + (1 - mix) * H(theta_w)

and the mix of data y and model H in z chooses between the two classical linearisations: mix = 1 regresses on the data
(no need of a good theta_w, but noise in z biases the gains), mix = 0 regresses on the model's own response (no such
bias; it is the Gauss-Newton step of the output error). Gains enter exactly; delays, and the sensory weights that
multiply gains, through their derivative at theta_w. e(theta_w) = W (H(theta_w) - y), the output error itself, for every
mix. Derived.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mcstudy.compiling.decorators import compiled
from mcstudy.fitting.arguments import Bounds
from mcstudy.fitting.small_linear import solve

RIDGE = 1e-14
"""Least damping, relative to the largest diagonal element of the Gram matrix in units of the bounds' widths."""

_TWO_OVER_PI = 0.6366197723675814
_HALF_PI_1 = 1.5707963267341256
_HALF_PI_2 = 6.077100506303966e-11
_HALF_PI_3 = 2.0222662487959506e-21


class LinearTable(NamedTuple):
    """A model of R rows whose gains enter linearly, at N frequencies.

    rows: 0 to R - 1, a tuple, so that each R has compiled code of its own. omega: (N,) rad/s. fixed: (N, R, R + 1)
    complex, the parts of A and, as the last column, b without parameters. entry: (E, 4) int64 - row, gain, delay,
    sensory weight (-1 none). sense: (E, R + 1) weights on the angles and the stimulus. factor: (E, N) complex,
    coefficient * s^order * filters.
    """

    rows: tuple[int, ...]
    omega: np.ndarray
    fixed: np.ndarray
    entry: np.ndarray
    sense: np.ndarray
    factor: np.ndarray


@compiled
def _turn(angle):  # type: ignore[no-untyped-def]
    """exp(-i angle), by Cody & Waite's reduction and Taylor series: no library call, so the same bits everywhere."""
    k = np.floor(angle * _TWO_OVER_PI + 0.5)
    r = ((angle - k * _HALF_PI_1) - k * _HALF_PI_2) - k * _HALF_PI_3
    z = r * r
    sine, cosine, term_s, term_c = r, 1.0, r, 1.0
    for j in range(1, 9):
        term_c *= -z / ((2 * j - 1) * (2 * j))
        term_s *= -z / ((2 * j) * (2 * j + 1))
        cosine += term_c
        sine += term_s
    quarter = int(k) & 3
    if quarter == 0:
        return complex(cosine, -sine)
    if quarter == 1:
        return complex(-sine, -cosine)
    if quarter == 2:
        return complex(-cosine, sine)
    return complex(sine, cosine)


@compiled
def _invert(rows, A, inverse):  # type: ignore[no-untyped-def]
    """Inverse of a complex matrix (R, R + 1) without its last column; what it holds is lost for more than two rows."""
    R = len(rows)
    if R == 1:
        inverse[0, 0] = 1.0 / A[0, 0]
        return
    if R == 2:
        scale = 1.0 / (A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0])
        inverse[0, 0], inverse[0, 1] = A[1, 1] * scale, -A[0, 1] * scale
        inverse[1, 0], inverse[1, 1] = -A[1, 0] * scale, A[0, 0] * scale
        return
    for i in range(R):
        for j in range(R):
            inverse[i, j] = 1.0 if i == j else 0.0
    for k in range(R):
        pivot = k
        for i in range(k + 1, R):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        for j in range(R):
            A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            inverse[k, j], inverse[pivot, j] = inverse[pivot, j], inverse[k, j]
        scale = 1.0 / A[k, k]
        for j in range(R):
            A[k, j] *= scale
            inverse[k, j] *= scale
        for i in range(R):
            if i != k:
                share = A[i, k]
                for j in range(R):
                    A[i, j] -= share * A[k, j]
                    inverse[i, j] -= share * inverse[k, j]


@compiled
def _add(rows, J, column, share, u, row):  # type: ignore[no-untyped-def]
    """Add what a torque on a row does to the weighted angles: real and imaginary parts by angle."""
    for a in range(len(rows)):
        moved = u[a, row] * share
        J[2 * a, column] += moved.real
        J[2 * a + 1, column] += moved.imag


@compiled
def _equations(table: LinearTable, x, n, turned, A):  # type: ignore[no-untyped-def]
    """A(s) and, as the last column, b(s) at frequency ``n``, and what depends on its delays (``turned``)."""
    R, sense = len(table.rows), table.sense
    for row in range(R):
        for c in range(R + 1):
            A[row, c] = table.fixed[n, row, c]
    for e in range(table.entry.shape[0]):
        row, gain, delay, weight = table.entry[e]
        value = table.factor[e, n] * turned[delay]
        if gain >= 0:
            value = value * x[gain]
        if weight >= 0:
            value = value * x[weight]
        for c in range(R):
            A[row, c] += sense[e, c] * value
        A[row, R] -= sense[e, R] * value


@compiled
def normal_equations(table: LinearTable, x, mix, y, W, gram, gradient):  # type: ignore[no-untyped-def]
    """Gram matrix (P, P) and gradient (P,) of e at theta = theta_w = ``x``; returns ||e||^2.

    y: (N, R) complex data. W: (N, R, R) complex lower triangular.
    """
    omega, entry, sense, factor = table.omega, table.entry, table.sense, table.factor
    P, E, R = x.size, entry.shape[0], len(table.rows)
    size = (P + 8) // 8 * 8  # room for the residual as column P; whole vectors, so the sums below are quick
    J, sums, products = np.zeros((2 * R, size)), np.zeros((P + 1, size)), np.zeros(size)
    turned = np.ones(P + 1, dtype=np.complex128)  # exp(-delay s); the last stays 1, for entries without a delay
    delayed = np.zeros(P, dtype=np.bool_)
    A, inverse = np.empty((R, R + 1), dtype=np.complex128), np.empty((R, R), dtype=np.complex128)
    u, miss, z = np.empty((R, R), dtype=np.complex128), np.empty(R, np.complex128), np.empty(R, np.complex128)
    for e in range(E):
        if entry[e, 2] >= 0:
            delayed[entry[e, 2]] = True
    for n in range(omega.size):
        for p in range(P):
            if delayed[p]:
                turned[p] = _turn(omega[n] * x[p])
            for c in range(2 * R):
                J[c, p] = 0.0
        _equations(table, x, n, turned, A)
        _invert(table.rows, A, inverse)
        for a in range(R):
            response = inverse[a, 0] * A[0, R]
            for k in range(1, R):
                response += inverse[a, k] * A[k, R]
            miss[a] = response - y[n, a]
            z[a] = response - mix * miss[a]
        for a in range(R):  # weighted inverse and residual
            for row in range(R):
                u[a, row] = W[n, a, 0] * inverse[0, row]
            residual = W[n, a, 0] * miss[0]
            for k in range(1, a + 1):
                for row in range(R):
                    u[a, row] += W[n, a, k] * inverse[k, row]
                residual += W[n, a, k] * miss[k]
            J[2 * a, P], J[2 * a + 1, P] = residual.real, residual.imag
        for e in range(E):
            row, gain, delay, weight = entry[e]
            sensed = sense[e, 0] * z[0]
            for k in range(1, R):
                sensed += sense[e, k] * z[k]
            value = factor[e, n] * turned[delay] * (sensed + sense[e, R])
            if weight >= 0:
                _add(table.rows, J, weight, -(value * x[gain]), u, row)
                value = value * x[weight]
            if gain >= 0:
                _add(table.rows, J, gain, -value, u, row)
                value = value * x[gain]
            if delay >= 0:
                _add(table.rows, J, delay, complex(0.0, omega[n]) * value, u, row)
        for p in range(P + 1):
            for a in range(R - 1):
                re, im = J[2 * a, p], J[2 * a + 1, p]
                for q in range(size):
                    products[q] = (products[q] if a > 0 else 0.0) + re * J[2 * a, q] + im * J[2 * a + 1, q]
            re, im = J[2 * R - 2, p], J[2 * R - 1, p]
            for q in range(size):  # ``products`` stay zero for one row
                sums[p, q] += products[q] + re * J[2 * R - 2, q] + im * J[2 * R - 1, q]
    for p in range(P):
        gradient[p] = sums[P, p]
        for q in range(P):
            gram[p, q] = sums[p, q]
    return sums[P, P]


@compiled
def bounded_step(gram, gradient, lower, upper, p, side):  # type: ignore[no-untyped-def]
    """Minimise p'Gp/2 + g'p for lower <= p <= upper (which hold 0) by a primal active set; fills ``p`` and ``side``.

    ``side`` (P,) ends as -1, 0, +1: on the lower bound, free, on the upper bound. Parameters whose bounds coincide
    stay where they are. Every pivot lowers the objective, so a singular or unfinished problem still leaves a
    feasible point no worse than p = 0.
    """
    n = p.size
    A, b = np.empty((n, n)), np.empty(n)
    free = np.empty(n, dtype=np.int64)
    for i in range(n):
        p[i] = 0.0
        side[i] = 0
        if upper[i] <= 0.0 and (gradient[i] <= 0.0 or lower[i] >= 0.0):
            side[i] = 1
        elif lower[i] >= 0.0 and gradient[i] >= 0.0:
            side[i] = -1
    for _ in range(10 * n):
        m = np.int64(0)  # a literal 0 would be a type of its own: `solve` would be compiled twice
        for i in range(n):
            if side[i] == 0:
                free[m] = i
                m += 1
        for a in range(m):
            b[a] = -gradient[free[a]]
            for j in range(n):
                if side[j] != 0:
                    b[a] -= gram[free[a], j] * p[j]
            for c in range(a + 1):
                A[a, c] = gram[free[a], free[c]]
        if not solve(A, b, m):
            return
        length, blocked = 1.0, -1
        for a in range(m):
            i = free[a]
            limit = lower[i] if b[a] < lower[i] else upper[i]
            if b[a] < lower[i] or b[a] > upper[i]:
                t = (limit - p[i]) / (b[a] - p[i])
                if t < length:
                    length, blocked = t, a
        for a in range(m):
            p[free[a]] += length * (b[a] - p[free[a]])
        if blocked >= 0:
            i = free[blocked]
            side[i] = -1 if b[blocked] < lower[i] else 1
            p[i] = lower[i] if side[i] < 0 else upper[i]
            continue
        worst, release = 1e-13, -1
        for i in range(n):
            if side[i] != 0 and lower[i] < upper[i]:
                v, size = gradient[i], abs(gradient[i])
                for j in range(n):
                    v += gram[i, j] * p[j]
                    size += abs(gram[i, j] * p[j])
                if side[i] * v > worst * size:
                    worst, release = side[i] * v / size, i
        if release < 0:
            return
        side[release] = 0


@compiled
def propose(table: LinearTable, bounds: Bounds, y, W, movable, mixes, x):  # type: ignore[no-untyped-def]
    """Take the linear steps ``mixes`` (M, K) from each row of ``x`` (M, P), in place.

    A NaN in ``mixes`` ends the steps of its row. ``movable`` (P,): whether a parameter may move. A step whose normal
    equations are not finite ends the row where it is.
    """
    P, lower, upper = x.shape[1], bounds.lower, bounds.upper
    gram, gradient, at = np.empty((P, P)), np.empty(P), np.empty(P)
    lo, hi, p, side = np.empty(P), np.empty(P), np.empty(P), np.empty(P, dtype=np.int64)
    for m in range(x.shape[0]):
        for k in range(mixes.shape[1]):
            if np.isnan(mixes[m, k]):
                break
            for i in range(P):  # a slice would be compiled with the text of its error, which takes two seconds
                at[i] = x[m, i]
            e = normal_equations(table, at, mixes[m, k], y, W, gram, gradient)
            largest = 0.0
            for i in range(P):
                width = upper[i] - lower[i]
                gradient[i] *= width
                for j in range(P):
                    gram[i, j] *= width * (upper[j] - lower[j])
                largest = max(largest, gram[i, i])
                lo[i], hi[i] = (lower[i] - at[i]) / width, (upper[i] - at[i]) / width
                if not movable[i]:
                    lo[i], hi[i] = 0.0, 0.0
            if not (np.isfinite(e) and np.isfinite(largest) and largest > 0.0):
                break
            for i in range(P):
                gram[i, i] += RIDGE * largest
            bounded_step(gram, gradient, lo, hi, p, side)
            for i in range(P):
                if movable[i]:
                    moved = at[i] + p[i] * (upper[i] - lower[i])
                    x[m, i] = min(max(moved, lower[i]), upper[i])
                    if side[i] < 0:
                        x[m, i] = lower[i]
                    elif side[i] > 0:
                        x[m, i] = upper[i]
