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

The number R of rows is that of the tuple ``Plan.rows``, and so known when a function is compiled: one code for each R.

Slots of the workspace are counted in lanes (`mcstudy.fitting.lanes`).
"""

from __future__ import annotations

import numpy as np

from mcstudy.compiling.addresses import call, calling
from mcstudy.compiling.decorators import compiled, inner
from mcstudy.fitting.arguments import Bounds, Filters, Lanes, LaneStates, Outcomes, Plan, Queue, StopRules, Workspace
from mcstudy.fitting.lanes import (
    WIDTH,
    fma,
    fnma,
    load,
    nearest,
    negative,
    registers,
    root,
    splat,
    store,
    where_less,
)
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
        slot, value = slope_at + 4 * q, at + 4 * filter_pair[q, 0]
        nr, ni = _over(load(w, slot), load(w, slot + 1), load(w, value), load(w, value + 1))
        dr, di = _over(load(w, slot + 2), load(w, slot + 3), load(w, value + 2), load(w, value + 3))
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
                    value = at.filter + f * at.filter_stride + 4 * k
                    re, im = _times(load(w, to + f), load(w, to + F + f), load(w, value), load(w, value + 1))
                    store(w, to + f, re)
                    store(w, to + F + f, im)
        if plan.group_only[g] >= 0:
            for f in range(n):
                if plan.stimulus[first + f] != plan.group_only[g]:  # its terms are not there
                    store(w, to + f, splat(0.0))
                    store(w, to + F + f, splat(0.0))


@inner(forceinline=True)
def _equations(plan: Plan, work: Workspace, first, n):
    """Equations of motion A(s) H = b(s) at ``n`` frequencies from ``first`` on: A and b by rows.

    b is that of the stimulus that evokes the line.
    """
    w, at, omega, entry, weight, R = work.w, work.at, plan.omega, plan.entry, plan.weight, len(plan.rows)
    F = BLOCK
    for k in range(2 * R * (R + 1)):  # what does not depend on the parameters, then term by term
        for f in range(n):
            store(w, at.matrix + k * F + f, splat(plan.constant[first + f, k]))
    for e in range(entry.shape[0]):
        row, order, group, gain = entry[e, 0], entry[e, 1], at.group + 2 * entry[e, 2] * F, load(w, at.gain + e)
        for c in range(R):
            if weight[e, 1 + c] != 0.0:
                to = at.matrix + 2 * (R * row + c) * F
                factor = splat(weight[e, 1 + c]) * gain
                if order == 0:
                    for f in range(n):
                        store(w, to + f, fma(factor, load(w, group + f), load(w, to + f)))
                        store(w, to + F + f, fma(factor, load(w, group + F + f), load(w, to + F + f)))
                elif order == 1:
                    for f in range(n):
                        rate = splat(omega[first + f]) * factor
                        store(w, to + f, fnma(rate, load(w, group + F + f), load(w, to + f)))
                        store(w, to + F + f, fma(rate, load(w, group + f), load(w, to + F + f)))
                else:
                    for f in range(n):
                        re, im = _times_s(load(w, group + f), load(w, group + F + f), order, omega[first + f])
                        store(w, to + f, fma(factor, re, load(w, to + f)))
                        store(w, to + F + f, fma(factor, im, load(w, to + F + f)))
        to = at.matrix + 2 * (R * R + row) * F
        for f in range(n):
            share = weight[e, 1 + R + plan.stimulus[first + f]]
            if share != 0.0:
                factor = splat(-share) * gain
                re, im = load(w, group + f), load(w, group + F + f)
                if order == 1:  # rounded as above
                    rate = splat(omega[first + f]) * factor
                    store(w, to + f, fnma(rate, im, load(w, to + f)))
                    store(w, to + F + f, fma(rate, re, load(w, to + F + f)))
                else:
                    re, im = _times_s(re, im, order, omega[first + f])
                    store(w, to + f, fma(factor, re, load(w, to + f)))
                    store(w, to + F + f, fma(factor, im, load(w, to + F + f)))


@inner(forceinline=True)
def _entry(w, at, k):
    """Complex number ``k`` of those whose real parts begin at slot ``at``, each followed by its imaginary parts."""
    return load(w, at + 2 * k * BLOCK), load(w, at + (2 * k + 1) * BLOCK)


@inner(forceinline=True)
def _keep(vector, k, re, im):
    """Complex number ``k`` of registers."""
    store(vector, 2 * k, re)
    store(vector, 2 * k + 1, im)


@inner(forceinline=True)
def _kept(vector, k):
    """Complex number ``k`` of registers."""
    return load(vector, 2 * k), load(vector, 2 * k + 1)


@inner(forceinline=True)
def _minor(w, at, k, m, p, q):
    """Entries k m - p q of the matrix at slot ``at``."""
    kr, ki = _entry(w, at, k)
    mr, mi = _entry(w, at, m)
    pr, pi = _entry(w, at, p)
    qr, qi = _entry(w, at, q)
    re, im = _times(kr, ki, mr, mi)
    pr, pi = _times(pr, pi, qr, qi)
    return re - pr, im - pi


@inner(forceinline=True)
def _inverse_of_two(w, at, inverse):
    """Of a matrix of two rows."""
    det_r, det_i = _minor(w, at, 0, 3, 1, 2)
    det_r, det_i = _inverse(det_r, det_i)
    for k in range(4):
        entry = k if k == 1 or k == 2 else 3 - k
        re, im = _entry(w, at, entry)
        re, im = _times(re, im, det_r, det_i)
        if k == 1 or k == 2:
            re, im = negative(re), negative(im)
        _keep(inverse, k, re, im)


@inner(forceinline=True)
def _inverse_of_three(w, at, inverse):
    """Of a matrix of three rows, by cofactors; with the next two rows and columns in turn, none changes its sign."""
    for row in range(3):
        for c in range(3):
            i, j, k, m = 3 * ((row + 1) % 3), 3 * ((row + 2) % 3), (c + 1) % 3, (c + 2) % 3
            re, im = _minor(w, at, i + k, j + m, i + m, j + k)
            _keep(inverse, 3 * c + row, re, im)
    _divided(w, at, 3, inverse)


@inner(forceinline=True)
def _inverse_of_four(w, at, inverse):
    """Of a matrix of four rows: cofactors by the minors of two rows.

    Of the rows 0 and 1 and of the rows 2 and 3, minors of column c with the next one, then with the one after that.
    A cofactor of a row is that of its partner times the minors of the other pair.
    """
    minors = registers()
    for pair in range(2):
        for apart in range(2):
            for c in range(4):
                m = (c + 1 + apart) % 4
                re, im = _minor(w, at, 8 * pair + c, 8 * pair + 4 + m, 8 * pair + m, 8 * pair + 4 + c)
                _keep(minors, 8 * pair + 4 * apart + c, re, im)
    for row in range(4):
        for c in range(4):
            re, im = splat(0.0), splat(0.0)
            for k in range(3):
                # columns in turn: c + 1 with those after it, c + 2 with c + 3 and c + 1, c + 3 with c + 1 and c + 2
                minor = 4 + (c + 3) % 4 if k == 1 else (c + 2 - k // 2) % 4
                mr, mi = _kept(minors, 8 * (1 - row // 2) + minor)
                ar, ai = _entry(w, at, 4 * (row ^ 1) + (c + 1 + k) % 4)
                pr, pi = _times(ar, ai, mr, mi)
                re, im = re + pr, im + pi
            if (row + c) % 2 == 1:
                re, im = negative(re), negative(im)
            _keep(inverse, 4 * c + row, re, im)
    _divided(w, at, 4, inverse)


@inner(forceinline=True)
def _divided(w, at, R, inverse):
    """The adjugate by the determinant, which is the product of the first row with the first column."""
    det_r, det_i = splat(0.0), splat(0.0)
    for c in range(R):
        ar, ai = _entry(w, at, c)
        mr, mi = _kept(inverse, R * c)
        pr, pi = _times(ar, ai, mr, mi)
        det_r, det_i = det_r + pr, det_i + pi
    det_r, det_i = _inverse(det_r, det_i)
    for k in range(R * R):
        mr, mi = _kept(inverse, k)
        mr, mi = _times(mr, mi, det_r, det_i)
        _keep(inverse, k, mr, mi)


@inner(forceinline=True)
def _solved(plan: Plan, work: Workspace, f, inverse, response, measured):
    """Inverse of A(s) by the adjugate, H = A^-1 b, and H after the output filters, at one frequency of a block."""
    w, at, output, R = work.w, work.at.matrix + f, plan.filters.output, len(plan.rows)
    if R == 1:
        re, im = _entry(w, at, 0)
        re, im = _inverse(re, im)
        _keep(inverse, 0, re, im)
    elif R == 2:
        _inverse_of_two(w, at, inverse)
    elif R == 3:
        _inverse_of_three(w, at, inverse)
    else:
        _inverse_of_four(w, at, inverse)
    filters = work.at.filter + f * work.at.filter_stride
    for a in range(R):
        re, im = splat(0.0), splat(0.0)
        for k in range(R):
            mr, mi = _kept(inverse, R * a + k)
            br, bi = _entry(w, at, R * R + k)
            pr, pi = _times(mr, mi, br, bi)
            re, im = re + pr, im + pi
        _keep(response, a, re, im)
        re, im = _through(w, filters, output[a], re, im)
        _keep(measured, a, re, im)


@inner(forceinline=True)
def _factor(w, data, R, a, j):
    """Entry (a, j), j < a, of the weights of a frequency whose data begin at slot ``data``."""
    slot = data + 3 * R + a * (a - 1) + 2 * j
    return load(w, slot), load(w, slot + 1)


@inner(forceinline=True)
def _weighted(w, data, rows, vector, a):
    """Row ``a`` of the weights of a frequency, whose data begin at slot ``data``, times numbers in registers."""
    R, re, im = len(rows), splat(0.0), splat(0.0)
    for j in range(R):
        if j < a:
            lr, li = _factor(w, data, R, a, j)
            vr, vi = _kept(vector, j)
            pr, pi = _times(lr, li, vr, vi)
            re, im = re + pr, im + pi
    diagonal = load(w, data + 2 * R + a)
    vr, vi = _kept(vector, a)
    return fma(diagonal, vr, re), fma(diagonal, vi, im)


@inner(forceinline=True)
def _residual(w, data, rows, measured, residual, cost):
    """Weighted residual L (H - data) of a frequency into registers; returns the cost with its square."""
    R = len(rows)
    for a in range(R):
        vr, vi = _kept(measured, a)
        _keep(measured, a, vr - load(w, data + 2 * a), vi - load(w, data + 2 * a + 1))
    for a in range(R):
        re, im = _weighted(w, data, rows, measured, a)
        _keep(residual, a, re, im)
        cost = fma(im, im, fma(re, re, cost))
    return cost


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
def _gather(w, to, source, factor, first, n):
    """Set (``first``) or add ``factor`` times complex numbers at ``n`` frequencies."""
    if first != 0:
        for f in range(n):
            store(w, to + f, factor * load(w, source + f))
            store(w, to + BLOCK + f, factor * load(w, source + BLOCK + f))
    else:
        for f in range(n):
            store(w, to + f, fma(factor, load(w, source + f), load(w, to + f)))
            store(w, to + BLOCK + f, fma(factor, load(w, source + BLOCK + f), load(w, to + BLOCK + f)))


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
    w, F, R, number, output = work.w, BLOCK, len(plan.rows), plan.filters.pair[q, 0], plan.filters.output
    data, filters = work.data + R * (R + 2) * (first + f), work.at.filter + f * work.at.filter_stride
    slope = work.at.slope + f * work.at.filter_stride + 4 * q
    sr, si = load(w, slope), load(w, slope + 1)
    for a in range(R):
        if output[a] == number:
            re, im = _entry(w, work.at.response + f, a)
            re, im = _through(w, filters, number, re, im)
            pr, pi = _times(re, im, sr, si)
            diagonal = load(w, data + 2 * R + a)
            _add(w, column + 2 * a * F, diagonal * pr)
            _add(w, column + (2 * a + 1) * F, diagonal * pi)
            for k in range(a + 1, R):
                lr, li = _factor(w, data, R, k, a)
                qr, qi = _times(lr, li, pr, pi)
                _add(w, column + 2 * k * F, qr)
                _add(w, column + (2 * k + 1) * F, qi)


@inner(forceinline=True)
def _triangle(p, q):
    """Place of (p, q) in a lower triangle that is kept row by row."""
    return max(p, q) * (max(p, q) + 1) // 2 + min(p, q)


@inner(forceinline=True)
def _pair(k, m):
    """Place of the pair of different rows (k, m) among all pairs."""
    return max(k, m) * (max(k, m) - 1) // 2 + min(k, m)


@inner(forceinline=True)
def _cleared(plan: Plan, work: Workspace):
    """Begin the sums over all frequencies, and set the places of the tiles that no parameter takes to zero.

    The cost begins at the part that no parameter changes.
    """
    w, at, single, P, R = work.w, work.at, plan.single, plan.column.shape[0], len(plan.rows)
    W, stride, zero, triangle = single.shape[1], 2 * BLOCK, splat(0.0), (P + 1) * (P + 2) // 2
    for k in range(triangle - 1):
        store(w, work.gram_trial + k, zero)
    store(w, work.gram_trial + triangle - 1, load(w, work.data + R * (R + 2) * plan.omega.shape[0]))
    for k in range(TILE * TILE * (R * W // TILE) * (R * W // TILE + 1) // 2):
        store(w, at.tiles + k, zero)
    for k in range(R * W):
        row, i = k // W, k % W
        if single[row, i] < 0:
            for f in range(stride):
                store(w, at.torque + k * stride + f, zero)
                for other in range(row):
                    store(w, at.cross + (_pair(row, other) * W + i) * stride + f, zero)


@inner(forceinline=True)
def _residuals(plan: Plan, work: Workspace, first, n):
    """Responses H, weighted residuals r = L (H - y), and B = -L A^-1, what a torque on each row does to them.

    Columns of B have unit length, with the length kept by itself; rho are their products. The cost goes to its slot.
    """
    w, at, P, R, rows, output = work.w, work.at, plan.column.shape[0], len(plan.rows), plan.rows, plan.filters.output
    F, zero = BLOCK, splat(0.0)
    inverse, response, measured, residual, column = registers(), registers(), registers(), registers(), registers()
    at_cost = work.gram_trial + (P + 1) * (P + 2) // 2 - 1
    cost = load(w, at_cost)
    for f in range(n):
        _solved(plan, work, f, inverse, response, measured)
        data, filters = work.data + R * (R + 2) * (first + f), at.filter + f * at.filter_stride
        cost = _residual(w, data, rows, measured, residual, cost)
        for a in range(R):
            re, im = _kept(response, a)
            store(w, at.response + 2 * a * F + f, re)
            store(w, at.response + (2 * a + 1) * F + f, im)
            if plan.both.shape[0] > 0:
                re, im = _kept(residual, a)
                store(w, at.residual + 2 * a * F + f, re)
                store(w, at.residual + (2 * a + 1) * F + f, im)
        for row in range(R):
            for a in range(R):  # a column of A^-1 with the output filters on its rows
                re, im = _kept(inverse, R * a + row)
                re, im = _through(w, filters, output[a], re, im)
                _keep(measured, a, re, im)
            square = zero
            for a in range(R):
                re, im = _weighted(w, data, rows, measured, a)
                re, im = negative(re), negative(im)
                _keep(column, a, re, im)
                square = fma(im, im, fma(re, re, square))
            norm = root(square)
            scale = where_less(zero, square, splat(1.0) / norm, zero)  # what no output feels moves nothing
            store(w, at.length + row * F + f, norm)
            re, im = zero, zero
            for a in range(R):
                br, bi = _kept(column, a)
                br, bi = scale * br, scale * bi
                _keep(column, a, br, bi)
                to = at.direction + 2 * (R * row + a) * F + f
                store(w, to, br)
                store(w, to + F, bi)
                rr, ri = _kept(residual, a)
                re = fma(bi, ri, fma(br, rr, re))
                im = fnma(bi, rr, fma(br, ri, im))
            store(w, at.projection + 2 * row * F + f, re)
            store(w, at.projection + (2 * row + 1) * F + f, im)
            for other in range(R):  # b_other^H b_row
                if other < row:
                    re, im = zero, zero
                    for a in range(R):
                        cr, ci = _entry(w, at.direction + f, R * other + a)
                        br, bi = _kept(column, a)
                        re = fma(ci, bi, fma(cr, br, re))
                        im = fnma(ci, br, fma(cr, bi, im))
                    to = at.rho + 2 * _pair(row, other) * F + f
                    store(w, to, re)
                    store(w, to + F, im)
    store(w, at_cost, cost)


@inner(forceinline=True)
def _sensed(plan: Plan, work: Workspace, first, n):
    """What each distinct (row, sense) passes on, times the length of the row's column of B."""
    w, at, sensed_weight, R = work.w, work.at, plan.sensed_weight, len(plan.rows)
    F = BLOCK
    for c in range(plan.sensed.shape[0]):
        for f in range(n):
            re, im = splat(sensed_weight[c, R + plan.stimulus[first + f]]), splat(0.0)
            for k in range(R):
                a = R - 1 - k
                hr, hi = _entry(w, at.response + f, a)
                share = splat(sensed_weight[c, a])
                re, im = fma(share, hr, re), fma(share, hi, im)
            to, norm = at.sensed + 2 * c * F + f, load(w, at.length + plan.sensed[c] * F + f)
            store(w, to, norm * re)
            store(w, to + F, norm * im)


