"""One step of an interior-point method inside bounds: merit, quasi-Newton matrix, direct step, trust-region step.

The problem is to minimise a smooth f(x) with lower < x < upper. The barrier problem adds -mu sum log(x - lower) -
mu sum log(upper - x), whose sum with f is the merit. Multipliers z of the bounds tend to mu / slack.

Everything works on the arrays of one fit, in scalar arithmetic of fixed order and without library calls, so that the
same bits come out on every machine. A bound may be infinite: it then has no barrier and no multiplier.

Sources: Byrd, Hribar & Nocedal (1999) SIAM J. Optim. 9:877-900; Byrd, Gilbert & Nocedal (2000) Math. Program.
89:149-185; Waltz, Morales, Nocedal & Orban (2006) Math. Program. 107:391-408; Nocedal & Wright (2006) Numerical
Optimization.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mcstudy.fitting.small_linear import solve

BOUNDARY = 0.995
"""Fraction of the way to a bound that a step may go (Byrd, Hribar & Nocedal 1999)."""

DAMPING = 0.2
"""Least curvature along a step that the quasi-Newton matrix is told, as a fraction of its own (Powell 1978)."""

SAFEGUARD = 1e10
"""Largest factor between a multiplier and mu / slack (Waechter & Biegler 2006, Math. Program. 106:25-57, eq. 16)."""

_LN2 = 0.6931471805599453


@njit(nogil=True)
def logarithm(x):  # type: ignore[no-untyped-def]
    """Natural logarithm of a positive number: mantissa by the series of artanh, no library call."""
    if not (x > 0.0 and math.isfinite(x)):
        return -math.inf if x == 0.0 else x
    mantissa, exponent = math.frexp(x)
    if mantissa < 0.7071067811865476:
        mantissa, exponent = 2.0 * mantissa, exponent - 1
    t = (mantissa - 1.0) / (mantissa + 1.0)
    square, total = t * t, 0.0
    for k in range(12, -1, -1):
        total = total * square + 1.0 / (2 * k + 1)
    return exponent * _LN2 + 2.0 * t * total


@njit(nogil=True)
def merit(value, x, lower, upper, barrier):  # type: ignore[no-untyped-def]
    """Objective ``value`` and barrier at x; infinite where the objective is not finite."""
    if not math.isfinite(value):
        return math.inf
    total = 0.0
    for i in range(x.size):
        if math.isfinite(lower[i]):
            total += logarithm(x[i] - lower[i])
        if math.isfinite(upper[i]):
            total += logarithm(upper[i] - x[i])
    return value - barrier * total


@njit(nogil=True)
def error(gradient, x, lower, upper, low, high, barrier):  # type: ignore[no-untyped-def]
    """First-order optimality of the barrier problem: largest entry of its conditions.

    ``low``, ``high``: multipliers of the bounds, (P,).
    """
    most = 0.0
    for i in range(x.size):
        most = max(most, abs(gradient[i] - low[i] + high[i]))
        if math.isfinite(lower[i]):
            most = max(most, abs((x[i] - lower[i]) * low[i] - barrier))
        if math.isfinite(upper[i]):
            most = max(most, abs((upper[i] - x[i]) * high[i] - barrier))
    return most


@njit(nogil=True)
def update(hessian, move, change, first):  # type: ignore[no-untyped-def]
    """Damped BFGS update of ``hessian`` (P, P) in place (Nocedal & Wright 2006, procedure 18.2).

    ``move`` (P,): step. ``change`` (P,): change of the gradient. ``first``: scale the matrix to the step before (eq.
    6.20 there).
    """
    P = move.size
    along = 0.0
    for i in range(P):
        along += move[i] * change[i]
    if first and along > 0.0:
        size = 0.0
        for i in range(P):
            size += change[i] * change[i]
        for i in range(P):
            hessian[i, i] = size / along
    product, curvature = np.zeros(P), 0.0
    for i in range(P):
        for j in range(P):
            product[i] += hessian[i, j] * move[j]
        curvature += move[i] * product[i]
    if not (curvature > 0.0 and math.isfinite(curvature) and math.isfinite(along)):
        return
    share = 1.0
    if along < DAMPING * curvature:
        share = (1.0 - DAMPING) * curvature / (curvature - along)
    told = np.empty(P)
    along = 0.0
    for i in range(P):
        told[i] = share * change[i] + (1.0 - share) * product[i]
        along += move[i] * told[i]
    for i in range(P):
        for j in range(P):
            hessian[i, j] += told[i] * told[j] / along - product[i] * product[j] / curvature


@njit(nogil=True)
def barrier_gradient(gradient, x, lower, upper, barrier, out):  # type: ignore[no-untyped-def]
    """Gradient of the merit, to ``out`` (P,)."""
    for i in range(x.size):
        out[i] = gradient[i] - barrier / (x[i] - lower[i]) + barrier / (upper[i] - x[i])


@njit(nogil=True)
def system(hessian, x, lower, upper, low, high, out):  # type: ignore[no-untyped-def]
    """Matrix of the primal-dual step after elimination of the multipliers, to ``out`` (P, P)."""
    for i in range(x.size):
        for j in range(x.size):
            out[i, j] = hessian[i, j]
        out[i, i] += low[i] / (x[i] - lower[i]) + high[i] / (upper[i] - x[i])


@njit(nogil=True)
def direct_step(matrix, slope, step):  # type: ignore[no-untyped-def]
    """Solve ``matrix`` (P, P) step = -slope by Cholesky's factorisation; False when it is not positive definite."""
    for i in range(slope.size):
        step[i] = -slope[i]
    return solve(matrix.copy(), step, slope.size)


