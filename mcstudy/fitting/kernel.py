"""The compiled fit kernel: bounded Levenberg-Marquardt on a model table, eight fits at a time.

Nothing here knows a particular model. `evaluate` reads the term table of `mcstudy.stance.feedback` and makes, per
frequency and in one pass, the matrix A(s), the FRFs, the weighted residual, its exact derivatives and their
contribution to the Gram matrix J^T J and gradient J^T r; nothing of size (frequencies x parameters) is ever stored.
`levenberg_marquardt` keeps eight fits in lanes, and hands a lane the next start of the queue as soon as its fit has
ended, so the lanes stay full over all starts of all problems of a call.

Method. Each step solves min ||r + J p||^2 + lambda c ||p / width||^2 by an active set inside the bounds and inside a
box of a quarter of their widths: parameters on a bound whose gradient points outwards are held, parameters that the
step would carry across a side are put on it and the rest is solved again. Damping is in units of the bounds' widths
(c is the mean curvature in these units), so that parameters the data hardly feel do not run to a bound early; lambda
follows the gain ratio (Nielsen 1999). A fit has converged when the step predicts a relative decrease of the cost
below the tolerance, and so does moving any parameter alone.

Slots of the workspace are counted in lanes (`mcstudy.fitting.lanes`).
"""

from __future__ import annotations

import numpy as np

from mcstudy.compiling.addresses import call, calling
from mcstudy.compiling.decorators import compiled, inner
from mcstudy.fitting.arguments import Bounds, Filters, LaneStates, Outcomes, Plan, Queue, StopRules, Workspace
from mcstudy.fitting.lanes import WIDTH, fma, fnma, load, nearest, negative, root, splat, store, where_less

CONVERGED, STALLED, ITERATION_LIMIT, NON_FINITE_MODEL = 1, 2, 3, 4

BLOCK = 4
"""Frequencies worked on at a time: enough independent work to hide latencies, little enough to stay in the cache."""

TILE = 3
"""Rows and columns of a tile of the Gram matrix kept in registers (`_tile` is written out for it)."""

LAMBDA_START = 1e-2
LAMBDA_LEAST = 1e-14
LAMBDA_MOST = 1e12
LONGEST = 0.25  # longest step of one parameter, in widths of its bounds
ROUNDING = 1e-28  # of the squared norm of the weighted data: a cost below this is rounding

# pi/2 in three pieces (Cody & Waite 1980), so that x - k pi/2 is exact to rounding for every delay times frequency
_TWO_OVER_PI = 0.6366197723675814
_HALF_PI_1 = 1.5707963267341256
_HALF_PI_2 = 6.077100506303966e-11
_HALF_PI_3 = 2.0222662487959506e-21


# --- elementary functions of lanes, and of complex numbers in lanes ---


@inner(forceinline=True)
def _sin_cos(x):
    """Sine and cosine of lanes by Taylor series on [-pi/4, pi/4]; no library call, so the same bits everywhere."""
    k = nearest(x * splat(_TWO_OVER_PI))
    r = fnma(k, splat(_HALF_PI_1), x)
    r = fnma(k, splat(_HALF_PI_2), r)
    r = fnma(k, splat(_HALF_PI_3), r)
    z = r * r
    s = fma(z, splat(1.0 / 355687428096000.0), splat(-1.0 / 1307674368000.0))
    s = fma(z, s, splat(1.0 / 6227020800.0))
    s = fma(z, s, splat(-1.0 / 39916800.0))
    s = fma(z, s, splat(1.0 / 362880.0))
    s = fma(z, s, splat(-1.0 / 5040.0))
    s = fma(z, s, splat(1.0 / 120.0))
    s = fma(z, s, splat(-1.0 / 6.0))
    sine = fma(z * r, s, r)
    c = fma(z, splat(-1.0 / 6402373705728000.0), splat(1.0 / 20922789888000.0))
    c = fma(z, c, splat(-1.0 / 87178291200.0))
    c = fma(z, c, splat(1.0 / 479001600.0))
    c = fma(z, c, splat(-1.0 / 3628800.0))
    c = fma(z, c, splat(1.0 / 40320.0))
    c = fma(z, c, splat(-1.0 / 720.0))
    c = fma(z, c, splat(1.0 / 24.0))
    c = fma(z, c, splat(-0.5))
    cosine = fma(z, c, splat(1.0))
    quadrant = fnma(splat(4.0), nearest(fma(k, splat(0.25), splat(-0.375))), k)  # k mod 4 in {0, 1, 2, 3}
    half, three = splat(0.5), splat(2.5)
    odd = fnma(splat(2.0), nearest(fma(k, splat(0.5), splat(-0.25))), k)  # k mod 2 in {0, 1}
    a = where_less(half, odd, cosine, sine)
    b = where_less(half, odd, sine, cosine)
    sine = where_less(splat(1.5), quadrant, negative(a), a)
    b_negative = where_less(quadrant, three, negative(b), b)
    cosine = where_less(half, quadrant, b_negative, b)
    return sine, cosine


@inner(forceinline=True)
def _times(ar, ai, br, bi):
    """Complex product."""
    return fnma(ai, bi, ar * br), fma(ai, br, ar * bi)


@inner(forceinline=True)
def _over(ar, ai, br, bi):
    """Complex quotient."""
    scale = splat(1.0) / fma(bi, bi, br * br)
    return fma(ai, bi, ar * br) * scale, fnma(ar, bi, ai * br) * scale


@inner(forceinline=True)
def _inverse(re, im):
    """One over a complex number."""
    scale = splat(1.0) / fma(im, im, re * re)
    return re * scale, negative(im * scale)


@inner(forceinline=True)
def _times_s(re, im, order, omega):
    """Product with s**order at s = i omega."""
    if order == 0:
        return re, im
    if order == 1:
        return splat(-omega) * im, splat(omega) * re
    if order == 2:
        square = splat(-omega * omega)
        return square * re, square * im
    return splat(1.0 / omega) * im, splat(-1.0 / omega) * re


