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

Slots of the workspace are counted in lanes (`mcstudy.fit.lanes`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mcstudy.fit.lanes import WIDTH, fma, fnma, load, nearest, negative, splat, store, where_less

CONVERGED, STALLED, ITERATION_LIMIT, NON_FINITE_MODEL = 1, 2, 3, 4

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


@njit(nogil=True, inline="always")
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


@njit(nogil=True, inline="always")
def _times(ar, ai, br, bi):
    """Complex product."""
    return fnma(ai, bi, ar * br), fma(ai, br, ar * bi)


@njit(nogil=True, inline="always")
def _over(ar, ai, br, bi):
    """Complex quotient."""
    scale = splat(1.0) / fma(bi, bi, br * br)
    return fma(ai, bi, ar * br) * scale, fnma(ar, bi, ai * br) * scale


@njit(nogil=True, inline="always")
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


@njit(nogil=True)
def _evaluate_filters(w, x, at, slope_at, omega, filter_pair, monomial, power1, coefficient):
    """Value of every filter and its logarithmic derivative in every (filter, parameter) pair that it holds.

    Slots: ``at + 4 k`` numerator and denominator of filter k, overwritten by its value; ``slope_at + 4 q`` likewise
    for the derivatives of pair q.
    """
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


@njit(nogil=True, cache=True)
def evaluate(
    w,
    x,
    gram,
    data,
    scratch,
    n_parameters,
    omega,
    constant,
    entry,
    weight,
    sensed,
    sensed_weight,
    group_delay,
    group_filters,
    filter_pair,
    monomial,
    power1,
    coefficient,
    output_filter,
):
    """Cost, gradient and Gram matrix at the parameters in slots ``x``; all in one pass over the frequencies.

    ``gram`` receives the lower triangle, row by row, of [J r]^T [J r]: P (P + 1) / 2 slots of J^T J, then P of the
    gradient J^T r, then the cost r^T r. ``data`` holds per frequency y1, y2 (re, im), W11, W22 and W21 (re, im).
    """
    P, E, G = n_parameters, entry.shape[0], group_delay.shape[0]
    Q, S = filter_pair.shape[0], sensed.shape[0]
    n_triangle = (P + 1) * (P + 2) // 2
    zero = splat(0.0)
    for k in range(n_triangle):
        store(w, gram + k, zero)
    at_A = scratch
    at_b = at_A + 8
    at_E = at_b + 4
    at_U = at_E + 2 * G
    at_gain = at_U + 2 * E
    at_B = at_gain + E
    at_D = at_B + 8
    at_T = at_D + 4 * S
    at_J = at_T + 4 * G
    at_filter = at_J + 4 * (P + 1)
    at_slope = at_filter + 4 * (monomial.shape[0] + 1)
    for e in range(E):
        gain = splat(weight[e, 0])
        for g in range(3, 5):
            if entry[e, g] >= 0:
                gain = gain * load(w, x + entry[e, g])
        store(w, at_gain + e, gain)

    for n in range(omega.shape[0]):
        om = omega[n]
        if monomial.shape[0] > 0:
            _evaluate_filters(w, x, at_filter, at_slope, om, filter_pair, monomial, power1, coefficient)
        for g in range(G):
            re, im = splat(1.0), zero
            if group_delay[g] >= 0:
                sine, re = _sin_cos(splat(om) * load(w, x + group_delay[g]))
                im = negative(sine)
            for c in range(4):
                k = group_filters[g, c]
                if k >= 0:
                    re, im = _times(re, im, load(w, at_filter + 4 * k), load(w, at_filter + 4 * k + 1))
            store(w, at_E + 2 * g, re)
            store(w, at_E + 2 * g + 1, im)
            for k in range(4):
                store(w, at_T + 4 * g + k, zero)

        # A(s) and b(s): what does not depend on the parameters, then term by term
        for k in range(12):
            store(w, at_A + k, splat(constant[n, k]))
        for e in range(E):
            group = entry[e, 2]
            ur, ui = _times_s(load(w, at_E + 2 * group), load(w, at_E + 2 * group + 1), entry[e, 1], om)
            store(w, at_U + 2 * e, ur)
            store(w, at_U + 2 * e + 1, ui)
            gain = load(w, at_gain + e)
            qr, qi = gain * ur, gain * ui
            for c in range(2):
                if weight[e, 1 + c] != 0.0:
                    slot, factor = at_A + 4 * entry[e, 0] + 2 * c, splat(weight[e, 1 + c])
                    store(w, slot, fma(factor, qr, load(w, slot)))
                    store(w, slot + 1, fma(factor, qi, load(w, slot + 1)))
            if weight[e, 3] != 0.0:
                slot, factor = at_b + 2 * entry[e, 0], splat(weight[e, 3])
                store(w, slot, fnma(factor, qr, load(w, slot)))
                store(w, slot + 1, fnma(factor, qi, load(w, slot + 1)))

        # H = A^-1 b by the adjugate; M = A^-1 with the output filters on its rows
        ar, ai = load(w, at_A), load(w, at_A + 1)
        br, bi = load(w, at_A + 2), load(w, at_A + 3)
        cr, ci = load(w, at_A + 4), load(w, at_A + 5)
        dr, di = load(w, at_A + 6), load(w, at_A + 7)
        pr, pi = _times(ar, ai, dr, di)
        qr, qi = _times(br, bi, cr, ci)
        det_r, det_i = _over(splat(1.0), zero, pr - qr, pi - qi)
        ar, ai = _times(ar, ai, det_r, det_i)
        br, bi = _times(br, bi, det_r, det_i)
        cr, ci = _times(cr, ci, det_r, det_i)
        dr, di = _times(dr, di, det_r, det_i)
        f0r, f0i = load(w, at_b), load(w, at_b + 1)
        f1r, f1i = load(w, at_b + 2), load(w, at_b + 3)
        pr, pi = _times(dr, di, f0r, f0i)
        qr, qi = _times(br, bi, f1r, f1i)
        h0r, h0i = pr - qr, pi - qi
        pr, pi = _times(ar, ai, f1r, f1i)
        qr, qi = _times(cr, ci, f0r, f0i)
        h1r, h1i = pr - qr, pi - qi
        y0r, y0i, y1r, y1i = h0r, h0i, h1r, h1i
        m00r, m00i, m01r, m01i = dr, di, negative(br), negative(bi)
        m10r, m10i, m11r, m11i = negative(cr), negative(ci), ar, ai
        k = output_filter[0]
        if k >= 0:
            fr, fi = load(w, at_filter + 4 * k), load(w, at_filter + 4 * k + 1)
            y0r, y0i = _times(y0r, y0i, fr, fi)
            m00r, m00i = _times(m00r, m00i, fr, fi)
            m01r, m01i = _times(m01r, m01i, fr, fi)
        k = output_filter[1]
        if k >= 0:
            fr, fi = load(w, at_filter + 4 * k), load(w, at_filter + 4 * k + 1)
            y1r, y1i = _times(y1r, y1i, fr, fi)
            m10r, m10i = _times(m10r, m10i, fr, fi)
            m11r, m11i = _times(m11r, m11i, fr, fi)

        # weighted residual W (H - y), and B = -W M, the response of the residual to a torque on each row
        at = data + 8 * n
        w00, w11, w10r, w10i = load(w, at + 4), load(w, at + 5), load(w, at + 6), load(w, at + 7)
        e0r, e0i = y0r - load(w, at), y0i - load(w, at + 1)
        e1r, e1i = y1r - load(w, at + 2), y1i - load(w, at + 3)
        last = at_J + 4 * P
        pr, pi = _times(w10r, w10i, e0r, e0i)
        store(w, last, w00 * e0r)
        store(w, last + 1, w00 * e0i)
        store(w, last + 2, fma(w11, e1r, pr))
        store(w, last + 3, fma(w11, e1i, pi))
        pr, pi = _times(w10r, w10i, m00r, m00i)
        store(w, at_B, negative(w00 * m00r))
        store(w, at_B + 1, negative(w00 * m00i))
        store(w, at_B + 2, negative(fma(w11, m10r, pr)))
        store(w, at_B + 3, negative(fma(w11, m10i, pi)))
        pr, pi = _times(w10r, w10i, m01r, m01i)
        store(w, at_B + 4, negative(w00 * m01r))
        store(w, at_B + 5, negative(w00 * m01i))
        store(w, at_B + 6, negative(fma(w11, m11r, pr)))
        store(w, at_B + 7, negative(fma(w11, m11i, pi)))

        # what each distinct (row, sense) passes on: B_row times what is sensed
        for c in range(S):
            w0, w1 = splat(sensed_weight[c, 0]), splat(sensed_weight[c, 1])
            zr = fma(w0, h0r, fma(w1, h1r, splat(sensed_weight[c, 2])))
            zi = fma(w0, h0i, w1 * h1i)
            at = at_B + 4 * sensed[c]
            pr, pi = _times(load(w, at), load(w, at + 1), zr, zi)
            qr, qi = _times(load(w, at + 2), load(w, at + 3), zr, zi)
            store(w, at_D + 4 * c, pr)
            store(w, at_D + 4 * c + 1, pi)
            store(w, at_D + 4 * c + 2, qr)
            store(w, at_D + 4 * c + 3, qi)

        # derivatives: gains term by term; delays and filters through their group
        for k in range(4 * P):
            store(w, at_J + k, zero)
        for e in range(E):
            ur, ui = load(w, at_U + 2 * e), load(w, at_U + 2 * e + 1)
            at = at_D + 4 * entry[e, 5]
            pr, pi = _times(ur, ui, load(w, at), load(w, at + 1))
            qr, qi = _times(ur, ui, load(w, at + 2), load(w, at + 3))
            for g in range(3, 5):
                p = entry[e, g]
                if p >= 0:
                    factor = splat(weight[e, 0])
                    other = entry[e, 7 - g]
                    if other >= 0:
                        factor = factor * load(w, x + other)
                    at = at_J + 4 * p
                    store(w, at, fma(factor, pr, load(w, at)))
                    store(w, at + 1, fma(factor, pi, load(w, at + 1)))
                    store(w, at + 2, fma(factor, qr, load(w, at + 2)))
                    store(w, at + 3, fma(factor, qi, load(w, at + 3)))
            group = entry[e, 2]
            if entry[e, 6] != 0:
                gain = load(w, at_gain + e)
                at = at_T + 4 * group
                store(w, at, fma(gain, pr, load(w, at)))
                store(w, at + 1, fma(gain, pi, load(w, at + 1)))
                store(w, at + 2, fma(gain, qr, load(w, at + 2)))
                store(w, at + 3, fma(gain, qi, load(w, at + 3)))
        for g in range(G):
            t0r, t0i = load(w, at_T + 4 * g), load(w, at_T + 4 * g + 1)
            t1r, t1i = load(w, at_T + 4 * g + 2), load(w, at_T + 4 * g + 3)
            if group_delay[g] >= 0:
                s = splat(om)
                at = at_J + 4 * group_delay[g]
                store(w, at, fma(s, t0i, load(w, at)))
                store(w, at + 1, fnma(s, t0r, load(w, at + 1)))
                store(w, at + 2, fma(s, t1i, load(w, at + 2)))
                store(w, at + 3, fnma(s, t1r, load(w, at + 3)))
            for q in range(Q):
                for c in range(4):
                    if group_filters[g, c] == filter_pair[q, 0]:
                        sr, si = load(w, at_slope + 4 * q), load(w, at_slope + 4 * q + 1)
                        pr, pi = _times(t0r, t0i, sr, si)
                        qr, qi = _times(t1r, t1i, sr, si)
                        at = at_J + 4 * filter_pair[q, 1]
                        store(w, at, load(w, at) + pr)
                        store(w, at + 1, load(w, at + 1) + pi)
                        store(w, at + 2, load(w, at + 2) + qr)
                        store(w, at + 3, load(w, at + 3) + qi)
        for q in range(Q):
            sr, si = load(w, at_slope + 4 * q), load(w, at_slope + 4 * q + 1)
            at = at_J + 4 * filter_pair[q, 1]
            if output_filter[0] == filter_pair[q, 0]:
                pr, pi = _times(y0r, y0i, sr, si)
                qr, qi = _times(w10r, w10i, pr, pi)
                store(w, at, fma(w00, pr, load(w, at)))
                store(w, at + 1, fma(w00, pi, load(w, at + 1)))
                store(w, at + 2, load(w, at + 2) + qr)
                store(w, at + 3, load(w, at + 3) + qi)
            if output_filter[1] == filter_pair[q, 0]:
                pr, pi = _times(y1r, y1i, sr, si)
                store(w, at + 2, fma(w11, pr, load(w, at + 2)))
                store(w, at + 3, fma(w11, pi, load(w, at + 3)))

        k = gram
        for i in range(P + 1):
            at = at_J + 4 * i
            a0, a1, a2, a3 = load(w, at), load(w, at + 1), load(w, at + 2), load(w, at + 3)
            for j in range(i + 1):
                at = at_J + 4 * j
                total = fma(a0, load(w, at), load(w, k))
                total = fma(a1, load(w, at + 1), total)
                total = fma(a2, load(w, at + 2), total)
                store(w, k, fma(a3, load(w, at + 3), total))
                k += 1


@njit(nogil=True)
def _step(w, x, trial, gram, held, matrix, step, lower, upper, damping, n_parameters, outer):
    """One damped Gauss-Newton step inside the bounds for every lane; returns nothing, fills ``step`` and ``trial``.

    ``held`` is 1 where a parameter sits on a bound or has been put on a side of the box of allowed steps; the others
    are then solved again, at most ``outer`` times.
    """
    P = n_parameters
    one, zero = splat(1.0), splat(0.0)
    gradient = gram + P * (P + 1) // 2
    curvature = zero
    for i in range(P):
        curvature = fma(load(w, gram + i * (i + 1) // 2 + i), splat((upper[i] - lower[i]) ** 2 / P), curvature)
    ridge = curvature * load(w, damping)
    for i in range(P):  # held from the start: on a bound, and downhill is outside
        at, g = load(w, x + i), load(w, gradient + i)
        low, high = splat(lower[i]), splat(upper[i])
        on_low = where_less(low, at, zero, where_less(zero, g, one, zero))
        on_high = where_less(at, high, zero, where_less(g, zero, one, zero))
        store(w, held + i, on_low + on_high)
        store(w, step + i, zero)
    for _ in range(outer):
        for i in range(P):
            hold_i = load(w, held + i)
            free_i = one - hold_i
            row = gram + i * (i + 1) // 2
            right = negative(load(w, gradient + i))
            for j in range(P):
                k = row + j if j <= i else gram + j * (j + 1) // 2 + i
                right = fnma(load(w, k), load(w, step + j) * load(w, held + j), right)
            store(w, trial + i, fma(free_i, right, hold_i * load(w, step + i)))
            at = matrix + i * (i + 1) // 2
            for j in range(i):
                store(w, at + j, load(w, row + j) * (free_i * (one - load(w, held + j))))
            diagonal = load(w, row + i)
            diagonal = where_less(zero, diagonal, diagonal, splat(1e-300))
            store(w, at + i, fma(free_i, fma(ridge, splat((upper[i] - lower[i]) ** -2), diagonal), hold_i))
        # L D L^T in place, then the two substitutions in ``trial``
        for i in range(P):
            ri = matrix + i * (i + 1) // 2
            for j in range(i):
                rj = matrix + j * (j + 1) // 2
                total = load(w, ri + j)
                for k in range(j):
                    total = fnma(load(w, ri + k), load(w, rj + k), total)
                store(w, ri + j, total)
            pivot = load(w, ri + i)
            right = load(w, trial + i)
            for j in range(i):
                raw = load(w, ri + j)
                factor = raw * load(w, matrix + j * (j + 1) // 2 + j)
                pivot = fnma(raw, factor, pivot)
                right = fnma(factor, load(w, trial + j), right)
                store(w, ri + j, factor)
            store(w, ri + i, one / pivot)
            store(w, trial + i, right)
        for i in range(P - 1, -1, -1):
            total = load(w, trial + i) * load(w, matrix + i * (i + 1) // 2 + i)
            for j in range(i + 1, P):
                total = fnma(load(w, matrix + j * (j + 1) // 2 + i), load(w, trial + j), total)
            store(w, trial + i, total)
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


@njit(nogil=True)
def _predicted(w, gram, step, n_parameters):
    """Decrease of the cost that the quadratic model predicts for ``step``: -(2 g + G p) . p, per lane."""
    P = n_parameters
    gradient = gram + P * (P + 1) // 2
    total = splat(0.0)
    for i in range(P):
        inner = splat(2.0) * load(w, gradient + i)
        for j in range(P):
            k = gram + i * (i + 1) // 2 + j if j <= i else gram + j * (j + 1) // 2 + i
            inner = fma(load(w, k), load(w, step + j), inner)
        total = fnma(inner, load(w, step + i), total)
    return total


@njit(nogil=True)
def _steepest(w, lane, x, gram, lower, upper):
    """Most that moving one parameter alone, inside its bounds, is predicted to lower the cost."""
    P = lower.size
    most = 0.0
    for p in range(P):
        at, g = w[(x + p) * WIDTH + lane], w[(gram + P * (P + 1) // 2 + p) * WIDTH + lane]
        curvature = w[(gram + p * (p + 1) // 2 + p) * WIDTH + lane]
        room = at - lower[p] if g > 0.0 else upper[p] - at
        move = min(abs(g) / curvature if curvature > 0.0 else room, room)
        most = max(most, (2.0 * abs(g) - curvature * move) * move)
    return most


@njit(nogil=True)
def _begin(w, lane, at_trial, at_data, at_damping, start, packed, lower, upper):
    """Put one start and its problem into a lane; returns the cost below which only rounding is left."""
    for p in range(start.size):
        w[(at_trial + p) * WIDTH + lane] = min(max(start[p], lower[p]), upper[p])
    norm = 0.0
    for n in range(packed.size // 8):
        y0r, y0i, y1r, y1i, w00, w11, w10r, w10i = packed[8 * n : 8 * n + 8]
        e1r, e1i = w11 * y1r + w10r * y0r - w10i * y0i, w11 * y1i + w10r * y0i + w10i * y0r
        norm += w00 * w00 * (y0r * y0r + y0i * y0i) + e1r * e1r + e1i * e1i
        for k in range(8):
            w[(at_data + 8 * n + k) * WIDTH + lane] = packed[8 * n + k]
    w[at_damping * WIDTH + lane] = LAMBDA_START
    return ROUNDING * norm


@njit(nogil=True, cache=True, error_model="numpy")
def levenberg_marquardt(
    w,
    layout,
    packed,
    starts,
    problem,
    lower,
    upper,
    tolerance,
    max_iterations,
    estimate,
    cost,
    status,
    iterations,
    omega,
    constant,
    entry,
    weight,
    sensed,
    sensed_weight,
    group_delay,
    group_filters,
    filter_pair,
    monomial,
    power1,
    coefficient,
    output_filter,
):
    """Fit every start; see `mcstudy.fit.lm` for the shapes. Results are written into the last four arrays of line 3."""
    n_fits, P = starts.shape
    at_x, at_trial, at_gram, at_gram_trial, at_held, at_matrix, at_step, at_damping, at_data, at_scratch = layout
    n_triangle = (P + 1) * (P + 2) // 2
    at_cost, at_cost_trial = at_gram + n_triangle - 1, at_gram_trial + n_triangle - 1
    fit = np.full(WIDTH, -1, dtype=np.int64)
    fresh = np.zeros(WIDTH, dtype=np.bool_)
    growth = np.full(WIDTH, 2.0)
    floor = np.zeros(WIDTH)
    predicted = np.zeros(WIDTH)
    evaluations = np.zeros(WIDTH, dtype=np.int64)
    outcome = np.zeros(WIDTH, dtype=np.int64)
    next_fit = 0
    running = 0
    for lane in range(WIDTH):  # every lane begins with some start, so that idle lanes hold finite numbers
        index = min(next_fit, n_fits - 1)
        floor[lane] = _begin(
            w, lane, at_trial, at_data, at_damping, starts[index], packed[problem[index]], lower, upper
        )
        if next_fit < n_fits:
            fit[lane], fresh[lane] = next_fit, True
            next_fit += 1
            running += 1

    while running > 0:
        evaluate(
            w,
            at_trial,
            at_gram_trial,
            at_data,
            at_scratch,
            P,
            omega,
            constant,
            entry,
            weight,
            sensed,
            sensed_weight,
            group_delay,
            group_filters,
            filter_pair,
            monomial,
            power1,
            coefficient,
            output_filter,
        )
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
                for k in range(n_triangle):
                    w[(at_gram + k) * WIDTH + lane] = w[(at_gram_trial + k) * WIDTH + lane]
                for p in range(P):
                    w[(at_x + p) * WIDTH + lane] = w[(at_trial + p) * WIDTH + lane]
                if new <= floor[lane]:
                    outcome[lane] = CONVERGED

        _step(w, at_x, at_trial, at_gram, at_held, at_matrix, at_step, lower, upper, at_damping, P, P)
        store(w, at_matrix, _predicted(w, at_gram, at_step, P))
        for lane in range(WIDTH):
            if fit[lane] < 0:
                continue
            predicted[lane] = w[at_matrix * WIDTH + lane]
            least = tolerance * w[at_cost * WIDTH + lane]
            settled = predicted[lane] <= least and w[at_damping * WIDTH + lane] <= 1.0
            if outcome[lane] == 0 and settled and _steepest(w, lane, at_x, at_gram, lower, upper) <= least:
                outcome[lane] = CONVERGED
            if outcome[lane] == 0 and evaluations[lane] >= max_iterations:
                outcome[lane] = ITERATION_LIMIT
            if outcome[lane] == 0:
                continue
            index = fit[lane]
            for p in range(P):
                estimate[index, p] = w[(at_x + p) * WIDTH + lane]
            cost[index] = w[at_cost * WIDTH + lane]
            status[index] = outcome[lane]
            iterations[index] = evaluations[lane]
            fit[lane] = -1
            running -= 1
            if next_fit < n_fits:  # hand the lane its next start
                fit[lane], fresh[lane], evaluations[lane], growth[lane], outcome[lane] = next_fit, True, 0, 2.0, 0
                floor[lane] = _begin(
                    w, lane, at_trial, at_data, at_damping, starts[next_fit], packed[problem[next_fit]], lower, upper
                )
                next_fit += 1
                running += 1