@njit(nogil=True)
def scales(x, lower, upper, out):  # type: ignore[no-untyped-def]
    """Units of the trust region: a move of the slacks counts relative to them (Byrd, Hribar & Nocedal 1999)."""
    for i in range(x.size):
        out[i] = math.sqrt(1.0 + 1.0 / (x[i] - lower[i]) ** 2 + 1.0 / (upper[i] - x[i]) ** 2)


@njit(nogil=True)
def trust_region_step(matrix, slope, scale, radius, step):  # type: ignore[no-untyped-def]
    """Fill ``step`` by conjugate gradients that stop at the trust region (Steihaug 1983).

    ``scale`` (P,): units, see `scales`; ``radius`` in these units.
    """
    P = slope.size
    p, residual, direction, product = np.zeros(P), np.empty(P), np.empty(P), np.empty(P)
    size = 0.0
    for i in range(P):
        residual[i] = slope[i] / scale[i]
        direction[i] = -residual[i]
        size += residual[i] * residual[i]
    small = 1e-24 * size
    for _ in range(2 * P):
        if not size > small:
            break
        curvature = 0.0
        for i in range(P):
            total = 0.0
            for j in range(P):
                total += matrix[i, j] * direction[j] / scale[j]
            product[i] = total / scale[i]
            curvature += direction[i] * product[i]
        reach = size / curvature if curvature > 0.0 else math.inf
        length, cross, square = 0.0, 0.0, 0.0
        for i in range(P):
            length += p[i] * p[i]
            cross += p[i] * direction[i]
            square += direction[i] * direction[i]
        room = (math.sqrt(max(cross * cross + square * (radius * radius - length), 0.0)) - cross) / square
        ends = not reach < room
        reach = room if ends else reach
        new = 0.0
        for i in range(P):
            p[i] += reach * direction[i]
            residual[i] += reach * product[i]
            new += residual[i] * residual[i]
        if ends:
            break
        for i in range(P):
            direction[i] = new / size * direction[i] - residual[i]
        size = new
    for i in range(P):
        step[i] = p[i] / scale[i]


@njit(nogil=True)
def longest(x, lower, upper, step):  # type: ignore[no-untyped-def]
    """Largest fraction of a step, at most 1, that keeps the slacks positive with room to spare."""
    most = 1.0
    for i in range(x.size):
        if step[i] < 0.0:
            most = min(most, BOUNDARY * (x[i] - lower[i]) / -step[i])
        elif step[i] > 0.0:
            most = min(most, BOUNDARY * (upper[i] - x[i]) / step[i])
    return most


@njit(nogil=True)
def move_multipliers(x, lower, upper, low, high, barrier, step, fraction):  # type: ignore[no-untyped-def]
    """Take the multipliers at x along the Newton step that belongs to ``step``, of which ``fraction`` is taken.

    They stay positive, and within a wide factor of mu / slack at the new point.
    """
    P = x.size
    d_low, d_high, most = np.zeros(P), np.zeros(P), 1.0
    for i in range(P):
        if math.isfinite(lower[i]):
            d_low[i] = barrier / (x[i] - lower[i]) - low[i] - low[i] / (x[i] - lower[i]) * step[i]
            if d_low[i] < 0.0:
                most = min(most, BOUNDARY * low[i] / -d_low[i])
        if math.isfinite(upper[i]):
            d_high[i] = barrier / (upper[i] - x[i]) - high[i] + high[i] / (upper[i] - x[i]) * step[i]
            if d_high[i] < 0.0:
                most = min(most, BOUNDARY * high[i] / -d_high[i])
    for i in range(P):
        at = x[i] + fraction * step[i]
        if math.isfinite(lower[i]):
            central = barrier / (at - lower[i])
            low[i] = min(max(low[i] + most * d_low[i], central / SAFEGUARD), central * SAFEGUARD)
        if math.isfinite(upper[i]):
            central = barrier / (upper[i] - at)
            high[i] = min(max(high[i] + most * d_high[i], central / SAFEGUARD), central * SAFEGUARD)
