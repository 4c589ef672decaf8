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
from mcstudy.fitting.arguments import Bounds, Filters, Lanes, LaneStates, Outcomes, Plan, Queue, StopRules, Workspace
from mcstudy.fitting.lanes import WIDTH, fma, fnma, load, nearest, negative, root, splat, store, where_less
from mcstudy.fitting.status import Status

CONVERGED, STALLED = int(Status.CONVERGED), int(Status.STALLED)
ITERATION_LIMIT, NON_FINITE_MODEL = int(Status.ITERATION_LIMIT), int(Status.NON_FINITE_MODEL)

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
def _gains(plan: Plan, work: Workspace):
    """Gain of every term, which does not depend on the frequency."""
    w, entry = work.w, plan.entry
    for e in range(entry.shape[0]):
        gain = splat(plan.weight[e, 0])
        for g in range(3, 5):
            if entry[e, g] >= 0:
                gain = gain * load(w, work.trial + entry[e, g])
        store(w, work.at.gain + e, gain)


@inner(forceinline=True)
def _groups(plan: Plan, work: Workspace, first, n):
    """Filters, delays and their products, which the terms of a group share, at ``n`` frequencies from ``first`` on."""
    w, x, at, omega = work.w, work.trial, work.at, plan.omega
    group_delay, group_filters = plan.group_delay, plan.group_filters
    F = BLOCK
    if plan.filters.monomial.shape[0] > 0:
        for f in range(n):
            move = f * at.filter_stride
            _evaluate_filters(w, x, at.filter + move, at.slope + move, omega[first + f], plan.filters)
    for g in range(group_delay.shape[0]):
        to = at.group + 2 * g * F
        delay, late = group_delay[g, 0], group_delay[g, 1]
        if delay >= 0:
            value = load(w, x + delay)
            if late >= 0:
                value = value + load(w, x + late)
            for f in range(n):
                sine, cosine = _sin_cos(splat(omega[first + f]) * value)
                store(w, to + f, cosine)
                store(w, to + F + f, negative(sine))
        else:
            for f in range(n):
                store(w, to + f, splat(1.0))
                store(w, to + F + f, splat(0.0))
        for c in range(4):
            k = group_filters[g, c]
            if k >= 0:
                for f in range(n):
                    own = at.filter + f * at.filter_stride + 4 * k
                    re, im = _times(load(w, to + f), load(w, to + F + f), load(w, own), load(w, own + 1))
                    store(w, to + f, re)
                    store(w, to + F + f, im)


@inner(forceinline=True)
def _equations(plan: Plan, work: Workspace, first, n):
    """Equations of motion A(s) H = b(s) at ``n`` frequencies from ``first`` on: A and b by rows.

    b is that of the stimulus that evokes the line.
    """
    w, at, omega, entry, weight = work.w, work.at, plan.omega, plan.entry, plan.weight
    F = BLOCK
    for k in range(12):  # what does not depend on the parameters, then term by term
        for f in range(n):
            store(w, at.matrix + k * F + f, splat(plan.constant[first + f, k]))
    for e in range(entry.shape[0]):
        row, order, of, gain = entry[e, 0], entry[e, 1], at.group + 2 * entry[e, 2] * F, load(w, at.gain + e)
        for c in range(2):
            if weight[e, 1 + c] != 0.0:
                to = at.matrix + (4 * row + 2 * c) * F
                factor = splat(weight[e, 1 + c]) * gain
                if order == 0:
                    for f in range(n):
                        store(w, to + f, fma(factor, load(w, of + f), load(w, to + f)))
                        store(w, to + F + f, fma(factor, load(w, of + F + f), load(w, to + F + f)))
                elif order == 1:
                    for f in range(n):
                        by = splat(omega[first + f]) * factor
                        store(w, to + f, fnma(by, load(w, of + F + f), load(w, to + f)))
                        store(w, to + F + f, fma(by, load(w, of + f), load(w, to + F + f)))
                else:
                    for f in range(n):
                        re, im = _times_s(load(w, of + f), load(w, of + F + f), order, omega[first + f])
                        store(w, to + f, fma(factor, re, load(w, to + f)))
                        store(w, to + F + f, fma(factor, im, load(w, to + F + f)))
        to = at.matrix + (8 + 2 * row) * F
        for f in range(n):
            share = weight[e, 3 + plan.stimulus[first + f]]
            if share != 0.0:
                factor = splat(-share) * gain
                re, im = load(w, of + f), load(w, of + F + f)
                if order == 1:  # rounded as above
                    by = splat(omega[first + f]) * factor
                    store(w, to + f, fnma(by, im, load(w, to + f)))
                    store(w, to + F + f, fma(by, re, load(w, to + F + f)))
                else:
                    re, im = _times_s(re, im, order, omega[first + f])
                    store(w, to + f, fma(factor, re, load(w, to + f)))
                    store(w, to + F + f, fma(factor, im, load(w, to + F + f)))


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


