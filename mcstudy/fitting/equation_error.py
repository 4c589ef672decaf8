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
    """A model whose gains enter linearly, at N frequencies.

    omega: (N,) rad/s. fixed: (N, 6) complex, the parts of A (by rows) and b without parameters. entry: (E, 4) int64 -
    row, gain, delay, sensory weight (-1 none). sense: (E, 3) weights on (theta1, theta2, stimulus). factor: (E, N)
    complex, coefficient * s^order * filters.
    """

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
def _add(J, column, first, second):  # type: ignore[no-untyped-def]
    J[0, column] += first.real
    J[1, column] += first.imag
    J[2, column] += second.real
    J[3, column] += second.imag


@compiled
def normal_equations(table: LinearTable, x, mix, y, W, gram, gradient):  # type: ignore[no-untyped-def]
    """Gram matrix (P, P) and gradient (P,) of e at theta = theta_w = ``x``; returns ||e||^2.

    y: (N, 2) complex data. W: (N, 2, 2) complex lower triangular.
    """
    omega, fixed, entry, sense, factor = table.omega, table.fixed, table.entry, table.sense, table.factor
    P, E = x.size, entry.shape[0]
    size = (P + 8) // 8 * 8  # room for the residual as column P; whole vectors, so the sums below are quick
    J, sums = np.zeros((4, size)), np.zeros((P + 1, size))  # rows of J: re and im of the two angles
    turned = np.ones(P + 1, dtype=np.complex128)  # exp(-delay s); the last stays 1, for entries without a delay
    delayed = np.zeros(P, dtype=np.bool_)
    for e in range(E):
        if entry[e, 2] >= 0:
            delayed[entry[e, 2]] = True
    for n in range(omega.size):
        for p in range(P):
            if delayed[p]:
                turned[p] = _turn(omega[n] * x[p])
            for c in range(4):
                J[c, p] = 0.0
        a11, a12, a21, a22, b1, b2 = fixed[n]
        for e in range(E):
            row, gain, delay, weight = entry[e]
            value = factor[e, n] * turned[delay]
            if gain >= 0:
                value = value * x[gain]
            if weight >= 0:
                value = value * x[weight]
            if row == 0:
                a11 += sense[e, 0] * value
                a12 += sense[e, 1] * value
                b1 -= sense[e, 2] * value
            else:
                a21 += sense[e, 0] * value
                a22 += sense[e, 1] * value
                b2 -= sense[e, 2] * value
        inverse = 1.0 / (a11 * a22 - a12 * a21)
        i11, i12, i21, i22 = a22 * inverse, -a12 * inverse, -a21 * inverse, a11 * inverse
        h1, h2 = i11 * b1 + i12 * b2, i21 * b1 + i22 * b2
        d1, d2 = h1 - y[n, 0], h2 - y[n, 1]
        z1, z2 = h1 - mix * d1, h2 - mix * d2
        w11, w21, w22 = W[n, 0, 0], W[n, 1, 0], W[n, 1, 1]
        u11, u12 = w11 * i11, w11 * i12
        u21, u22 = w21 * i11 + w22 * i21, w21 * i12 + w22 * i22
        for e in range(E):
            row, gain, delay, weight = entry[e]
            value = factor[e, n] * turned[delay] * (sense[e, 0] * z1 + sense[e, 1] * z2 + sense[e, 2])
            u1, u2 = (u11, u21) if row == 0 else (u12, u22)
            if weight >= 0:
                product = value * x[gain]
                _add(J, weight, -u1 * product, -u2 * product)
                value = value * x[weight]
            if gain >= 0:
                _add(J, gain, -u1 * value, -u2 * value)
                value = value * x[gain]
            if delay >= 0:
                slope = complex(0.0, omega[n]) * value
                _add(J, delay, u1 * slope, u2 * slope)
        r1, r2 = w11 * d1, w21 * d1 + w22 * d2
        J[0, P], J[1, P], J[2, P], J[3, P] = r1.real, r1.imag, r2.real, r2.imag
        for p in range(P + 1):
            j0, j1, j2, j3 = J[0, p], J[1, p], J[2, p], J[3, p]
            for q in range(size):
                sums[p, q] += j0 * J[0, q] + j1 * J[1, q] + j2 * J[2, q] + j3 * J[3, q]
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