@inner(forceinline=True)
def _gain_torques(plan: Plan, work: Workspace, first, n):
    """Torques of the gains, term by term, and the sum of the terms of each group that a delay or filter shapes."""
    w, x, at = work.w, work.trial, work.at
    entry, weight, column, cleared = plan.entry, plan.weight, plan.column, plan.cleared
    F, R = BLOCK, len(plan.rows)
    stride = 2 * F
    for k in range(cleared.shape[0]):
        for f in range(stride):
            store(w, at.torque + cleared[k] * stride + f, splat(0.0))
    for e in range(entry.shape[0]):
        row, order, group, p = entry[e, 0], entry[e, 1], entry[e, 2], entry[e, 3]
        shape, z = at.group + group * stride, at.sensed + entry[e, 5] * stride
        direct = entry[e, 8] != 0 and entry[e, 4] < 0 and weight[e, 0] == 1.0
        to = at.torque + column[p, row] * stride if direct else at.product
        if order == 0:
            for f in range(n):
                pr, pi = _times(load(w, shape + f), load(w, shape + F + f), load(w, z + f), load(w, z + F + f))
                store(w, to + f, pr)
                store(w, to + F + f, pi)
        else:
            for f in range(n):
                pr, pi = _times(load(w, shape + f), load(w, shape + F + f), load(w, z + f), load(w, z + F + f))
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
            _gather(w, at.group_sum + (R * group + row) * stride, to, load(w, at.gain + e), entry[e, 7], n)


