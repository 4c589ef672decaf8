"""The compiled interior-point solver: eight fits at a time over `mcstudy.fitting.kernel.evaluate_cost`.

Unlike Levenberg-Marquardt it sees nothing of a model but its cost, one number per evaluation. Each fit is a little
machine: `advance` is told the cost at ``trial`` and leaves the next point there. So the same machine also minimises
any other function, one call per value, which is how tests put it on published problems; and a fit in a lane depends on
nothing in the other lanes. What the method is, and what of it is a guess: `mcstudy_goodworth2018.solver.emulation`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from mcstudy.compiling.addresses import call, calling
from mcstudy.compiling.decorators import compiled
from mcstudy.fitting import kernel
from mcstudy.fitting.arguments import Bounds, Lanes, Outcomes, Plan, Queue, Workspace
from mcstudy.fitting.kernel import CONVERGED, ITERATION_LIMIT, NON_FINITE_MODEL, STALLED, busy, take
from mcstudy.fitting.lanes import WIDTH
from mcstudy_goodworth2018.solver.barrier_step import (
    barrier_gradient,
    direct_step,
    error,
    longest,
    merit,
    move_multipliers,
    scales,
    system,
    trust_region_step,
    update,
)

FIRST, DIFFERENCE, SEARCH, REGION = 0, 1, 2, 3
"""What the evaluation at ``trial`` is for: the start, the gradient, the line search, a trust-region step."""

SUFFICIENT = 1e-8
"""Least fraction of the predicted decrease of the merit that a step must reach (Byrd, Hribar & Nocedal 1999)."""

HALVINGS = 3
"""Halvings of the direct step before a trust-region step is tried instead."""

INSIDE = 0.01
"""How far inside, in widths of the bounds, a start that lies on a bound is moved."""


class Choices(NamedTuple):
    """Stop rules, and what fmincon's documentation leaves open; see `mcstudy_goodworth2018.solver.Settings`."""

    tolerance: float
    max_iterations: int
    own_units: bool
    scaled: bool
    difference_step: float
    step_tolerance: float
    max_evaluations: int
    barrier: float


class Machines(NamedTuple):
    """State of K fits of P parameters.

    x, trial, gradient, step, low, high: (K, P), parameters, next point, gradient at x, step from x, multipliers of the
    lower and the upper bounds. old_x, old_gradient: (K, P), of the iteration before. hessian, matrix: (K, P, P),
    quasi-Newton matrix and matrix of the step. slope, scale: (K, P), gradient of the merit and units of the trust
    region. value, merit, barrier, radius, fraction, predicted, reference: (K,), cost and merit at x, barrier
    parameter, radius of the trust region, fraction of the step in ``trial``, decrease that the step predicts (slope of
    the line search), largest gradient at the start. phase, coordinate, halvings, inner, evaluations, iterations: (K,)
    int64; ``inner`` counts the iterations at this barrier parameter.
    """

    x: np.ndarray
    trial: np.ndarray
    gradient: np.ndarray
    step: np.ndarray
    low: np.ndarray
    high: np.ndarray
    old_x: np.ndarray
    old_gradient: np.ndarray
    hessian: np.ndarray
    matrix: np.ndarray
    slope: np.ndarray
    scale: np.ndarray
    value: np.ndarray
    merit: np.ndarray
    barrier: np.ndarray
    radius: np.ndarray
    fraction: np.ndarray
    predicted: np.ndarray
    reference: np.ndarray
    phase: np.ndarray
    coordinate: np.ndarray
    halvings: np.ndarray
    inner: np.ndarray
    evaluations: np.ndarray
    iterations: np.ndarray


def machines(K: int, P: int) -> Machines:
    """Room for K fits of P parameters."""
    vectors, matrices = [np.zeros((K, P)) for _ in range(8)], [np.zeros((K, P, P)) for _ in range(2)]
    more, numbers = [np.zeros((K, P)) for _ in range(2)], [np.zeros(K) for _ in range(7)]
    return Machines(*vectors, *matrices, *more, *numbers, *(np.zeros(K, np.int64) for _ in range(6)))