# --- cost, gradient and Gram matrix ---


@inner
def _evaluate_filters(w, x, at, slope_at, omega, filters: Filters):
    """Value of every filter and its logarithmic derivative in every (filter, parameter) pair that it holds.

    Slots: ``at + 4 k`` numerator and denominator of filter k, overwritten by its value; ``slope_at + 4 q`` likewise
    for the derivatives of pair q.
    """
    filter_pair, monomial, power1, coefficient = filters.pair, filters.monomial, filters.power, filters.coefficient
    zero = splat(0.0)
    n_filters = 0
    for m in range(monomial.shape[0]):
        n_filters = max(n_filters, monomial[m, 0] + 1)
    for k in range(4 * n_filters):
        store(w, at + k, zero)
    for k in range(4 * filter_pair.shape[0]):
        store(w, slope_at + k, zero)
    for m in range(monomial.shape[0]):
        k, side, order, power2, p1, p2 = monomial[m]
        value = splat(coefficient[m])
        for _ in range(power1[m]):
            value = value * load(w, x + p1)
        for _ in range(power2):
            value = value * load(w, x + p2)
        re, im = _times_s(value, zero, order, omega)
        slot = at + 4 * k + 2 * side
        store(w, slot, load(w, slot) + re)
        store(w, slot + 1, load(w, slot + 1) + im)
        for q in range(filter_pair.shape[0]):
            if filter_pair[q, 0] != k:
                continue
            p = filter_pair[q, 1]
            if p == p1:
                power, other, other_power = power1[m], p2, power2
            elif p == p2:
                power, other, other_power = power2, p1, power1[m]
            else:
                continue
            value = splat(coefficient[m] * power)
            for _ in range(power - 1):
                value = value * load(w, x + p)
            for _ in range(other_power):
                value = value * load(w, x + other)
            re, im = _times_s(value, zero, order, omega)
            slot = slope_at + 4 * q + 2 * side
            store(w, slot, load(w, slot) + re)
            store(w, slot + 1, load(w, slot + 1) + im)
    for q in range(filter_pair.shape[0]):
        slot, own = slope_at + 4 * q, at + 4 * filter_pair[q, 0]
        nr, ni = _over(load(w, slot), load(w, slot + 1), load(w, own), load(w, own + 1))
        dr, di = _over(load(w, slot + 2), load(w, slot + 3), load(w, own + 2), load(w, own + 3))
        store(w, slot, nr - dr)
        store(w, slot + 1, ni - di)
    for k in range(n_filters):
        slot = at + 4 * k
        re, im = _over(load(w, slot), load(w, slot + 1), load(w, slot + 2), load(w, slot + 3))
        store(w, slot, re)
        store(w, slot + 1, im)


@inner(forceinline=True)
def _gains(w, x, entry, weight, at_gain):
    """Gain of every term, which does not depend on the frequency."""
    for e in range(entry.shape[0]):
        gain = splat(weight[e, 0])
        for g in range(3, 5):
            if entry[e, g] >= 0:
                gain = gain * load(w, x + entry[e, g])
        store(w, at_gain + e, gain)


@inner(forceinline=True)
def _equations(
    w, x, n, omega, stimulus, constant, entry, weight, group_delay, group_filters, filters: Filters, at_A, at_E,
    at_gain, at_filter, at_slope, filter_stride,
):  # fmt: skip
    """Equations of motion A(s) H = b(s) at ``n`` frequencies ``omega``: A and b by rows from ``at_A``.

    b is that of the ``stimulus`` (n,) that evokes the line.

    Leaves the product of delay and filters of every group from ``at_E``, and the filters from ``at_filter``.
    """
    F = BLOCK
    stride = 2 * F
    zero = splat(0.0)
    # filters, delays and their products, which the terms of a group share
    if filters.monomial.shape[0] > 0:
        for f in range(n):
            at, om = f * filter_stride, omega[f]
            _evaluate_filters(w, x, at_filter + at, at_slope + at, om, filters)
    for g in range(group_delay.shape[0]):
        at = at_E + g * stride
        delay, late = group_delay[g, 0], group_delay[g, 1]
        if delay >= 0:
            value = load(w, x + delay)
            if late >= 0:
                value = value + load(w, x + late)
            for f in range(n):
                sine, cosine = _sin_cos(splat(omega[f]) * value)
                store(w, at + f, cosine)
                store(w, at + F + f, negative(sine))
        else:
            for f in range(n):
                store(w, at + f, splat(1.0))
                store(w, at + F + f, zero)
        for c in range(4):
            k = group_filters[g, c]
            if k >= 0:
                for f in range(n):
                    own = at_filter + f * filter_stride + 4 * k
                    re, im = _times(load(w, at + f), load(w, at + F + f), load(w, own), load(w, own + 1))
                    store(w, at + f, re)
                    store(w, at + F + f, im)

    # A(s) and b(s): what does not depend on the parameters, then term by term
    for k in range(12):
        for f in range(n):
            store(w, at_A + k * F + f, splat(constant[f, k]))
    for e in range(entry.shape[0]):
        row, order, of, gain = entry[e, 0], entry[e, 1], at_E + entry[e, 2] * stride, load(w, at_gain + e)
        for c in range(2):
            if weight[e, 1 + c] != 0.0:
                at = at_A + (4 * row + 2 * c) * F
                factor = splat(weight[e, 1 + c]) * gain
                if order == 0:
                    for f in range(n):
                        store(w, at + f, fma(factor, load(w, of + f), load(w, at + f)))
                        store(w, at + F + f, fma(factor, load(w, of + F + f), load(w, at + F + f)))
                elif order == 1:
                    for f in range(n):
                        by = splat(omega[f]) * factor
                        store(w, at + f, fnma(by, load(w, of + F + f), load(w, at + f)))
                        store(w, at + F + f, fma(by, load(w, of + f), load(w, at + F + f)))
                else:
                    for f in range(n):
                        re, im = _times_s(load(w, of + f), load(w, of + F + f), order, omega[f])
                        store(w, at + f, fma(factor, re, load(w, at + f)))
                        store(w, at + F + f, fma(factor, im, load(w, at + F + f)))
        at = at_A + (8 + 2 * row) * F
        for f in range(n):
            share = weight[e, 3 + stimulus[f]]
            if share != 0.0:
                factor = splat(-share) * gain
                re, im = load(w, of + f), load(w, of + F + f)
                if order == 1:  # rounded as above
                    by = splat(omega[f]) * factor
                    store(w, at + f, fnma(by, im, load(w, at + f)))
                    store(w, at + F + f, fma(by, re, load(w, at + F + f)))
                else:
                    re, im = _times_s(re, im, order, omega[f])
                    store(w, at + f, fma(factor, re, load(w, at + f)))
                    store(w, at + F + f, fma(factor, im, load(w, at + F + f)))