@inner(forceinline=True)
def _group_torques(plan: Plan, work: Workspace, first, n):
    """Torques of delays and filters, through the sums of their groups."""
    at, R = work.at, len(plan.rows)
    for g in range(plan.group_delay.shape[0]):
        for row in range(R):
            if plan.delay_first[g, 0, row] >= 0:
                total = at.group_sum + 2 * (R * g + row) * BLOCK
                _delay_torques(plan, work, first, n, g, row, total)
                _filter_torques(plan, work, n, g, row, total)


@inner(forceinline=True)
def _delay_torques(plan: Plan, work: Workspace, first, n, g, row, total):
    """Torques of the delays of group ``g`` in a row, whose sum lies at slot ``total``."""
    w, F, omega = work.w, BLOCK, plan.omega
    for k in range(2):
        p = plan.group_delay[g, k]
        if p < 0:
            continue
        to = work.at.torque + 2 * plan.column[p, row] * F
        if plan.delay_first[g, k, row] == 1:
            for f in range(n):
                om = splat(omega[first + f])
                store(w, to + f, om * load(w, total + F + f))
                store(w, to + F + f, negative(om * load(w, total + f)))
        else:
            for f in range(n):
                om = splat(omega[first + f])
                store(w, to + f, fma(om, load(w, total + F + f), load(w, to + f)))
                store(w, to + F + f, fnma(om, load(w, total + f), load(w, to + F + f)))