@compiled
def reset(m: Machines, k, start, bounds: Bounds, choices: Choices):  # type: ignore[no-untyped-def]
    """Begin fit k at ``start`` (P,), moved inside the bounds if it lies on one."""
    P = start.size
    for i in range(P):
        lower, upper = bounds.lower[i], bounds.upper[i]
        room = upper - lower if math.isfinite(upper - lower) else 1.0
        at = start[i]
        if not at > lower:
            at = lower + INSIDE * room
        if not at < upper:
            at = upper - INSIDE * room
        m.x[k, i] = m.trial[k, i] = at
        m.low[k, i] = choices.barrier / (at - lower)
        m.high[k, i] = choices.barrier / (upper - at)
        for j in range(P):
            m.hessian[k, i, j] = 1.0 if i == j else 0.0
    m.barrier[k], m.radius[k] = choices.barrier, math.sqrt(P)
    m.phase[k], m.inner[k], m.evaluations[k], m.iterations[k] = FIRST, 0, 0, 0


@njit(nogil=True)
def _difference(m: Machines, k, coordinate, bounds: Bounds, choices: Choices):  # type: ignore[no-untyped-def]
    """Ask for the cost a little further along one parameter, on the other side where a bound is in the way."""
    x = m.x[k]
    for i in range(x.size):
        m.trial[k, i] = x[i]
    at = x[coordinate]
    h = choices.difference_step * max(abs(at), 1.0)
    if at < 0.0:
        h = -h
    if not bounds.lower[coordinate] <= at + h <= bounds.upper[coordinate]:
        if bounds.lower[coordinate] <= at - h <= bounds.upper[coordinate]:
            h = -h
        elif bounds.upper[coordinate] - at > at - bounds.lower[coordinate]:
            h = 0.5 * (bounds.upper[coordinate] - at)
        else:
            h = -0.5 * (at - bounds.lower[coordinate])
    m.trial[k, coordinate] = at + h
    m.phase[k], m.coordinate[k] = DIFFERENCE, coordinate


@njit(nogil=True)
def _try(m: Machines, k, fraction):  # type: ignore[no-untyped-def]
    """Ask for the cost after a fraction of the step."""
    m.fraction[k] = fraction
    for i in range(m.x.shape[1]):
        m.trial[k, i] = m.x[k, i] + fraction * m.step[k, i]


@njit(nogil=True)
def _tiny(m: Machines, k, tolerance):  # type: ignore[no-untyped-def]
    """Whether ``trial`` is nowhere further from x than the step tolerance."""
    largest = 0.0
    for i in range(m.x.shape[1]):
        largest = max(largest, abs(m.trial[k, i] - m.x[k, i]) / max(1.0, abs(m.x[k, i])))
    return largest <= tolerance


@njit(nogil=True)
def _length(m: Machines, k, fraction):  # type: ignore[no-untyped-def]
    """Length of a fraction of the step in units of the trust region."""
    total = 0.0
    for i in range(m.x.shape[1]):
        total += (fraction * m.step[k, i] * m.scale[k, i]) ** 2
    return math.sqrt(total)


@njit(nogil=True)
def _region(m: Machines, k, bounds: Bounds, choices: Choices):  # type: ignore[no-untyped-def]
    """Ask for the cost after a trust-region step; returns an outcome when the step has become too short."""
    trust_region_step(m.matrix[k], m.slope[k], m.scale[k], m.radius[k], m.step[k])
    fraction = longest(m.x[k], bounds.lower, bounds.upper, m.step[k])
    predicted = 0.0
    for i in range(m.x.shape[1]):
        m.step[k, i] *= fraction
    for i in range(m.x.shape[1]):
        inner = 0.0
        for j in range(m.x.shape[1]):
            inner += 0.5 * m.matrix[k, i, j] * m.step[k, j]
        predicted -= (m.slope[k, i] + inner) * m.step[k, i]
    m.predicted[k], m.phase[k] = predicted, REGION
    _try(m, k, 1.0)
    return STALLED if _tiny(m, k, choices.step_tolerance) else 0