@inner(forceinline=True)
def _solved(w, at):
    """Inverse of A(s) by the adjugate, and H = A^-1 b, at one frequency, from slot ``at`` on."""
    F = BLOCK
    ar, ai = load(w, at), load(w, at + F)
    br, bi = load(w, at + 2 * F), load(w, at + 3 * F)
    cr, ci = load(w, at + 4 * F), load(w, at + 5 * F)
    dr, di = load(w, at + 6 * F), load(w, at + 7 * F)
    pr, pi = _times(ar, ai, dr, di)
    qr, qi = _times(br, bi, cr, ci)
    det_r, det_i = _inverse(pr - qr, pi - qi)
    ar, ai = _times(ar, ai, det_r, det_i)
    br, bi = _times(br, bi, det_r, det_i)
    cr, ci = _times(cr, ci, det_r, det_i)
    dr, di = _times(dr, di, det_r, det_i)
    f0r, f0i = load(w, at + 8 * F), load(w, at + 9 * F)
    f1r, f1i = load(w, at + 10 * F), load(w, at + 11 * F)
    pr, pi = _times(dr, di, f0r, f0i)
    qr, qi = _times(br, bi, f1r, f1i)
    h0r, h0i = pr - qr, pi - qi
    pr, pi = _times(ar, ai, f1r, f1i)
    qr, qi = _times(cr, ci, f0r, f0i)
    h1r, h1i = pr - qr, pi - qi
    return ar, ai, br, bi, cr, ci, dr, di, h0r, h0i, h1r, h1i


@inner(forceinline=True)
def _residual(w, at, y0r, y0i, y1r, y1i):
    """Weighted residual W (y - data) at one frequency, whose data and weights begin at slot ``at``."""
    w00, w11, w10r, w10i = load(w, at + 4), load(w, at + 5), load(w, at + 6), load(w, at + 7)
    e0r, e0i = y0r - load(w, at), y0i - load(w, at + 1)
    e1r, e1i = y1r - load(w, at + 2), y1i - load(w, at + 3)
    pr, pi = _times(w10r, w10i, e0r, e0i)
    return w00 * e0r, w00 * e0i, fma(w11, e1r, pr), fma(w11, e1i, pi)


@inner
def _add(w, slot, value):
    """Add lanes to a slot."""
    store(w, slot, load(w, slot) + value)


@inner(forceinline=True)
def _tile(w, left, right, gram, stride, n):
    """Add Re(conj(left_i) right_j), summed over ``n`` frequencies, to the nine slots of a 3 x 3 tile.

    Column i of ``left`` and of ``right`` begins ``i * stride`` slots on; real parts of all frequencies, then imaginary.
    """
    c00, c01, c02 = load(w, gram), load(w, gram + 1), load(w, gram + 2)
    c10, c11, c12 = load(w, gram + 3), load(w, gram + 4), load(w, gram + 5)
    c20, c21, c22 = load(w, gram + 6), load(w, gram + 7), load(w, gram + 8)
    for part in range(2):
        for f in range(part * BLOCK, part * BLOCK + n):
            a0, a1, a2 = load(w, left + f), load(w, left + stride + f), load(w, left + 2 * stride + f)
            b0, b1, b2 = load(w, right + f), load(w, right + stride + f), load(w, right + 2 * stride + f)
            c00, c01, c02 = fma(a0, b0, c00), fma(a0, b1, c01), fma(a0, b2, c02)
            c10, c11, c12 = fma(a1, b0, c10), fma(a1, b1, c11), fma(a1, b2, c12)
            c20, c21, c22 = fma(a2, b0, c20), fma(a2, b1, c21), fma(a2, b2, c22)
    store(w, gram, c00)
    store(w, gram + 1, c01)
    store(w, gram + 2, c02)
    store(w, gram + 3, c10)
    store(w, gram + 4, c11)
    store(w, gram + 5, c12)
    store(w, gram + 6, c20)
    store(w, gram + 7, c21)
    store(w, gram + 8, c22)