@inner(forceinline=True)
def _filter_torques(plan: Plan, work: Workspace, n, g, row, total):
    """Torques of the parameters of the filters of group ``g`` in a row, whose sum lies at slot ``total``."""
    w, F, at, filter_pair = work.w, BLOCK, work.at, plan.filters.pair
    for q in range(filter_pair.shape[0]):
        for c in range(4):
            if plan.group_filters[g, c] == filter_pair[q, 0]:
                to = at.torque + 2 * plan.column[filter_pair[q, 1], row] * F
                for f in range(n):
                    slope = at.slope + f * at.filter_stride + 4 * q
                    pr, pi = _times(load(w, total + f), load(w, total + F + f), load(w, slope), load(w, slope + 1))
                    _add(w, to + f, pr)
                    _add(w, to + F + f, pi)


@inner(forceinline=True)
def _row_products(plan: Plan, work: Workspace, n):
    """Products among parameters that act on a single row, and with the residual."""
    w, at, single, P, R = work.w, work.at, plan.single, plan.column.shape[0], len(plan.rows)
    F, W = BLOCK, single.shape[1]
    stride, T = 2 * F, W // TILE
    for row in range(1, R):
        for other in range(row):
            pair = _pair(row, other)
            rho = at.rho + pair * stride
            for i in range(W):
                if single[row, i] >= 0:
                    torque, to = at.torque + (row * W + i) * stride, at.cross + (pair * W + i) * stride
                    for f in range(n):
                        rr, ri = load(w, rho + f), load(w, rho + F + f)
                        pr, pi = _times(rr, ri, load(w, torque + f), load(w, torque + F + f))
                        store(w, to + f, pr)
                        store(w, to + F + f, pi)
    tile = at.tiles
    for i in range(R * T):
        for j in range(i + 1):
            row, other = i // T, j // T
            left = at.torque + TILE * i * stride
            if row != other:
                left = at.cross + (_pair(row, other) * W + TILE * (i - row * T)) * stride
            _tile(w, left, at.torque + TILE * j * stride, tile, stride, n)
            tile += TILE * TILE
    for k in range(R * W):
        j = single[k // W, k % W]
        if j >= 0:
            to = work.gram_trial + P * (P + 1) // 2 + j
            _products(w, to, at.projection + (k // W) * stride, at.torque + k * stride, n)


@inner(forceinline=True)
def _whole_column(plan: Plan, work: Workspace, first, n, c):
    """Column of the Jacobian of a parameter in ``plan.both``, and what of it each row's column of B feels."""
    w, at, filter_pair, R = work.w, work.at, plan.filters.pair, len(plan.rows)
    F = BLOCK
    whole = at.column + 4 * R * c * F
    for f in range(n):
        for a in range(R):
            re, im = splat(0.0), splat(0.0)
            for row in range(R):
                br, bi = _entry(w, at.direction + f, R * row + a)
                tr, ti = _entry(w, at.torque + f, R * plan.single.shape[1] + R * c + row)
                pr, pi = _times(br, bi, tr, ti)
                re, im = re + pr, im + pi
            store(w, whole + 2 * a * F + f, re)
            store(w, whole + (2 * a + 1) * F + f, im)
    for q in range(filter_pair.shape[0]):
        if filter_pair[q, 1] == plan.both[c]:
            for f in range(n):
                _filtered_output(plan, work, first, f, q, whole + f)
    for f in range(n):
        for row in range(R):
            re, im = splat(0.0), splat(0.0)
            for a in range(R):
                br, bi = _entry(w, at.direction + f, R * row + a)
                cr, ci = _entry(w, whole + f, a)
                re = fma(bi, ci, fma(br, cr, re))
                im = fnma(bi, cr, fma(br, ci, im))
            store(w, whole + 2 * (R + row) * F + f, re)
            store(w, whole + (2 * (R + row) + 1) * F + f, im)


@inner(forceinline=True)
def _column_products(plan: Plan, work: Workspace, first, n):
    """Whole columns, of parameters that act on several rows or on the output, and their products with all others."""
    w, at, single, both, R = work.w, work.at, plan.single, plan.both, len(plan.rows)
    W, P, stride = single.shape[1], plan.column.shape[0], 2 * BLOCK
    gradient = work.gram_trial + P * (P + 1) // 2
    for c in range(both.shape[0]):
        p, whole = both[c], at.column + 2 * R * c * stride
        _whole_column(plan, work, first, n, c)
        for k in range(R * W):
            j = single[k // W, k % W]
            if j >= 0:
                to = work.gram_trial + _triangle(p, j)
                _products(w, to, whole + (R + k // W) * stride, at.torque + k * stride, n)
        for other in range(c + 1):
            to, right = work.gram_trial + _triangle(p, both[other]), at.column + 2 * R * other * stride
            for a in range(R):
                _products(w, to, whole + a * stride, right + a * stride, n)
        for a in range(R):
            _products(w, gradient + p, whole + a * stride, at.residual + a * stride, n)


@inner(forceinline=True)
def _placed(plan: Plan, work: Workspace):
    """The tiles into their places of the lower triangle."""
    w, single, R = work.w, plan.single, len(plan.rows)
    W = single.shape[1]
    tile = work.at.tiles
    for i in range(R * W // TILE):
        for j in range(i + 1):
            for k in range(TILE * TILE):
                a, b = TILE * i + k // TILE, TILE * j + k % TILE
                if a >= b:
                    p, q = single[a // W, a % W], single[b // W, b % W]
                    if p >= 0 and q >= 0:
                        store(w, work.gram_trial + _triangle(p, q), load(w, tile + k))
            tile += TILE * TILE


@compiled(allocates=False, seconds=8)
def evaluate(plan: Plan, work: Workspace) -> None:
    """Cost, gradient and Gram matrix at the parameters in ``work.trial``; a few frequencies at a time.

    ``work.gram_trial`` receives the lower triangle, row by row, of [J r]^T [J r]: P (P + 1) / 2 slots of J^T J, then P
    of the gradient J^T r, then the cost r^T r.

    A parameter moves the residual through the torques it makes: J_p = B t_p, with B (R x R) the same for all. Most
    parameters act on a single row k: J_p = b_k t_p with one complex number t_p and b_k the column of B scaled to unit
    length (t_p takes the length). Their products are Re(conj(t_p) t_q) within a row and Re(conj(t_p) rho t_q) between
    rows, rho = b_k^H b_m: a share 1 / R of the work of whole columns. ``plan.single`` lists these parameters; the few
    others (``plan.both``) and the residual are whole columns. ``plan.column`` says where t of a (parameter, row) is
    kept.
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
    P, R, N = plan.column.shape[0], len(plan.rows), plan.omega.shape[0]
    inverse, response, measured, residual = registers(), registers(), registers(), registers()
    _gains(plan, work)
    cost = load(work.w, work.data + R * (R + 2) * N)
    for first in range(0, N, BLOCK):
        n = min(BLOCK, N - first)
        _groups(plan, work, first, n)
        _equations(plan, work, first, n)
        for f in range(n):
            _solved(plan, work, f, inverse, response, measured)
            cost = _residual(work.w, work.data + R * (R + 2) * (first + f), plan.rows, measured, residual, cost)
    store(work.w, work.gram_trial + (P + 1) * (P + 2) // 2 - 1, cost)


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
        row, solution = matrix + i * (i + 1) // 2, load(w, right + i)
        for k in range(i):
            factor = load(w, row + k) * load(w, matrix + k * (k + 1) // 2 + k)
            store(w, right + k, fnma(factor, solution, load(w, right + k)))


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
    w[work.damping * WIDTH + lane] = LAMBDA_START
    return ROUNDING * packed[-1]


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