@njit(nogil=True)
def _iterate(m: Machines, k, bounds: Bounds, choices: Choices):  # type: ignore[no-untyped-def]
    """The gradient at x is known: learn from it, test for the end, lower the barrier, and ask for the next step."""
    x, gradient, low, high = m.x[k], m.gradient[k], m.low[k], m.high[k]
    lower, upper = bounds.lower, bounds.upper
    P = x.size
    largest = 0.0
    for i in range(P):
        if not math.isfinite(gradient[i]):
            return STALLED
        largest = max(largest, abs(gradient[i]))
    if m.iterations[k] == 0:
        m.reference[k] = max(1.0, largest)
    else:
        first = choices.scaled and m.iterations[k] == 1
        update(m.hessian[k], x - m.old_x[k], gradient - m.old_gradient[k], first)
    least = choices.tolerance * m.reference[k]
    if error(gradient, x, lower, upper, low, high, 0.0) <= least:
        return CONVERGED
    while m.barrier[k] > 0.1 * least and error(gradient, x, lower, upper, low, high, m.barrier[k]) <= m.barrier[k]:
        m.barrier[k] *= 0.01 if m.inner[k] < 3 else 0.2
        m.inner[k] = 0
    m.inner[k] += 1
    m.merit[k] = merit(m.value[k], x, lower, upper, m.barrier[k])
    barrier_gradient(gradient, x, lower, upper, m.barrier[k], m.slope[k])
    system(m.hessian[k], x, lower, upper, low, high, m.matrix[k])
    scales(x, lower, upper, m.scale[k])
    if direct_step(m.matrix[k], m.slope[k], m.step[k]):
        m.predicted[k] = 0.0
        for i in range(P):
            m.predicted[k] -= m.slope[k, i] * m.step[k, i]
        m.halvings[k], m.phase[k] = 0, SEARCH
        _try(m, k, longest(x, lower, upper, m.step[k]))
        return 0
    return _region(m, k, bounds, choices)


@njit(nogil=True)
def _accept(m: Machines, k, cost, bounds: Bounds, choices: Choices):  # type: ignore[no-untyped-def]
    """Go to ``trial`` and ask for the first difference there."""
    tiny = _tiny(m, k, choices.step_tolerance)
    move_multipliers(m.x[k], bounds.lower, bounds.upper, m.low[k], m.high[k], m.barrier[k], m.step[k], m.fraction[k])
    for i in range(m.x.shape[1]):
        m.old_x[k, i], m.old_gradient[k, i], m.x[k, i] = m.x[k, i], m.gradient[k, i], m.trial[k, i]
    m.value[k] = cost
    m.iterations[k] += 1
    if m.iterations[k] >= choices.max_iterations:
        return ITERATION_LIMIT
    if tiny:
        return STALLED
    _difference(m, k, 0, bounds, choices)
    return 0