@inner(forceinline=True)
def _through(w, at, k, re, im):
    """Product with filter ``k``, whose values begin at slot ``at``; unchanged where it is none (-1)."""
    if k >= 0:
        re, im = _times(re, im, load(w, at + 4 * k), load(w, at + 4 * k + 1))
    return re, im


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


@inner(forceinline=True)
def _filtered_output(plan: Plan, work: Workspace, first, f, q, column):
    """Add to one column, at one frequency, what the parameter of pair ``q`` does to the angles by an output filter."""
    w, F, number, output = work.w, BLOCK, plan.filters.pair[q, 0], plan.filters.output
    weight, filters = work.data + 8 * (first + f) + 4, work.at.filter + f * work.at.filter_stride
    w00, w11, w10r, w10i = load(w, weight), load(w, weight + 1), load(w, weight + 2), load(w, weight + 3)
    slope = work.at.slope + f * work.at.filter_stride + 4 * q
    sr, si = load(w, slope), load(w, slope + 1)
    if output[0] == number:
        own = work.at.response + f
        yr, yi = _through(w, filters, number, load(w, own), load(w, own + F))
        pr, pi = _times(yr, yi, sr, si)
        qr, qi = _times(w10r, w10i, pr, pi)
        _add(w, column, w00 * pr)
        _add(w, column + F, w00 * pi)
        _add(w, column + 2 * F, qr)
        _add(w, column + 3 * F, qi)
    if output[1] == number:
        own = work.at.response + 2 * F + f
        yr, yi = _through(w, filters, number, load(w, own), load(w, own + F))
        pr, pi = _times(yr, yi, sr, si)
        _add(w, column + 2 * F, w11 * pr)
        _add(w, column + 3 * F, w11 * pi)


@inner(forceinline=True)
def _triangle(p, q):
    """Place of (p, q) in a lower triangle that is kept row by row."""
    return max(p, q) * (max(p, q) + 1) // 2 + min(p, q)