@compiled(allocates=False, seconds=8)
def evaluate(plan: Plan, work: Workspace) -> None:
    """Cost, gradient and Gram matrix at the parameters in ``work.trial``; a few frequencies at a time.

    ``work.gram_trial`` receives the lower triangle, row by row, of [J r]^T [J r]: P (P + 1) / 2 slots of J^T J, then P
    of the gradient J^T r, then the cost r^T r.

    A parameter moves the residual through the torques it makes: J_p = B t_p, with B (2 x 2) the same for all. Most
    parameters act on a single row k: J_p = b_k t_p with one complex number t_p and b_k the column of B scaled to unit
    length (t_p takes the length). Their products are Re(conj(t_p) t_q) within a row and Re(conj(t_p) rho t_q) between
    rows, rho = b_1^H b_0: half the work of whole columns. ``plan.single`` lists these parameters; the few others
    (``plan.both``) and the residual are whole columns. ``plan.column`` says where t of a (parameter, row) is kept.
    """
    # what is handed in
    w, x, gram, data = work.w, work.trial, work.gram_trial, work.data
    omega, constant, entry, weight = plan.omega, plan.constant, plan.entry, plan.weight
    sensed, sensed_weight, stimulus = plan.sensed, plan.sensed_weight, plan.stimulus
    group_delay, group_filters = plan.group_delay, plan.group_filters
    filter_pair, monomial, output_filter = plan.filters.pair, plan.filters.monomial, plan.filters.output
    single, both, column, delay_first, cleared = plan.single, plan.both, plan.column, plan.delay_first, plan.cleared

    # sizes, and slots of the scratch
    P, E, G = column.shape[0], entry.shape[0], group_delay.shape[0]
    Q, S, N = filter_pair.shape[0], sensed.shape[0], omega.shape[0]
    W, C = single.shape[1], both.shape[0]
    T = W // 3
    n_triangle = (P + 1) * (P + 2) // 2
    n_tiles = T * (2 * T + 1)
    zero = splat(0.0)
    F = BLOCK
    at_A = work.scratch
    at_E = at_A + 12 * F
    at_B = at_E + 2 * G * F
    at_rho = at_B + 8 * F
    at_v = at_rho + 2 * F
    at_H = at_v + 4 * F
    at_norm = at_H + 4 * F
    at_r = at_norm + 2 * F
    at_Z = at_r + 4 * F
    at_p = at_Z + 2 * S * F
    at_group = at_p + 2 * F
    at_T = at_group + 4 * G * F
    at_cross = at_T + 4 * (W + C) * F
    at_column = at_cross + 2 * W * F
    at_tiles = at_column + 8 * C * F
    at_gain = at_tiles + 9 * n_tiles
    at_filter = at_gain + E
    at_slope = at_filter + 4 * (monomial.shape[0] + 1)
    filter_stride = 4 * (monomial.shape[0] + 1) + 4 * Q
    stride = 2 * F

    # sums that begin at zero, and gains, which do not depend on the frequency
    for k in range(n_triangle):
        store(w, gram + k, zero)
    for k in range(9 * n_tiles):
        store(w, at_tiles + k, zero)
    for k in range(2 * W):
        if single[k // W, k % W] < 0:
            for f in range(stride):
                store(w, at_T + k * stride + f, zero)
                if k >= W:
                    store(w, at_cross + (k - W) * stride + f, zero)
    _gains(w, x, entry, weight, at_gain)

    for first in range(0, N, F):
        n = min(F, N - first)

        _equations(
            w, x, n, omega[first : first + n], stimulus[first : first + n], constant[first : first + n], entry, weight,
            group_delay, group_filters, plan.filters, at_A, at_E, at_gain, at_filter, at_slope, filter_stride,
        )  # fmt: skip

        cost = load(w, gram + n_triangle - 1)
        for f in range(n):
            # H = A^-1 b; M = A^-1 with the output filters on its rows
            ar, ai, br, bi, cr, ci, dr, di, h0r, h0i, h1r, h1i = _solved(w, at_A + f)
            at = at_H + f
            store(w, at, h0r)
            store(w, at + F, h0i)
            store(w, at + 2 * F, h1r)
            store(w, at + 3 * F, h1i)
            y0r, y0i, y1r, y1i = h0r, h0i, h1r, h1i
            m00r, m00i, m01r, m01i = dr, di, negative(br), negative(bi)
            m10r, m10i, m11r, m11i = negative(cr), negative(ci), ar, ai
            k = output_filter[0]
            if k >= 0:
                at = at_filter + f * filter_stride + 4 * k
                fr, fi = load(w, at), load(w, at + 1)
                y0r, y0i = _times(y0r, y0i, fr, fi)
                m00r, m00i = _times(m00r, m00i, fr, fi)
                m01r, m01i = _times(m01r, m01i, fr, fi)
            k = output_filter[1]
            if k >= 0:
                at = at_filter + f * filter_stride + 4 * k
                fr, fi = load(w, at), load(w, at + 1)
                y1r, y1i = _times(y1r, y1i, fr, fi)
                m10r, m10i = _times(m10r, m10i, fr, fi)
                m11r, m11i = _times(m11r, m11i, fr, fi)

            # weighted residual W (H - y), and B = -W M, the response of the residual to a torque on each row
            at = data + 8 * (first + f)
            w00, w11, w10r, w10i = load(w, at + 4), load(w, at + 5), load(w, at + 6), load(w, at + 7)
            r0r, r0i, r1r, r1i = _residual(w, at, y0r, y0i, y1r, y1i)
            cost = fma(r1i, r1i, fma(r1r, r1r, fma(r0i, r0i, fma(r0r, r0r, cost))))
            for row in range(2):
                if row == 1:
                    m00r, m00i, m10r, m10i = m01r, m01i, m11r, m11i
                pr, pi = _times(w10r, w10i, m00r, m00i)
                b0r, b0i = negative(w00 * m00r), negative(w00 * m00i)
                b1r, b1i = negative(fma(w11, m10r, pr)), negative(fma(w11, m10i, pi))
                square = fma(b1i, b1i, fma(b1r, b1r, fma(b0i, b0i, b0r * b0r)))
                norm = root(square)
                scale = where_less(zero, square, splat(1.0) / norm, zero)  # a padded row moves nothing
                b0r, b0i, b1r, b1i = scale * b0r, scale * b0i, scale * b1r, scale * b1i
                store(w, at_norm + row * F + f, norm)
                at = at_v + row * stride + f
                store(w, at, fma(b1i, r1i, fma(b1r, r1r, fma(b0i, r0i, b0r * r0r))))
                store(w, at + F, fnma(b1i, r1r, fma(b1r, r1i, fnma(b0i, r0r, b0r * r0i))))
                at = at_B + 4 * row * F + f
                store(w, at, b0r)
                store(w, at + F, b0i)
                store(w, at + 2 * F, b1r)
                store(w, at + 3 * F, b1i)
                if row == 0:
                    c0r, c0i, c1r, c1i = b0r, b0i, b1r, b1i
                else:  # b_0^H b_1
                    store(w, at_rho + f, fma(c1i, b1i, fma(c1r, b1r, fma(c0i, b0i, c0r * b0r))))
                    store(w, at_rho + F + f, fnma(c1i, b1r, fma(c1r, b1i, fnma(c0i, b0r, c0r * b0i))))
            if C > 0:
                store(w, at_r + f, r0r)
                store(w, at_r + F + f, r0i)
                store(w, at_r + 2 * F + f, r1r)
                store(w, at_r + 3 * F + f, r1i)
        store(w, gram + n_triangle - 1, cost)

        # what each distinct (row, sense) passes on
        for c in range(S):
            w0, w1 = splat(sensed_weight[c, 0]), splat(sensed_weight[c, 1])
            for f in range(n):
                w2 = splat(sensed_weight[c, 2 + stimulus[first + f]])
                at, to, norm = at_H + f, at_Z + c * stride + f, load(w, at_norm + sensed[c] * F + f)
                store(w, to, norm * fma(w0, load(w, at), fma(w1, load(w, at + 2 * F), w2)))
                store(w, to + F, norm * fma(w0, load(w, at + F), w1 * load(w, at + 3 * F)))

        # torques of the parameters: gains term by term; delays and filters through their group
        for k in range(cleared.shape[0]):
            for f in range(stride):
                store(w, at_T + cleared[k] * stride + f, zero)
        for e in range(E):
            row, order, group, p = entry[e, 0], entry[e, 1], entry[e, 2], entry[e, 3]
            of, z = at_E + group * stride, at_Z + entry[e, 5] * stride
            direct = entry[e, 8] != 0 and entry[e, 4] < 0 and weight[e, 0] == 1.0
            to = at_T + column[p, row] * stride if direct else at_p
            if order == 0:
                for f in range(n):
                    pr, pi = _times(load(w, of + f), load(w, of + F + f), load(w, z + f), load(w, z + F + f))
                    store(w, to + f, pr)
                    store(w, to + F + f, pi)
            else:
                for f in range(n):
                    pr, pi = _times(load(w, of + f), load(w, of + F + f), load(w, z + f), load(w, z + F + f))
                    pr, pi = _times_s(pr, pi, order, omega[first + f])
                    store(w, to + f, pr)
                    store(w, to + F + f, pi)
            if not direct:
                for g in range(3, 5):
                    p = entry[e, g]
                    if p >= 0:
                        factor = splat(weight[e, 0])
                        other = entry[e, 7 - g]
                        if other >= 0:
                            factor = factor * load(w, x + other)
                        _gather(w, at_T + column[p, row] * stride, to, factor, entry[e, 5 + g], n)
            if entry[e, 6] != 0:
                _gather(w, at_group + (2 * group + row) * stride, to, load(w, at_gain + e), entry[e, 7], n)
        for g in range(G):
            for row in range(2):
                if delay_first[g, 0, row] < 0:
                    continue
                of = at_group + (2 * g + row) * stride
                for k in range(2):
                    p = group_delay[g, k]
                    if p < 0:
                        continue
                    at = at_T + column[p, row] * stride
                    if delay_first[g, k, row] == 1:
                        for f in range(n):
                            om = splat(omega[first + f])
                            store(w, at + f, om * load(w, of + F + f))
                            store(w, at + F + f, negative(om * load(w, of + f)))
                    else:
                        for f in range(n):
                            om = splat(omega[first + f])
                            store(w, at + f, fma(om, load(w, of + F + f), load(w, at + f)))
                            store(w, at + F + f, fnma(om, load(w, of + f), load(w, at + F + f)))
                for q in range(Q):
                    for c in range(4):
                        if group_filters[g, c] == filter_pair[q, 0]:
                            at = at_T + column[filter_pair[q, 1], row] * stride
                            for f in range(n):
                                own = at_slope + f * filter_stride + 4 * q
                                pr, pi = _times(load(w, of + f), load(w, of + F + f), load(w, own), load(w, own + 1))
                                _add(w, at + f, pr)
                                _add(w, at + F + f, pi)

        # products among single-row parameters, and with the residual
        for i in range(W):
            if single[1, i] >= 0:
                of, to = at_T + (W + i) * stride, at_cross + i * stride
                for f in range(n):
                    pr, pi = _times(load(w, at_rho + f), load(w, at_rho + F + f), load(w, of + f), load(w, of + F + f))
                    store(w, to + f, pr)
                    store(w, to + F + f, pi)
        tile = at_tiles
        for i in range(2 * T):
            for j in range(i + 1):
                left = at_T + 3 * i * stride
                if i >= T and j < T:
                    left = at_cross + 3 * (i - T) * stride
                _tile(w, left, at_T + 3 * j * stride, tile, stride, n)
                tile += 9
        for k in range(2 * W):
            j = single[k // W, k % W]
            if j >= 0:
                _products(w, gram + P * (P + 1) // 2 + j, at_v + (k // W) * stride, at_T + k * stride, n)

        # whole columns: the parameters that act on both rows or on the output
        for c in range(C):
            p, whole = both[c], at_column + 8 * c * F
            of = at_T + (2 * W + 2 * c) * stride
            for f in range(n):
                for k in range(2):
                    at = at_B + 2 * k * F + f
                    pr, pi = _times(load(w, at), load(w, at + F), load(w, of + f), load(w, of + F + f))
                    at += 4 * F
                    qr, qi = _times(
                        load(w, at), load(w, at + F), load(w, of + stride + f), load(w, of + stride + F + f)
                    )
                    store(w, whole + k * stride + f, pr + qr)
                    store(w, whole + k * stride + F + f, pi + qi)
            for q in range(Q):
                if filter_pair[q, 1] == p:
                    for f in range(n):
                        _filtered_output(
                            w,
                            whole + f,
                            at_H + f,
                            data + 8 * (first + f) + 4,
                            at_filter + f * filter_stride,
                            at_slope + f * filter_stride + 4 * q,
                            filter_pair[q, 0],
                            output_filter,
                        )
            for f in range(n):
                c0r, c0i = load(w, whole + f), load(w, whole + F + f)
                c1r, c1i = load(w, whole + 2 * F + f), load(w, whole + 3 * F + f)
                for row in range(2):
                    at = at_B + 4 * row * F + f
                    b0r, b0i, b1r, b1i = load(w, at), load(w, at + F), load(w, at + 2 * F), load(w, at + 3 * F)
                    to = whole + (4 + 2 * row) * F + f
                    store(w, to, fma(b1i, c1i, fma(b1r, c1r, fma(b0i, c0i, b0r * c0r))))
                    store(w, to + F, fnma(b1i, c1r, fma(b1r, c1i, fnma(b0i, c0r, b0r * c0i))))
            for k in range(2 * W):
                j = single[k // W, k % W]
                if j >= 0:
                    to = gram + max(p, j) * (max(p, j) + 1) // 2 + min(p, j)
                    _products(w, to, whole + (4 + 2 * (k // W)) * F, at_T + k * stride, n)
            for other in range(c + 1):
                j, right = both[other], at_column + 8 * other * F
                to = gram + max(p, j) * (max(p, j) + 1) // 2 + min(p, j)
                _products(w, to, whole, right, n)
                _products(w, to, whole + stride, right + stride, n)
            _products(w, gram + P * (P + 1) // 2 + p, whole, at_r, n)
            _products(w, gram + P * (P + 1) // 2 + p, whole + stride, at_r + stride, n)

    # the tiles into their places of the lower triangle
    tile = at_tiles
    for i in range(2 * T):
        for j in range(i + 1):
            for k in range(9):
                a, b = 3 * i + k // 3, 3 * j + k % 3
                if a >= b:
                    p, q = single[a // W, a % W], single[b // W, b % W]
                    if p >= 0 and q >= 0:
                        store(w, gram + max(p, q) * (max(p, q) + 1) // 2 + min(p, q), load(w, tile + k))
            tile += 9


@compiled(allocates=False, seconds=3)
def evaluate_cost(plan: Plan, work: Workspace) -> None:
    """The cost alone at the parameters in ``work.trial``, as `evaluate` computes it, to the last slot of its sums."""
    w, x, data, omega, output_filter = work.w, work.trial, work.data, plan.omega, plan.filters.output
    P, E, G, N = plan.column.shape[0], plan.entry.shape[0], plan.group_delay.shape[0], plan.omega.shape[0]
    F = BLOCK
    at_A = work.scratch
    at_E = at_A + 12 * F
    at_gain = at_E + 2 * G * F
    at_filter = at_gain + E
    at_slope = at_filter + 4 * (plan.filters.monomial.shape[0] + 1)
    filter_stride = 4 * (plan.filters.monomial.shape[0] + 1) + 4 * plan.filters.pair.shape[0]
    _gains(w, x, plan.entry, plan.weight, at_gain)
    cost = splat(0.0)
    for first in range(0, N, F):
        n = min(F, N - first)
        _equations(
            w, x, n, omega[first : first + n], plan.stimulus[first : first + n], plan.constant[first : first + n],
            plan.entry, plan.weight, plan.group_delay, plan.group_filters, plan.filters, at_A, at_E, at_gain,
            at_filter, at_slope, filter_stride,
        )  # fmt: skip
        for f in range(n):
            _, _, _, _, _, _, _, _, y0r, y0i, y1r, y1i = _solved(w, at_A + f)
            k = output_filter[0]
            if k >= 0:
                at = at_filter + f * filter_stride + 4 * k
                y0r, y0i = _times(y0r, y0i, load(w, at), load(w, at + 1))
            k = output_filter[1]
            if k >= 0:
                at = at_filter + f * filter_stride + 4 * k
                y1r, y1i = _times(y1r, y1i, load(w, at), load(w, at + 1))
            r0r, r0i, r1r, r1i = _residual(w, data + 8 * (first + f), y0r, y0i, y1r, y1i)
            cost = fma(r1i, r1i, fma(r1r, r1r, fma(r0i, r0i, fma(r0r, r0r, cost))))
    store(w, work.gram_trial + (P + 1) * (P + 2) // 2 - 1, cost)


@inner(forceinline=True)
def _gather(w, to, of, factor, first, n):
    """Set (``first``) or add ``factor`` times complex numbers at ``n`` frequencies."""
    if first != 0:
        for f in range(n):
            store(w, to + f, factor * load(w, of + f))
            store(w, to + BLOCK + f, factor * load(w, of + BLOCK + f))
    else:
        for f in range(n):
            store(w, to + f, fma(factor, load(w, of + f), load(w, to + f)))
            store(w, to + BLOCK + f, fma(factor, load(w, of + BLOCK + f), load(w, to + BLOCK + f)))


@inner(forceinline=True)
def _products(w, to, left, right, n):
    """Add Re(conj(left) right), summed over ``n`` frequencies, to one slot."""
    total, more = load(w, to), splat(0.0)
    for f in range(n):
        total = fma(load(w, left + f), load(w, right + f), total)
        more = fma(load(w, left + BLOCK + f), load(w, right + BLOCK + f), more)
    store(w, to, total + more)


@inner
def _filtered_output(w, column, at_h, at_weight, at_filter, at_slope, number, output_filter):
    """Add to one column, at one frequency, what a parameter does to the measured angles through an output filter."""
    w00, w11, w10r, w10i = load(w, at_weight), load(w, at_weight + 1), load(w, at_weight + 2), load(w, at_weight + 3)
    sr, si = load(w, at_slope), load(w, at_slope + 1)
    if output_filter[0] == number:
        own = at_filter + 4 * number
        yr, yi = _times(load(w, at_h), load(w, at_h + BLOCK), load(w, own), load(w, own + 1))
        pr, pi = _times(yr, yi, sr, si)
        qr, qi = _times(w10r, w10i, pr, pi)
        _add(w, column, w00 * pr)
        _add(w, column + BLOCK, w00 * pi)
        _add(w, column + 2 * BLOCK, qr)
        _add(w, column + 3 * BLOCK, qi)
    if output_filter[1] == number:
        own = at_filter + 4 * number
        yr, yi = _times(load(w, at_h + 2 * BLOCK), load(w, at_h + 3 * BLOCK), load(w, own), load(w, own + 1))
        pr, pi = _times(yr, yi, sr, si)
        _add(w, column + 2 * BLOCK, w11 * pr)
        _add(w, column + 3 * BLOCK, w11 * pi)


# --- one step of eight fits ---


@inner
def _solve(w, matrix, right, n):
    """Solve a positive definite system in place, L D L^T by columns: the updates of a column wait for none another.

    ``matrix`` holds the lower triangle row by row, ``right`` the right-hand side and then the solution.
    """
    for k in range(n):
        column = matrix + k  # entry (i, k) lies i (i + 1) / 2 further on
        inverse = splat(1.0) / load(w, column + k * (k + 1) // 2)
        store(w, column + k * (k + 1) // 2, inverse)
        last = load(w, right + k)
        for i in range(k + 1, n):
            row = matrix + i * (i + 1) // 2
            factor = load(w, row + k) * inverse
            store(w, right + i, fnma(factor, last, load(w, right + i)))
            for j in range(k + 1, i + 1):
                store(w, row + j, fnma(factor, load(w, column + j * (j + 1) // 2), load(w, row + j)))
        store(w, right + k, last * inverse)
    for i in range(n - 1, 0, -1):  # back substitution; (i, k) still holds the product with the pivot of k
        row, found = matrix + i * (i + 1) // 2, load(w, right + i)
        for k in range(i):
            factor = load(w, row + k) * load(w, matrix + k * (k + 1) // 2 + k)
            store(w, right + k, fnma(factor, found, load(w, right + k)))


@compiled(allocates=False)
def bounded_step(work: Workspace, bounds: Bounds):
    """One damped Gauss-Newton step inside the bounds for every lane; returns nothing, fills ``step`` and ``trial``.

    ``held`` is 1 where a parameter sits on a bound or has been put on a side of the box of allowed steps; the others
    are then solved again.
    """
    w, x, trial, gram = work.w, work.x, work.trial, work.gram
    held, matrix, step = work.held, work.matrix, work.step
    lower, upper = bounds.lower, bounds.upper
    P = lower.size
    one, zero = splat(1.0), splat(0.0)
    gradient = gram + P * (P + 1) // 2
    curvature = zero
    for i in range(P):
        curvature = fma(load(w, gram + i * (i + 1) // 2 + i), splat((upper[i] - lower[i]) ** 2 / P), curvature)
    ridge = curvature * load(w, work.damping)
    for i in range(P):  # held from the start: on a bound, and downhill is outside
        at, g = load(w, x + i), load(w, gradient + i)
        low, high = splat(lower[i]), splat(upper[i])
        on_low = where_less(low, at, zero, where_less(zero, g, one, zero))
        on_high = where_less(at, high, zero, where_less(g, zero, one, zero))
        store(w, held + i, on_low + on_high)
        store(w, step + i, zero)
    for k in range(P):
        for i in range(P):
            hold_i = load(w, held + i)
            free_i = one - hold_i
            row = gram + i * (i + 1) // 2
            right = negative(load(w, gradient + i))
            if k > 0:  # before, nothing that is held has moved
                for j in range(P):
                    at = row + j if j <= i else gram + j * (j + 1) // 2 + i
                    right = fnma(load(w, at), load(w, step + j) * load(w, held + j), right)
            store(w, trial + i, fma(free_i, right, hold_i * load(w, step + i)))
            at = matrix + i * (i + 1) // 2
            for j in range(i):
                store(w, at + j, load(w, row + j) * (free_i * (one - load(w, held + j))))
            diagonal = load(w, row + i)
            diagonal = where_less(zero, diagonal, diagonal, splat(1e-300))
            store(w, at + i, fma(free_i, fma(ridge, splat((upper[i] - lower[i]) ** -2), diagonal), hold_i))
        _solve(w, matrix, trial, P)
        crossed = zero
        for i in range(P):
            at, hold = load(w, x + i), load(w, held + i)
            to_low, to_high = splat(lower[i]) - at, splat(upper[i]) - at
            longest = splat(LONGEST * (upper[i] - lower[i]))
            to_low = where_less(to_low, negative(longest), negative(longest), to_low)
            to_high = where_less(longest, to_high, longest, to_high)
            full = load(w, trial + i)
            clipped = where_less(full, to_low, to_low, where_less(to_high, full, to_high, full))
            moved = where_less(zero, hold, load(w, step + i), clipped)
            out = where_less(full, to_low, one, where_less(to_high, full, one, zero)) * (one - hold)
            store(w, step + i, moved)
            store(w, held + i, hold + out)
            crossed = crossed + out
        store(w, matrix, crossed)
        again = False
        for lane in range(WIDTH):
            if w[matrix * WIDTH + lane] > 0.0:
                again = True
        if not again:
            break
    for i in range(P):
        goal = load(w, x + i) + load(w, step + i)
        low, high = splat(lower[i]), splat(upper[i])
        goal = where_less(goal, low, low, where_less(high, goal, high, goal))
        store(w, trial + i, goal)
        store(w, step + i, goal - load(w, x + i))


@inner
def _predicted(work: Workspace, P):
    """Decrease of the cost that the quadratic model predicts for ``step``: -(2 g + G p) . p, per lane."""
    w, gram, step = work.w, work.gram, work.step
    gradient = gram + P * (P + 1) // 2
    total = splat(0.0)
    for i in range(P):
        row, inner = gram + i * (i + 1) // 2, load(w, gradient + i)
        for j in range(i):
            inner = fma(load(w, row + j), load(w, step + j), inner)
        inner = fma(splat(0.5) * load(w, row + i), load(w, step + i), inner)
        total = fnma(inner, load(w, step + i), total)
    return total + total


@inner
def _steepest(work: Workspace, lane, bounds: Bounds):
    """Most that moving one parameter alone, inside its bounds, is predicted to lower the cost."""
    w, x, gram = work.w, work.x, work.gram
    lower, upper = bounds.lower, bounds.upper
    P = lower.size
    most = 0.0
    for p in range(P):
        at, g = w[(x + p) * WIDTH + lane], w[(gram + P * (P + 1) // 2 + p) * WIDTH + lane]
        curvature = w[(gram + p * (p + 1) // 2 + p) * WIDTH + lane]
        room = at - lower[p] if g > 0.0 else upper[p] - at
        move = min(abs(g) / curvature if curvature > 0.0 else room, room)
        most = max(most, (2.0 * abs(g) - curvature * move) * move)
    return most


# --- the queue of fits ---


@compiled(allocates=False)
def begin(work: Workspace, lane, queue: Queue, index, bounds: Bounds):
    """Put a start of the queue and its problem into a lane; returns the cost below which only rounding is left."""
    w, start, packed = work.w, queue.starts[index], queue.packed[queue.problem[index]]
    for p in range(start.size):
        w[(work.trial + p) * WIDTH + lane] = min(max(start[p], bounds.lower[p]), bounds.upper[p])
    norm = 0.0
    for n in range(packed.size // 8):
        y0r, y0i, y1r, y1i, w00, w11, w10r, w10i = packed[8 * n : 8 * n + 8]
        e1r, e1i = w11 * y1r + w10r * y0r - w10i * y0i, w11 * y1i + w10r * y0i + w10i * y0r
        norm += w00 * w00 * (y0r * y0r + y0i * y0i) + e1r * e1r + e1i * e1i
        for k in range(8):
            w[(work.data + 8 * n + k) * WIDTH + lane] = packed[8 * n + k]
    w[work.damping * WIDTH + lane] = LAMBDA_START
    return ROUNDING * norm


@calling(evaluate)
def levenberg_marquardt(
    evaluate: int,
    plan: Plan,
    work: Workspace,
    lanes: LaneStates,
    queue: Queue,
    bounds: Bounds,
    rules: StopRules,
    out: Outcomes,
) -> None:
    """Fit every start of the queue inside bounds (P,) and fill ``out``."""
    n_fits, P = queue.starts.shape
    w, at_x, at_trial, at_damping, at_matrix = work.w, work.x, work.trial, work.damping, work.matrix
    at_gram, at_gram_trial = work.gram, work.gram_trial
    n_triangle = (P + 1) * (P + 2) // 2
    at_cost, at_cost_trial = at_gram + n_triangle - 1, at_gram_trial + n_triangle - 1
    fit, fresh, evaluations, outcome = lanes.fit, lanes.fresh, lanes.evaluations, lanes.outcome
    growth, floor, predicted = lanes.growth, lanes.floor, lanes.predicted
    half = splat(0.5)
    next_fit = np.int64(0)  # a literal 0 would be a type of its own: `begin` would be compiled twice
    running = 0
    for lane in range(WIDTH):  # every lane begins with some start, so that idle lanes hold finite numbers
        index = min(next_fit, n_fits - 1)
        floor[lane] = begin(work, lane, queue, index, bounds)
        if next_fit < n_fits:
            fit[lane], fresh[lane] = next_fit, True
            next_fit += 1
            running += 1

    while running > 0:
        call(evaluate, plan, work)
        store(w, at_matrix, splat(0.0))
        for lane in range(WIDTH):
            if fit[lane] < 0:
                continue
            new, old = w[at_cost_trial * WIDTH + lane], w[at_cost * WIDTH + lane]
            evaluations[lane] += 1
            accept = fresh[lane] or new < old
            if fresh[lane]:
                if not np.isfinite(new):
                    outcome[lane] = NON_FINITE_MODEL
            elif accept:
                ratio = (old - new) / predicted[lane]
                damping = w[at_damping * WIDTH + lane] * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
                w[at_damping * WIDTH + lane] = max(damping, LAMBDA_LEAST)
                growth[lane] = 2.0
            else:
                w[at_damping * WIDTH + lane] *= growth[lane]
                growth[lane] *= 2.0
                if w[at_damping * WIDTH + lane] > LAMBDA_MOST:
                    outcome[lane] = STALLED
            fresh[lane] = False
            if accept:
                w[at_matrix * WIDTH + lane] = 1.0
                if new <= floor[lane]:
                    outcome[lane] = CONVERGED
        accepted = load(w, at_matrix)
        for k in range(n_triangle):
            store(w, at_gram + k, where_less(half, accepted, load(w, at_gram_trial + k), load(w, at_gram + k)))
        for p in range(P):
            store(w, at_x + p, where_less(half, accepted, load(w, at_trial + p), load(w, at_x + p)))

        bounded_step(work, bounds)
        store(w, at_matrix, _predicted(work, P))
        for lane in range(WIDTH):
            if fit[lane] < 0:
                continue
            predicted[lane] = w[at_matrix * WIDTH + lane]
            least = rules.tolerance * w[at_cost * WIDTH + lane]
            settled = predicted[lane] <= least and w[at_damping * WIDTH + lane] <= 1.0
            if outcome[lane] == 0 and settled and _steepest(work, lane, bounds) <= least:
                outcome[lane] = CONVERGED
            if outcome[lane] == 0 and evaluations[lane] >= rules.max_iterations:
                outcome[lane] = ITERATION_LIMIT
            if outcome[lane] == 0:
                continue
            index = fit[lane]
            for p in range(P):
                out.estimate[index, p] = w[(at_x + p) * WIDTH + lane]
            out.cost[index] = w[at_cost * WIDTH + lane]
            out.status[index] = outcome[lane]
            out.iterations[index] = evaluations[lane]
            fit[lane] = -1
            running -= 1
            if next_fit < n_fits:  # hand the lane its next start
                fit[lane], fresh[lane], evaluations[lane], growth[lane], outcome[lane] = next_fit, True, 0, 2.0, 0
                floor[lane] = begin(work, lane, queue, next_fit, bounds)
                next_fit += 1
                running += 1