@njit(nogil=True)
def _told(m: Machines, k, cost, bounds: Bounds, choices: Choices):  # type: ignore[no-untyped-def]
    """What the cost at ``trial`` means, and what to ask for next."""
    phase = m.phase[k]
    if phase == FIRST:
        m.value[k] = cost
        if not math.isfinite(cost):
            return NON_FINITE_MODEL
        _difference(m, k, 0, bounds, choices)
        return 0
    if phase == DIFFERENCE:
        at = m.coordinate[k]
        m.gradient[k, at] = (cost - m.value[k]) / (m.trial[k, at] - m.x[k, at])
        if at + 1 < m.x.shape[1]:
            _difference(m, k, at + 1, bounds, choices)
            return 0
        return _iterate(m, k, bounds, choices)
    new = merit(cost, m.trial[k], bounds.lower, bounds.upper, m.barrier[k])
    if phase == SEARCH:
        fraction = m.fraction[k]
        if new <= m.merit[k] - SUFFICIENT * fraction * m.predicted[k]:
            m.radius[k] = max(m.radius[k], 2.0 * _length(m, k, fraction))
            return _accept(m, k, cost, bounds, choices)
        m.halvings[k] += 1
        if m.halvings[k] <= HALVINGS:
            _try(m, k, 0.5 * fraction)
            return 0
        m.radius[k] = min(m.radius[k], 0.5 * _length(m, k, fraction))
        return _region(m, k, bounds, choices)
    length = _length(m, k, 1.0)
    ratio = (m.merit[k] - new) / m.predicted[k] if m.predicted[k] > 0.0 else -1.0
    if ratio >= 0.9:
        m.radius[k] = max(m.radius[k], 7.0 * length)
    elif ratio >= 0.3:
        m.radius[k] = max(m.radius[k], 2.0 * length)
    elif ratio < SUFFICIENT:
        m.radius[k] = 0.25 * min(m.radius[k], length)
        return _region(m, k, bounds, choices)
    return _accept(m, k, cost, bounds, choices)


@compiled
def advance(m: Machines, k, cost, bounds: Bounds, choices: Choices):  # type: ignore[no-untyped-def]
    """Tell fit k the cost at ``m.trial[k]``; returns 0, or the status with which the fit has ended at ``m.x[k]``.

    ``bounds``: (P,), in the units of ``m``.
    """
    m.evaluations[k] += 1
    outcome = _told(m, k, cost, bounds, choices)
    if outcome == 0 and m.evaluations[k] >= choices.max_evaluations:
        outcome = ITERATION_LIMIT
    return outcome


@calling(kernel.evaluate_cost, seconds=14)
def interior_point(
    evaluate_cost: int,
    plan: Plan,
    work: Workspace,
    m: Machines,
    queue: Queue,
    bounds: Bounds,
    choices: Choices,
    out: Outcomes,
) -> None:
    """Fit every start of the queue inside bounds (P,) and fill ``out``."""
    P = queue.starts.shape[1]
    w, at_trial = work.w, work.trial
    at_cost = work.gram_trial + (P + 1) * (P + 2) // 2 - 1
    offset, unit = np.zeros(P), np.ones(P)
    if not choices.own_units:
        for p in range(P):
            offset[p], unit[p] = bounds.lower[p], bounds.upper[p] - bounds.lower[p]
    inner = Bounds((bounds.lower - offset) / unit, (bounds.upper - offset) / unit)
    lanes = Lanes(np.full(WIDTH, -1), np.full(WIDTH, -1), np.zeros(1, np.int64))
    for lane in range(WIDTH):
        index = take(work, lanes, lane, queue)
        reset(m, lane, (queue.starts[index] - offset) / unit, inner, choices)
    while busy(lanes):
        for lane in range(WIDTH):
            for p in range(P):
                at = offset[p] + unit[p] * m.trial[lane, p]
                w[(at_trial + p) * WIDTH + lane] = min(max(at, bounds.lower[p]), bounds.upper[p])
        call(evaluate_cost, plan, work)
        for lane in range(WIDTH):
            index = lanes.fit[lane]
            if index < 0:
                continue
            outcome = advance(m, lane, w[at_cost * WIDTH + lane], inner, choices)
            if outcome == 0:
                continue
            for p in range(P):
                at = offset[p] + unit[p] * m.x[lane, p]
                out.estimate[index, p] = min(max(at, bounds.lower[p]), bounds.upper[p])
            out.cost[index], out.status[index] = m.value[lane], outcome
            out.iterations[index] = m.iterations[lane]
            index = take(work, lanes, lane, queue)
            if index >= 0:
                reset(m, lane, (queue.starts[index] - offset) / unit, inner, choices)