@inner(forceinline=True)
def _cleared(plan: Plan, work: Workspace):
    """Begin the sums over all frequencies at zero, and the places of the tiles that no parameter takes."""
    w, at, single, P = work.w, work.at, plan.single, plan.column.shape[0]
    W, stride, zero = single.shape[1], 2 * BLOCK, splat(0.0)
    for k in range((P + 1) * (P + 2) // 2):
        store(w, work.gram_trial + k, zero)
    for k in range(9 * (W // TILE) * (2 * (W // TILE) + 1)):
        store(w, at.tiles + k, zero)
    for k in range(2 * W):
        if single[k // W, k % W] < 0:
            for f in range(stride):
                store(w, at.torque + k * stride + f, zero)
                if k >= W:
                    store(w, at.cross + (k - W) * stride + f, zero)


@inner(forceinline=True)
def _residuals(plan: Plan, work: Workspace, first, n):
    """Responses H, weighted residuals r = W (H - y), and B = -W A^-1, what a torque on each row does to them.

    Columns of B have unit length, with the length kept by itself; rho is their product. The cost goes to its slot.
    """
    w, at, P, output = work.w, work.at, plan.column.shape[0], plan.filters.output
    F, zero = BLOCK, splat(0.0)
    stride = 2 * F
    at_cost = work.gram_trial + (P + 1) * (P + 2) // 2 - 1
    cost = load(w, at_cost)
    for f in range(n):
        # H = A^-1 b; M = A^-1 with the output filters on its rows
        ar, ai, br, bi, cr, ci, dr, di, h0r, h0i, h1r, h1i = _solved(w, at.matrix + f)
        store(w, at.response + f, h0r)
        store(w, at.response + F + f, h0i)
        store(w, at.response + 2 * F + f, h1r)
        store(w, at.response + 3 * F + f, h1i)
        of = at.filter + f * at.filter_stride
        y0r, y0i = _through(w, of, output[0], h0r, h0i)
        m00r, m00i = _through(w, of, output[0], dr, di)
        m01r, m01i = _through(w, of, output[0], negative(br), negative(bi))
        y1r, y1i = _through(w, of, output[1], h1r, h1i)
        m10r, m10i = _through(w, of, output[1], negative(cr), negative(ci))
        m11r, m11i = _through(w, of, output[1], ar, ai)

        of = work.data + 8 * (first + f)
        w00, w11, w10r, w10i = load(w, of + 4), load(w, of + 5), load(w, of + 6), load(w, of + 7)
        r0r, r0i, r1r, r1i = _residual(w, of, y0r, y0i, y1r, y1i)
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
            store(w, at.length + row * F + f, norm)
            to = at.projection + row * stride + f
            store(w, to, fma(b1i, r1i, fma(b1r, r1r, fma(b0i, r0i, b0r * r0r))))
            store(w, to + F, fnma(b1i, r1r, fma(b1r, r1i, fnma(b0i, r0r, b0r * r0i))))
            to = at.direction + 4 * row * F + f
            store(w, to, b0r)
            store(w, to + F, b0i)
            store(w, to + 2 * F, b1r)
            store(w, to + 3 * F, b1i)
            if row == 0:
                c0r, c0i, c1r, c1i = b0r, b0i, b1r, b1i
            else:  # b_0^H b_1
                store(w, at.rho + f, fma(c1i, b1i, fma(c1r, b1r, fma(c0i, b0i, c0r * b0r))))
                store(w, at.rho + F + f, fnma(c1i, b1r, fma(c1r, b1i, fnma(c0i, b0r, c0r * b0i))))
        if plan.both.shape[0] > 0:
            store(w, at.residual + f, r0r)
            store(w, at.residual + F + f, r0i)
            store(w, at.residual + 2 * F + f, r1r)
            store(w, at.residual + 3 * F + f, r1i)
    store(w, at_cost, cost)


@inner(forceinline=True)
def _sensed(plan: Plan, work: Workspace, first, n):
    """What each distinct (row, sense) passes on, times the length of the row's column of B."""
    w, at, sensed_weight = work.w, work.at, plan.sensed_weight
    F = BLOCK
    for c in range(plan.sensed.shape[0]):
        w0, w1 = splat(sensed_weight[c, 0]), splat(sensed_weight[c, 1])
        for f in range(n):
            w2 = splat(sensed_weight[c, 2 + plan.stimulus[first + f]])
            of, to = at.response + f, at.sensed + 2 * c * F + f
            norm = load(w, at.length + plan.sensed[c] * F + f)
            store(w, to, norm * fma(w0, load(w, of), fma(w1, load(w, of + 2 * F), w2)))
            store(w, to + F, norm * fma(w0, load(w, of + F), w1 * load(w, of + 3 * F)))


@inner(forceinline=True)
def _gain_torques(plan: Plan, work: Workspace, first, n):
    """Torques of the gains, term by term, and the sum of the terms of each group that a delay or filter shapes."""
    w, x, at = work.w, work.trial, work.at
    entry, weight, column, cleared = plan.entry, plan.weight, plan.column, plan.cleared
    F = BLOCK
    stride = 2 * F
    for k in range(cleared.shape[0]):
        for f in range(stride):
            store(w, at.torque + cleared[k] * stride + f, splat(0.0))
    for e in range(entry.shape[0]):
        row, order, group, p = entry[e, 0], entry[e, 1], entry[e, 2], entry[e, 3]
        of, z = at.group + group * stride, at.sensed + entry[e, 5] * stride
        direct = entry[e, 8] != 0 and entry[e, 4] < 0 and weight[e, 0] == 1.0
        to = at.torque + column[p, row] * stride if direct else at.product
        if order == 0:
            for f in range(n):
                pr, pi = _times(load(w, of + f), load(w, of + F + f), load(w, z + f), load(w, z + F + f))
                store(w, to + f, pr)
                store(w, to + F + f, pi)
        else:
            for f in range(n):
                pr, pi = _times(load(w, of + f), load(w, of + F + f), load(w, z + f), load(w, z + F + f))
                pr, pi = _times_s(pr, pi, order, plan.omega[first + f])
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
                    _gather(w, at.torque + column[p, row] * stride, to, factor, entry[e, 5 + g], n)
        if entry[e, 6] != 0:
            _gather(w, at.group_sum + (2 * group + row) * stride, to, load(w, at.gain + e), entry[e, 7], n)


@inner(forceinline=True)
def _group_torques(plan: Plan, work: Workspace, first, n):
    """Torques of delays and filters, through the sums of their groups."""
    w, at, omega, column = work.w, work.at, plan.omega, plan.column
    group_delay, delay_first, filter_pair = plan.group_delay, plan.delay_first, plan.filters.pair
    F = BLOCK
    stride = 2 * F
    for g in range(group_delay.shape[0]):
        for row in range(2):
            if delay_first[g, 0, row] < 0:
                continue
            of = at.group_sum + (2 * g + row) * stride
            for k in range(2):
                p = group_delay[g, k]
                if p < 0:
                    continue
                to = at.torque + column[p, row] * stride
                if delay_first[g, k, row] == 1:
                    for f in range(n):
                        om = splat(omega[first + f])
                        store(w, to + f, om * load(w, of + F + f))
                        store(w, to + F + f, negative(om * load(w, of + f)))
                else:
                    for f in range(n):
                        om = splat(omega[first + f])
                        store(w, to + f, fma(om, load(w, of + F + f), load(w, to + f)))
                        store(w, to + F + f, fnma(om, load(w, of + f), load(w, to + F + f)))
            for q in range(filter_pair.shape[0]):
                for c in range(4):
                    if plan.group_filters[g, c] == filter_pair[q, 0]:
                        to = at.torque + column[filter_pair[q, 1], row] * stride
                        for f in range(n):
                            own = at.slope + f * at.filter_stride + 4 * q
                            pr, pi = _times(load(w, of + f), load(w, of + F + f), load(w, own), load(w, own + 1))
                            _add(w, to + f, pr)
                            _add(w, to + F + f, pi)


@inner(forceinline=True)
def _row_products(plan: Plan, work: Workspace, n):
    """Products among parameters that act on a single row, and with the residual."""
    w, at, single, P = work.w, work.at, plan.single, plan.column.shape[0]
    F, W = BLOCK, single.shape[1]
    stride, T = 2 * F, W // TILE
    for i in range(W):
        if single[1, i] >= 0:
            of, to = at.torque + (W + i) * stride, at.cross + i * stride
            for f in range(n):
                pr, pi = _times(load(w, at.rho + f), load(w, at.rho + F + f), load(w, of + f), load(w, of + F + f))
                store(w, to + f, pr)
                store(w, to + F + f, pi)
    tile = at.tiles
    for i in range(2 * T):
        for j in range(i + 1):
            left = at.torque + TILE * i * stride
            if i >= T and j < T:
                left = at.cross + TILE * (i - T) * stride
            _tile(w, left, at.torque + TILE * j * stride, tile, stride, n)
            tile += 9
    for k in range(2 * W):
        j = single[k // W, k % W]
        if j >= 0:
            to = work.gram_trial + P * (P + 1) // 2 + j
            _products(w, to, at.projection + (k // W) * stride, at.torque + k * stride, n)


@inner(forceinline=True)
def _column_products(plan: Plan, work: Workspace, first, n):
    """Whole columns, of the parameters that act on both rows or on the output, and their products with all others."""
    w, at, single, both, filter_pair = work.w, work.at, plan.single, plan.both, plan.filters.pair
    F, W, P, gram = BLOCK, single.shape[1], plan.column.shape[0], work.gram_trial
    stride = 2 * F
    for c in range(both.shape[0]):
        p, whole = both[c], at.column + 8 * c * F
        of = at.torque + (2 * W + 2 * c) * stride
        for f in range(n):
            for k in range(2):
                own = at.direction + 2 * k * F + f
                pr, pi = _times(load(w, own), load(w, own + F), load(w, of + f), load(w, of + F + f))
                own += 4 * F
                qr, qi = _times(load(w, own), load(w, own + F), load(w, of + stride + f), load(w, of + stride + F + f))
                store(w, whole + k * stride + f, pr + qr)
                store(w, whole + k * stride + F + f, pi + qi)
        for q in range(filter_pair.shape[0]):
            if filter_pair[q, 1] == p:
                for f in range(n):
                    _filtered_output(plan, work, first, f, q, whole + f)
        for f in range(n):
            c0r, c0i = load(w, whole + f), load(w, whole + F + f)
            c1r, c1i = load(w, whole + 2 * F + f), load(w, whole + 3 * F + f)
            for row in range(2):
                own = at.direction + 4 * row * F + f
                b0r, b0i, b1r, b1i = load(w, own), load(w, own + F), load(w, own + 2 * F), load(w, own + 3 * F)
                to = whole + (4 + 2 * row) * F + f
                store(w, to, fma(b1i, c1i, fma(b1r, c1r, fma(b0i, c0i, b0r * c0r))))
                store(w, to + F, fnma(b1i, c1r, fma(b1r, c1i, fnma(b0i, c0r, b0r * c0i))))
        for k in range(2 * W):
            j = single[k // W, k % W]
            if j >= 0:
                to = gram + _triangle(p, j)
                _products(w, to, whole + (4 + 2 * (k // W)) * F, at.torque + k * stride, n)
        for other in range(c + 1):
            to, right = gram + _triangle(p, both[other]), at.column + 8 * other * F
            _products(w, to, whole, right, n)
            _products(w, to, whole + stride, right + stride, n)
        _products(w, gram + P * (P + 1) // 2 + p, whole, at.residual, n)
        _products(w, gram + P * (P + 1) // 2 + p, whole + stride, at.residual + stride, n)


@inner(forceinline=True)
def _placed(plan: Plan, work: Workspace):
    """The tiles into their places of the lower triangle."""
    w, single = work.w, plan.single
    W = single.shape[1]
    tile = work.at.tiles
    for i in range(2 * W // TILE):
        for j in range(i + 1):
            for k in range(9):
                a, b = TILE * i + k // TILE, TILE * j + k % TILE
                if a >= b:
                    p, q = single[a // W, a % W], single[b // W, b % W]
                    if p >= 0 and q >= 0:
                        store(w, work.gram_trial + _triangle(p, q), load(w, tile + k))
            tile += 9


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
    _cleared(plan, work)
    _gains(plan, work)
    for first in range(0, plan.omega.shape[0], BLOCK):
        n = min(BLOCK, plan.omega.shape[0] - first)
        _groups(plan, work, first, n)
        _equations(plan, work, first, n)
        _residuals(plan, work, first, n)
        _sensed(plan, work, first, n)
        _gain_torques(plan, work, first, n)
        _group_torques(plan, work, first, n)
        _row_products(plan, work, n)
        _column_products(plan, work, first, n)
    _placed(plan, work)


@compiled(allocates=False, seconds=3)
def evaluate_cost(plan: Plan, work: Workspace) -> None:
    """The cost alone at the parameters in ``work.trial``, as `evaluate` computes it, to the last slot of its sums."""
    w, at, P, output = work.w, work.at, plan.column.shape[0], plan.filters.output
    _gains(plan, work)
    cost = splat(0.0)
    for first in range(0, plan.omega.shape[0], BLOCK):
        n = min(BLOCK, plan.omega.shape[0] - first)
        _groups(plan, work, first, n)
        _equations(plan, work, first, n)
        for f in range(n):
            _, _, _, _, _, _, _, _, y0r, y0i, y1r, y1i = _solved(w, at.matrix + f)
            of = at.filter + f * at.filter_stride
            y0r, y0i = _through(w, of, output[0], y0r, y0i)
            y1r, y1i = _through(w, of, output[1], y1r, y1i)
            r0r, r0i, r1r, r1i = _residual(w, work.data + 8 * (first + f), y0r, y0i, y1r, y1i)
            cost = fma(r1i, r1i, fma(r1r, r1r, fma(r0i, r0i, fma(r0r, r0r, cost))))
    store(w, work.gram_trial + (P + 1) * (P + 2) // 2 - 1, cost)


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


@inner
def take(work: Workspace, lanes: Lanes, lane, queue: Queue):
    """Hand a lane the next start of the queue, and its data unless it holds them; returns its index.

    -1 when none is left. But a lane that had none yet is shown the last one: idle lanes, too, hold finite numbers.
    """
    index = lanes.next[0]
    if index < queue.starts.shape[0]:
        lanes.fit[lane] = index
        lanes.next[0] = index + 1
    else:
        lanes.fit[lane] = -1
        if lanes.problem[lane] >= 0:
            return np.int64(-1)
        index = np.int64(queue.starts.shape[0] - 1)
    problem = queue.problem[index]
    if problem != lanes.problem[lane]:
        lanes.problem[lane] = problem
        for k in range(queue.packed.shape[1]):
            work.w[(work.data + k) * WIDTH + lane] = queue.packed[problem, k]
    return index


@inner
def busy(lanes: Lanes):
    """Whether a lane has a start."""
    running = False
    for lane in range(WIDTH):
        running = running or lanes.fit[lane] >= 0
    return running


@compiled(allocates=False)
def begin(work: Workspace, lane, queue: Queue, index, bounds: Bounds):
    """Put a start of the queue into a lane; returns the cost below which only rounding is left."""
    w, start, packed = work.w, queue.starts[index], queue.packed[queue.problem[index]]
    for p in range(start.size):
        w[(work.trial + p) * WIDTH + lane] = min(max(start[p], bounds.lower[p]), bounds.upper[p])
    norm = 0.0
    for n in range(packed.size // 8):
        y0r, y0i, y1r, y1i, w00, w11, w10r, w10i = packed[8 * n : 8 * n + 8]
        e1r, e1i = w11 * y1r + w10r * y0r - w10i * y0i, w11 * y1i + w10r * y0i + w10i * y0r
        norm += w00 * w00 * (y0r * y0r + y0i * y0i) + e1r * e1r + e1i * e1i
    w[work.damping * WIDTH + lane] = LAMBDA_START
    return ROUNDING * norm


@calling(evaluate)
def levenberg_marquardt(
    evaluate: int,
    plan: Plan,
    work: Workspace,
    states: LaneStates,
    queue: Queue,
    bounds: Bounds,
    rules: StopRules,
    out: Outcomes,
) -> None:
    """Fit every start of the queue inside bounds (P,) and fill ``out``."""
    P = queue.starts.shape[1]
    w, at_x, at_trial, at_damping, at_matrix = work.w, work.x, work.trial, work.damping, work.matrix
    at_gram, at_gram_trial = work.gram, work.gram_trial
    n_triangle = (P + 1) * (P + 2) // 2
    at_cost, at_cost_trial = at_gram + n_triangle - 1, at_gram_trial + n_triangle - 1
    lanes, fresh, evaluations, outcome = states.lanes, states.fresh, states.evaluations, states.outcome
    fit, growth, floor, predicted = lanes.fit, states.growth, states.floor, states.predicted
    half = splat(0.5)
    for lane in range(WIDTH):
        floor[lane] = begin(work, lane, queue, take(work, lanes, lane, queue), bounds)
        fresh[lane], growth[lane] = True, 2.0

    while busy(lanes):
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
            index = take(work, lanes, lane, queue)
            if index >= 0:
                fresh[lane], evaluations[lane], growth[lane], outcome[lane] = True, 0, 2.0, 0
                floor[lane] = begin(work, lane, queue, index, bounds)
