"""The compiled search for the ends of intervals: eight at a time over `mcstudy.fitting.kernel.evaluate`.

An end of a profile likelihood interval is the largest value of a quantity among all parameters whose deviance stays
below a ceiling and that lie within bounds (Venzon & Moolgavkar 1988, without bounds). This is solved as such, not by a
series of fits at fixed values. Every step takes the deviance as quadratic (Gauss-Newton, plus a secant estimate of
what that leaves out; Dennis, Gay & Welsch 1981) and goes to the largest value of the quantity that this quadratic
allows, by an active set inside the bounds. A step is shortened until it lowers the exact penalty function
-quantity + weight * max(0, deviance - ceiling), so that it converges from anywhere.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mcstudy.compiling.addresses import call, calling
from mcstudy.fitting import kernel
from mcstudy.fitting.arguments import Bounds, Ends, Goal, Lanes, Plan, Queue, StopRules, Workspace
from mcstudy.fitting.kernel import busy, take
from mcstudy.fitting.lanes import WIDTH
from mcstudy.fitting.small_linear import factor, solve_factored

DATA, BOUND, GAVE_UP = 1, 2, 3

LONGEST = 2.5
"""Longest step of one parameter, in ``Goal.scale``."""

RIDGE = 1e-10
"""Added to the curvature of every parameter, in units of ``Goal.scale``: what no line determines stays solvable."""

SHORTER, SHORTEST = 0.4, 1e-9
"""Factor by which a step that did not do what it promised is shortened, and the shortest that is tried."""

LEAST_GAIN = 0.05
"""Share of the promised gain that a step must bring."""

RESTORING = 100.0
"""Weight of the deviance, relative to that at an end, where it is too high whatever the quantity."""

HALVINGS = 3
"""Times that the secant part is halved before it is dropped."""

SHORT = 1e-6
"""Length of a step, in ``Goal.scale``, below which rounding hides what it says of the curvature."""

SETTLED = 1e-7
"""Decrease of the deviance at which the search on a bound has converged."""

ROUNDED = 1e-6
"""The same, and the change wanted of an end, where rounding lets no step succeed."""

ON_CEILING = 1e-8
"""Difference between deviance and ceiling, relative to its height above the start, at which an end is reached."""


@njit(nogil=True)
def _outward(G, g, x, low, high, d, room, scale, held, A, u, v, q, p):  # type: ignore[no-untyped-def]
    """Fill ``p`` with the step to the largest d.(x + p) for which the quadratic deviance rises by at most ``room``.

    Returns the multiplier mu, and the curvature d.v along the way; 0 when bounds hold the quantity, negative when G is
    not positive definite. ``held``: (P,) bool, the active set, kept from step to step.
    """
    P = x.size
    free = np.empty(P, dtype=np.int64)
    once = np.zeros(P, dtype=np.bool_)  # released already: releasing it again would go round in circles
    for i in range(P):
        fixed = low[i] >= high[i]
        held[i] = fixed or (held[i] and (x[i] <= low[i] or x[i] >= high[i]))
        p[i] = 0.0
    mu, kappa = 0.0, 0.0
    for _ in range(4 * P):
        m = np.int64(0)
        for i in range(P):
            if not held[i]:
                free[m] = i
                m += 1
        for a in range(m):
            i = free[a]
            u[a], v[a] = -g[i], d[i]
            for j in range(P):
                if held[j]:
                    u[a] -= G[i, j] * p[j]
            for b in range(a + 1):
                A[a, b] = G[i, free[b]]
            A[a, a] += RIDGE / scale[i] ** 2
        if m > 0:
            if not factor(A, m):
                return 0.0, -1.0
            solve_factored(A, u, m)
            solve_factored(A, v, m)
        kappa = 0.0
        for i in range(P):
            q[i] = p[i]
        for a in range(m):
            kappa += d[free[a]] * v[a]
            q[free[a]] = u[a]
        least = 0.0  # lowest deviance of the quadratic, relative to here
        for i in range(P):
            inner = 2.0 * g[i]
            for j in range(P):
                inner += G[i, j] * q[j]
            least += inner * q[i]
        mu = np.sqrt((room - least) / kappa) if kappa > 0.0 and room > least else 0.0
        share, stop = 1.0, -1
        for a in range(m):
            i = free[a]
            q[i] = u[a] + mu * v[a]
            if x[i] + q[i] < low[i] or x[i] + q[i] > high[i]:
                end = (low[i] if x[i] + q[i] < low[i] else high[i]) - x[i]
                part = max(0.0, (end - p[i]) / (q[i] - p[i]))
                if part < share:
                    share, stop = part, i
        for a in range(m):
            i = free[a]
            p[i] = min(max(x[i] + p[i] + share * (q[i] - p[i]), low[i]), high[i]) - x[i]
        if stop >= 0:
            p[stop] = (low[stop] if q[stop] < p[stop] else high[stop]) - x[stop]
            held[stop] = True
            continue
        worst, release = 0.0, -1
        for i in range(P):
            if not held[i] or once[i] or low[i] >= high[i]:
                continue
            pull = g[i]
            for j in range(P):
                pull += G[i, j] * p[j]
            if kappa > 0.0:
                pull -= mu * d[i]
            elif d[i] != 0.0:
                # Nothing but bounds holds the quantity: it stays there unless the deviance is above its ceiling.
                pull = -d[i] if least <= room else d[i]
            wrong = (-pull if x[i] + p[i] <= low[i] else pull) * scale[i]
            if wrong > worst + 1e-12:
                worst, release = wrong, i
        if release < 0:
            break
        held[release], once[release] = False, True
    return mu, kappa


@calling(kernel.evaluate, seconds=9)
def outermost(
    evaluate: int, plan: Plan, work: Workspace, queue: Queue, bounds: Bounds, goal: Goal, rules: StopRules, out: Ends
) -> None:
    """Largest direction . x with a deviance of at most the ceiling, inside bounds (P,), from every start.

    Fills ``out``. Converged when a step predicts less than ``rules.tolerance`` of the half-width of the interval.
    """
    w, starts = work.w, queue.starts
    low, high, scale = bounds.lower, bounds.upper, goal.scale
    P = starts.shape[1]
    lanes = Lanes(np.full(WIDTH, -1), np.full(WIDTH, -1), np.zeros(1, np.int64))
    fresh = np.ones(WIDTH, dtype=np.bool_)
    held = np.zeros((WIDTH, P), dtype=np.bool_)
    x, trial, p = np.zeros((WIDTH, P)), np.zeros((WIDTH, P)), np.zeros((WIDTH, P))
    gram, secant = np.zeros((WIDTH, P, P)), np.zeros((WIDTH, P, P))
    g, chi2, weight = np.zeros((WIDTH, P)), np.zeros(WIDTH), np.zeros(WIDTH)
    stopped = np.zeros(WIDTH, dtype=np.bool_)
    reach, promised = np.full(WIDTH, LONGEST), np.zeros(WIDTH)
    count = np.zeros(WIDTH, dtype=np.int64)
    G, A, u, v, q = np.empty((P, P)), np.empty((P, P)), np.empty(P), np.empty(P), np.empty(P)
    move, miss, new_g = np.empty(P), np.empty(P), np.empty(P)
    for lane in range(WIDTH):
        index = take(work, lanes, lane, queue)
        for i in range(P):
            trial[lane, i] = min(max(starts[index, i], low[i]), high[i])
    while busy(lanes):
        for lane in range(WIDTH):
            for i in range(P):
                w[(work.trial + i) * WIDTH + lane] = trial[lane, i]
        call(evaluate, plan, work)
        for lane in range(WIDTH):
            index = lanes.fit[lane]
            if index < 0:
                continue
            count[lane] += 1
            d, ceiling = goal.direction[index], goal.ceiling[index]
            new = w[(work.gram_trial + (P + 1) * (P + 2) // 2 - 1) * WIDTH + lane]
            done = 0
            k = work.gram_trial + P * (P + 1) // 2
            for i in range(P):
                new_g[i] = w[(k + i) * WIDTH + lane]
                move[i] = trial[lane, i] - x[lane, i]
            better = fresh[lane]
            if not better:
                if stopped[lane]:
                    gain = chi2[lane] - new
                else:
                    gain = weight[lane] * (max(0.0, chi2[lane] - ceiling) - max(0.0, new - ceiling))
                    for i in range(P):
                        gain += d[i] * move[i]
                above = new - max(chi2[lane], ceiling)
                better = gain > LEAST_GAIN * promised[lane] and above < goal.height[index]
                reach[lane] = min(LONGEST, 2.0 * reach[lane]) if gain > 0.5 * promised[lane] else reach[lane]
            if better:
                k = work.gram_trial
                for i in range(P):
                    x[lane, i] = trial[lane, i]
                    for j in range(i + 1):
                        gram[lane, i, j] = w[k * WIDTH + lane]
                        gram[lane, j, i] = w[k * WIDTH + lane]
                        k += 1
                chi2[lane] = new
            if not np.isfinite(new) and fresh[lane]:
                done = GAVE_UP
            if not fresh[lane] and np.isfinite(new):
                _learn(secant[lane], gram[lane], move, g[lane], new_g, scale, miss)
            if better:
                for i in range(P):
                    g[lane, i] = new_g[i]
            else:
                longest = 0.0
                for i in range(P):
                    longest = max(longest, abs(move[i]) / scale[i])
                reach[lane] = SHORTER * longest
                if reach[lane] < SHORTEST:
                    done = GAVE_UP
            fresh[lane] = False
            room = ceiling - chi2[lane]
            for i in range(P):
                for j in range(P):
                    G[i, j] = gram[lane, i, j] + secant[lane, i, j]
            mu, kappa = _outward(G, g[lane], x[lane], low, high, d, room, scale, held[lane], A, u, v, q, p[lane])
            for again in range(HALVINGS + 1):
                if kappa >= 0.0:
                    break
                # until the sum is positive definite, as Gauss-Newton's is
                secant[lane] *= 0.5 if again < HALVINGS else 0.0
                for i in range(P):
                    for j in range(P):
                        G[i, j] = gram[lane, i, j] + secant[lane, i, j]
                mu, kappa = _outward(G, g[lane], x[lane], low, high, d, room, scale, held[lane], A, u, v, q, p[lane])
            longest, ahead, linear, square = 0.0, 0.0, 0.0, 0.0
            for i in range(P):
                longest = max(longest, abs(p[lane, i]) / scale[i])
                ahead += d[i] * p[lane, i]
                linear += 2.0 * g[lane, i] * p[lane, i]
                for j in range(P):
                    square += p[lane, i] * G[i, j] * p[lane, j]
            least_weight = np.sqrt(kappa / goal.height[index]) if kappa > 0.0 else 1.0
            weight[lane] = 1.0 / mu if mu > 0.0 else RESTORING * least_weight
            share = min(1.0, reach[lane] / longest) if longest > 0.0 else 1.0
            modelled = chi2[lane] + share * linear + share * share * square
            promised[lane] = share * ahead + weight[lane] * (max(0.0, -room) - max(0.0, modelled - ceiling))
            stopped[lane] = kappa == 0.0 and room >= 0.0 and ahead == 0.0
            if stopped[lane]:  # bounds hold the quantity; what is left is the lowest deviance there
                promised[lane] = -share * linear - share * share * square
                if promised[lane] < SETTLED:
                    done = BOUND
            elif kappa > 0.0:
                extent = np.sqrt(goal.height[index] * kappa)
                overshoot = max(0.0, chi2[lane] + linear + square - ceiling)
                wanted = abs(ahead + weight[lane] * (max(0.0, -room) - overshoot)) / extent
                off = abs(room) / goal.height[index]
                stuck = done == GAVE_UP and off <= ROUNDED and wanted <= ROUNDED
                if stuck or (off <= ON_CEILING and wanted <= rules.tolerance):
                    done = DATA
            elif kappa < 0.0:
                done = GAVE_UP
            if done == 0 and count[lane] >= rules.max_iterations:
                done = GAVE_UP
            if done == 0:
                for i in range(P):
                    trial[lane, i] = min(max(x[lane, i] + share * p[lane, i], low[i]), high[i])
                continue
            for i in range(P):
                out.estimate[index, i] = x[lane, i]
            out.chi2[index], out.status[index], out.iterations[index] = chi2[lane], done, count[lane]
            index = take(work, lanes, lane, queue)
            if index >= 0:
                fresh[lane], stopped[lane], count[lane] = True, False, 0
                secant[lane], held[lane], weight[lane], reach[lane] = 0.0, False, 0.0, LONGEST
                for i in range(P):
                    trial[lane, i] = min(max(starts[index, i], low[i]), high[i])


@njit(nogil=True)
def _learn(S, gram, move, g, new_g, scale, miss):  # type: ignore[no-untyped-def]
    """Update ``S``, the part of the curvature that J^T J leaves out, from a step (symmetric rank one)."""
    P = move.size
    along, size, length = 0.0, 0.0, 0.0
    for i in range(P):
        miss[i] = new_g[i] - g[i]
        for j in range(P):
            miss[i] -= (gram[i, j] + S[i, j]) * move[j]
        along += miss[i] * move[i]
        size += (miss[i] * scale[i]) ** 2
        length += (move[i] / scale[i]) ** 2
    if length > SHORT**2 and abs(along) > 1e-4 * np.sqrt(size * length):
        for i in range(P):
            for j in range(P):
                S[i, j] += miss[i] * miss[j] / along
