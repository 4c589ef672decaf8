"""The compiled loop of the penalised fit: eight fits at a time over `mcstudy.fitting.kernel.evaluate`.

The fits of the diagnosis differ from those of a study in three ways: a normal prior on every parameter keeps what the
data cannot determine from running to a bound, each fit may hold some parameters or pull a linear function of them to a
target (profiles), and the Gram matrix at the minimum is wanted as well. Damped Gauss-Newton (Levenberg-Marquardt) in
units of the prior's standard deviations, clipped to the bounds.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mcstudy.compiling.addresses import call, calling
from mcstudy.compiling.decorators import compiled
from mcstudy.fitting import kernel
from mcstudy.fitting.arguments import Bounds, Lanes, PenalisedFits, Plan, Prior, Queue, Restraint, StopRules, Workspace
from mcstudy.fitting.kernel import busy, take
from mcstudy.fitting.lanes import WIDTH
from mcstudy.fitting.small_linear import solve

DAMPING = 1e-3
DAMPING_MOST = 1e9
LONGEST = 0.4
"""Longest step of one parameter, in standard deviations of its prior: longer ones end in the wrong valley."""


@compiled
def _step(gram, ridge, gradient, at, low, high, scale, damping, goal):  # type: ignore[no-untyped-def]
    """Fill ``goal`` with the damped step's end inside the bounds; returns the decrease it predicts.

    ``ridge``: (P,), times ``damping`` it is added to the diagonal of ``gram``.
    """
    P = at.size
    A, b = np.empty((P, P)), np.empty(P)
    free = np.empty(P, dtype=np.int64)
    held = np.zeros(P, dtype=np.bool_)
    for p in range(P):
        outward = (at[p] <= low[p] and gradient[p] > 0.0) or (at[p] >= high[p] and gradient[p] < 0.0)
        held[p] = low[p] >= high[p] or outward
        goal[p] = at[p]
    for _ in range(P + 1):
        m = np.int64(0)  # a literal 0 would be a type of its own: `solve` would be compiled twice
        for p in range(P):
            if not held[p]:
                free[m] = p
                m += 1
        if m == 0:
            break
        for a in range(m):
            b[a] = -gradient[free[a]]
            for p in range(P):
                if held[p]:
                    b[a] -= gram[free[a], p] * (goal[p] - at[p])
            for c in range(m):
                A[a, c] = gram[free[a], free[c]]
            A[a, a] += damping * ridge[free[a]]
        if not solve(A, b, m):
            return -1.0
        crossed = False
        longest = 0.0
        for a in range(m):
            longest = max(longest, abs(b[a]) / scale[free[a]])
        shorten = min(1.0, LONGEST / longest) if longest > 0.0 else 1.0
        for a in range(m):
            p = free[a]
            goal[p] = at[p] + shorten * b[a]
            if goal[p] < low[p] or goal[p] > high[p]:
                goal[p] = min(max(goal[p], low[p]), high[p])
                held[p] = True
                crossed = True
        if not crossed:
            break
    predicted = 0.0
    for i in range(P):
        inner = 2.0 * gradient[i]
        for j in range(P):
            inner += gram[i, j] * (goal[j] - at[j])
        predicted -= inner * (goal[i] - at[i])
    return predicted


@njit(nogil=True, inline="always")
def _off(x, restraint: Restraint, index):  # type: ignore[no-untyped-def]
    """Distance of the restrained function from its target."""
    total = -restraint.target[index]
    for p in range(x.size):
        total += restraint.direction[index, p] * x[p]
    return total


@calling(kernel.evaluate, seconds=6)
def penalised_fits(
    evaluate: int,
    plan: Plan,
    work: Workspace,
    queue: Queue,
    bounds: Bounds,
    prior: Prior,
    restraint: Restraint,
    rules: StopRules,
    out: PenalisedFits,
) -> None:
    """Minimise chi2(x) + sum ((x - mean) / scale)^2 + the restraint from every start, inside its own bounds (M, P).

    Fills ``out``; ``out.information`` is the matrix J^T J of chi2 alone at the estimate.
    """
    w, starts = work.w, queue.starts
    lower, upper, mean, scale, tolerance = bounds.lower, bounds.upper, prior.mean, prior.scale, rules.tolerance
    P = starts.shape[1]
    restrained = restraint.target.size > 0
    lanes = Lanes(np.full(WIDTH, -1), np.full(WIDTH, -1), np.zeros(1, np.int64))
    fresh = np.ones(WIDTH, dtype=np.bool_)
    x, goal = np.zeros((WIDTH, P)), np.zeros((WIDTH, P))
    gram, gradient = np.zeros((WIDTH, P, P)), np.zeros((WIDTH, P))
    total, value, predicted = np.zeros(WIDTH), np.zeros(WIDTH), np.zeros(WIDTH)
    damping, growth, ridge = np.full(WIDTH, DAMPING), np.full(WIDTH, 2.0), np.empty(P)
    count = np.zeros(WIDTH, dtype=np.int64)
    for lane in range(WIDTH):
        index = take(work, lanes, lane, queue)
        for p in range(P):
            goal[lane, p] = min(max(starts[index, p], lower[index, p]), upper[index, p])
    while busy(lanes):
        for lane in range(WIDTH):
            for p in range(P):
                w[(work.trial + p) * WIDTH + lane] = goal[lane, p]
        call(evaluate, plan, work)
        for lane in range(WIDTH):
            index = lanes.fit[lane]
            if index < 0:
                continue
            count[lane] += 1
            new = w[(work.gram_trial + (P + 1) * (P + 2) // 2 - 1) * WIDTH + lane]
            extra = 0.0
            for p in range(P):
                extra += prior.weight * ((goal[lane, p] - mean[p]) / scale[p]) ** 2
            if restrained:
                off = _off(goal[lane], restraint, index)
                extra += restraint.weight[index] * off * off
            done = False
            if fresh[lane] or new + extra < total[lane]:
                if not fresh[lane]:
                    ratio = (total[lane] - new - extra) / predicted[lane]
                    damping[lane] = max(damping[lane] * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), 1e-12)
                    growth[lane] = 2.0
                    if total[lane] - new - extra < tolerance and predicted[lane] < tolerance:
                        done = True
                if fresh[lane] and not np.isfinite(new):
                    done = True
                fresh[lane] = False
                total[lane], value[lane] = new + extra, new
                k = work.gram_trial
                for i in range(P):
                    x[lane, i] = goal[lane, i]
                    for j in range(i + 1):
                        gram[lane, i, j] = w[k * WIDTH + lane]
                        gram[lane, j, i] = w[k * WIDTH + lane]
                        k += 1
                for p in range(P):
                    gradient[lane, p] = w[k * WIDTH + lane] + prior.weight * (x[lane, p] - mean[p]) / scale[p] ** 2
                    k += 1
                if restrained:
                    off = _off(x[lane], restraint, index)
                    for p in range(P):
                        gradient[lane, p] += restraint.weight[index] * off * restraint.direction[index, p]
            else:
                damping[lane] *= growth[lane]
                growth[lane] *= 2.0
                if damping[lane] > DAMPING_MOST:
                    done = True
            if not done:
                A = gram[lane].copy()
                for p in range(P):
                    A[p, p] += prior.weight / scale[p] ** 2
                    ridge[p] = A[p, p] + 1.0 / scale[p] ** 2  # a restraint must not slow the steps along it
                if restrained:
                    for p in range(P):
                        pull = restraint.weight[index] * restraint.direction[index, p]
                        for q in range(P):
                            A[p, q] += pull * restraint.direction[index, q]
                predicted[lane] = _step(
                    A, ridge, gradient[lane], x[lane], lower[index], upper[index], scale, damping[lane], goal[lane]
                )
                while predicted[lane] < 0.0 and damping[lane] < DAMPING_MOST:
                    damping[lane] = max(10.0 * damping[lane], 1e-6)
                    predicted[lane] = _step(
                        A, ridge, gradient[lane], x[lane], lower[index], upper[index], scale, damping[lane], goal[lane]
                    )
                if predicted[lane] < tolerance * 1e-2 or count[lane] >= rules.max_iterations:
                    done = True
            if done:
                for i in range(P):
                    out.estimate[index, i] = x[lane, i]
                    for j in range(P):
                        out.information[index, i, j] = gram[lane, i, j]
                out.chi2[index], out.penalty[index] = value[lane], total[lane] - value[lane]
                index = take(work, lanes, lane, queue)
                if index >= 0:
                    fresh[lane], count[lane] = True, 0
                    damping[lane], growth[lane] = DAMPING, 2.0
                    for p in range(P):
                        goal[lane, p] = min(max(starts[index, p], lower[index, p]), upper[index, p])
