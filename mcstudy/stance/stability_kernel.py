"""Compiled search for the rightmost root of a delay system, with a certificate (all compiled code of stability).

The characteristic function of `mcstudy.stance.rational.RationalRows` is a quasi-polynomial

    f(s) = sum_k q_k(s) exp(-T_k s),   q_k real,  T_0 = 0,

with q_0 of the highest degree n. Search: a coarse scan of the imaginary axis picks starts where Newton's correction
is locally smallest, Newton's iteration with the roots already found divided out follows them. Certificate: the
argument principle on the vertical line just right of the best root. Going up from the real axis,

    change of arg f = n pi/2 - pi N,   N = number of roots right of the line,

and beyond the frequency where f is dominated by its leading term the rest of the change is known in closed form.
The march along the line divides out the roots found, so that the phase is smooth, and halves its step wherever the
phase change disagrees with the one predicted from f'/f. If N is not zero the march's own minima of Newton's
correction are the next starts.

Derived; the argument principle for quasi-polynomials is classical (Stepan 1989, Retarded Dynamical Systems).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mcstudy.compiling.decorators import compiled, inner

CERTIFIED, CHAIN, FAILED = 0, 1, 2
"""Outcome per vector: certified; neutral and bounded by the abscissa of its root chain; not certified."""

MAX_ROOTS = 24
MAX_STARTS = 16
ROUNDS = 4
SCAN_STEP, SCAN_END = 4.0, 52.0  # rad/s
LINE_OFFSET = 1e-8  # the certificate's line lies this far (relative to 1 + |s|) right of the best root
CHAIN_MARGIN = 0.1  # 1/s, how far right of a neutral system's root chain the line is put
FLOOR = -60.0  # 1/s, roots left of this are not followed
MAX_MARCH = 20000


class Room(NamedTuple):
    """Arrays that `rightmost` works in; made here, since to compile what makes arrays takes a second.

    coefficient: (K, L), of K pairs of delays. exponent, first, second, degree: (K,). factor: (G,), of G delays. roots,
    starts: (`MAX_ROOTS`,) and (`MAX_STARTS`,).
    """

    coefficient: np.ndarray
    exponent: np.ndarray
    first: np.ndarray
    second: np.ndarray
    degree: np.ndarray
    factor: np.ndarray
    roots: np.ndarray
    starts: np.ndarray

    @classmethod
    def of(cls, groups: int, length: int) -> Room:
        """For delay systems of G delays and numerators of L coefficients."""
        pairs = groups * (groups + 1) // 2 + 1
        whole = [np.zeros(pairs, dtype=np.int64) for _ in range(3)]
        points = [np.zeros(size, dtype=np.complex128) for size in (groups, MAX_ROOTS, MAX_STARTS)]
        return cls(np.zeros((pairs, 2 * length - 1)), np.zeros(pairs), *whole, *points)


Loop = tuple[np.ndarray, ...]
"""One quasi-polynomial: coefficient (K, L), exponent, first and second delay, degree (K,), delay, scratch (G,)."""


@inner
def _characteristic(
    numerator: np.ndarray,
    delay: np.ndarray,
    coefficient: np.ndarray,
    exponent: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    degree: np.ndarray,
) -> int:
    """Expand det A over pairs of delays; returns the number of pairs kept. Pair 0 is the undelayed one."""
    groups, length = numerator.shape[0], numerator.shape[3]
    kept = 0
    for g in range(groups):
        for h in range(g, groups):
            for j in range(2 * length - 1):
                coefficient[kept, j] = 0.0
            for swap in range(2 if h > g else 1):
                a, b = (g, h) if swap == 0 else (h, g)
                for i in range(length):
                    p00, p01 = numerator[a, 0, 0, i], numerator[a, 0, 1, i]
                    if p00 != 0.0 or p01 != 0.0:
                        for j in range(length):
                            coefficient[kept, i + j] += p00 * numerator[b, 1, 1, j] - p01 * numerator[b, 1, 0, j]
            top = -1
            for j in range(2 * length - 1):
                if coefficient[kept, j] != 0.0:
                    top = j
            if top >= 0 or kept == 0:
                first[kept], second[kept], degree[kept] = g, h, top
                exponent[kept] = delay[g] + delay[h]
                kept += 1
    return kept


@inner
def _evaluate(s: complex, loop: Loop) -> tuple[complex, complex, complex]:
    """f(s), f'(s) and the undelayed part of f(s)."""
    coefficient, exponent, first, second, degree, delay, factor = loop
    for g in range(1, delay.size):
        size, phase = math.exp(-delay[g] * s.real), -delay[g] * s.imag
        factor[g] = complex(size * math.cos(phase), size * math.sin(phase))
    f, df, undelayed = 0j, 0j, 0j
    for k in range(exponent.size):
        p, dp = 0j, 0j
        for j in range(degree[k], -1, -1):
            dp = dp * s + p
            p = p * s + coefficient[k, j]
        if k == 0:
            f, df, undelayed = p, dp, p
        else:
            e = factor[second[k]]
            if first[k] > 0:
                e *= factor[first[k]]
            f += e * p
            df += e * (dp - exponent[k] * p)
    return f, df, undelayed


@inner
def _deflation(s: complex, roots: np.ndarray, found: int) -> tuple[complex, complex]:
    """sum of 1/(s - r) over the roots found and their conjugates, and the product of the (s - r)."""
    total, product = 0j, 1.0 + 0j
    for j in range(found):
        r = roots[j]
        d = s - r
        total += 1.0 / d
        product *= d
        if r.imag != 0.0:
            d = s - r.conjugate()
            total += 1.0 / d
            product *= d
    return total, product


@inner
def _newton(s: complex, roots: np.ndarray, found: int, loop: Loop) -> tuple[bool, complex]:
    """Newton's iteration, roots found divided out until it has nearly converged; returns (converged, root)."""
    for _ in range(40):
        f, df, _ = _evaluate(s, loop)
        if f == 0.0:
            break
        total, _ = _deflation(s, roots, found)
        slope = df / f - total
        step = 1.0 / slope
        size = abs(step)
        if not size < 1e300:
            return False, s
        if size > 20.0:
            step *= 20.0 / size
        s = s - step
        if s.real < FLOOR or abs(s) > 2e3:
            return False, s
        if size < 1e-5 * (1.0 + abs(s)):
            break
    else:
        return False, s
    if abs(s.imag) < 1e-6 * (1.0 + abs(s)):
        s = complex(s.real, 0.0)
    last = 1e300
    for _ in range(8):  # polish on f itself: quadratic, so a few steps reach rounding
        f, df, _ = _evaluate(s, loop)
        if f == 0.0:
            break
        step = f / df
        size = abs(step)
        if size < last:
            s = s - step
        else:
            break
        if size < 1e-14 * (1.0 + abs(s)):
            break
        last = size
    return last < 1e-6 * (1.0 + abs(s)) or last == 1e300, complex(s.real, abs(s.imag))


@inner
def _add(s: complex, roots: np.ndarray, found: int) -> int:
    """Store a root unless it is already there."""
    for j in range(found):
        if abs(s - roots[j]) < 1e-7 * (1.0 + abs(s)):
            return found
    if found < roots.size:
        roots[found] = s
        found += 1
    return found


@inner
def _scan(c: float, starts: np.ndarray, loop: Loop) -> int:
    """Points of the line Re s = c, on a fixed grid, where Newton's correction is locally smallest."""
    count = 0
    two, one = 1e300, 1e300
    previous = complex(c, 0.0)
    for i in range(int(SCAN_END / SCAN_STEP) + 2):
        s = complex(c, i * SCAN_STEP)
        f, df, _ = _evaluate(s, loop)
        size = abs(f) / abs(df)
        if i > 0 and one <= two and one < size and count < starts.size:
            starts[count] = previous
            count += 1
        two, one, previous = one, size, s
    return count


@inner
def _more(s: complex, starts: np.ndarray, count: int) -> int:
    """Store one more start if there is room."""
    if count < starts.size:
        starts[count] = s
        count += 1
    return count


@inner
def _dominated(omega: float, sigma: float, loop: Loop) -> bool:
    """Whether the leading term outweighs all others for every s = sigma + i w with w >= omega."""
    coefficient, exponent, _, _, degree, _, _ = loop
    n = degree[0]
    size = math.hypot(sigma, omega)
    rest = 0.0
    for k in range(exponent.size):
        scale = math.exp(-exponent[k] * sigma)
        for j in range(degree[k] + 1):
            if k > 0 or j < n:
                rest += scale * abs(coefficient[k, j]) * size ** (j - n)
    return rest < 0.95 * abs(coefficient[0, n])


@inner
def _count_right(sigma: float, roots: np.ndarray, found: int, starts: np.ndarray, loop: Loop) -> tuple[int, int]:
    """Number of roots right of Re s = sigma (-1 if not resolved), and how many starts were stored."""
    coefficient, exponent, _, _, degree, _, _ = loop
    n = degree[0]
    longest = 0.0
    for k in range(exponent.size):  # numba's own `max` would load its array mathematics, and SciPy's with it
        longest = max(longest, exponent[k])
    widest = 1.0 / max(longest, 0.02)
    end = 1.0
    while not _dominated(end, sigma, loop):
        end *= 1.25
        if end > 1e12:
            return -1, 0
    omega, phase, stored = 0.0, 0.0, 0
    s = complex(sigma, 0.0)
    f, df, _ = _evaluate(s, loop)
    total, product = _deflation(s, roots, found)
    value, slope = f / product, df / f - total
    if not abs(slope) < 1e300:
        return -1, 0
    two, one = 0.0, 0.0
    previous = s
    step, delayed = widest, math.inf
    for _ in range(MAX_MARCH):
        step = min(step, 1.0 / abs(slope), end - omega)
        if delayed > 0.1:
            step = min(step, widest)
        s = complex(sigma, omega + step)
        f, df, undelayed = _evaluate(s, loop)
        total, product = _deflation(s, roots, found)
        new_value, new_slope = f / product, df / f - total
        ratio = new_value * value.conjugate()
        change = math.atan2(ratio.imag, ratio.real)
        predicted = 0.5 * step * (slope.real + new_slope.real)
        if not abs(change - predicted) < 0.3:
            step *= 0.5
            if step < 1e-10:
                return -1, 0
            continue
        if one >= two and one > abs(slope) and stored < starts.size:
            starts[stored] = previous
            stored += 1
        two, one, previous = one, abs(slope), complex(sigma, omega)
        phase += change
        omega += step
        value, slope = new_value, new_slope
        delayed = abs(f - undelayed) / abs(undelayed)
        if omega >= end * (1.0 - 1e-12):
            break
        step *= 3.0
    else:
        return -1, 0
    s = complex(sigma, omega)
    f, df, _ = _evaluate(s, loop)
    for j in range(found):
        d = s - roots[j]
        phase += math.atan2(d.imag, d.real)
        if roots[j].imag != 0.0:
            d = s - roots[j].conjugate()
            phase += math.atan2(d.imag, d.real)
    angle = math.atan2(omega, sigma)
    lead = f / coefficient[0, n] * complex(math.cos(n * angle), -math.sin(n * angle))
    phase += n * (0.5 * math.pi - angle) - math.atan2(lead.imag, lead.real)
    right = 0.5 * n - phase / math.pi
    nearest = round(right)
    if abs(right - nearest) > 1e-3 or nearest < 0:
        return -1, stored
    return nearest, stored


@inner
def _chain(loop: Loop) -> float:
    """Abscissa that bounds the root chains of a neutral system (-inf if retarded, +inf if it has none).

    Solves sum_k |leading_k| exp(-T_k c) = |leading_0| for c.
    """
    coefficient, exponent, _, _, degree, _, _ = loop
    n = degree[0]
    neutral = False
    for k in range(1, exponent.size):
        if degree[k] == n:
            neutral = True
            if exponent[k] == 0.0:
                return math.inf
    if not neutral:
        return -math.inf
    low, high = -1e4, 1e4
    for _ in range(80):
        c = 0.5 * (low + high)
        total = 0.0
        for k in range(1, exponent.size):
            if degree[k] == n:
                total += abs(coefficient[k, n]) * math.exp(min(-exponent[k] * c, 600.0))
        if total > abs(coefficient[0, n]):
            low = c
        else:
            high = c
    return high


@compiled(allocates=False, seconds=4)
def rightmost(
    numerator: np.ndarray,
    delay: np.ndarray,
    hints: np.ndarray,
    room: Room,
    root: np.ndarray,
    outcome: np.ndarray,
    rounds: np.ndarray,
) -> None:
    """Rightmost root of each delay system.

    numerator (B, G, 2, 2, L), the angles' part of `RationalRows.folded`; delay (B, G); hints (B, Q) complex, more
    starts (NaN: none); room, to work in. Writes root (B,) complex with Im >= 0, outcome (B,) and rounds (B,), the
    certificates tried.
    """
    coefficient, exponent, first, second, degree, factor, roots, starts = room
    for b in range(numerator.shape[0]):
        root[b], outcome[b], rounds[b] = complex(math.nan, math.nan), FAILED, 0
        kept = _characteristic(numerator[b], delay[b], coefficient, exponent, first, second, degree)
        n = degree[0]
        bad = n < 1
        for k in range(1, kept):
            bad = bad or degree[k] > n
        for k in range(kept):
            for j in range(degree[k] + 1):
                bad = bad or not abs(coefficient[k, j]) < 1e300
        if bad:
            continue
        loop = (coefficient[:kept], exponent[:kept], first[:kept], second[:kept], degree[:kept], delay[b], factor)
        chain = _chain(loop)
        if chain == math.inf:
            continue
        found = np.int64(0)  # a literal 0 would be a type of its own: its callees would be compiled twice
        for q in range(hints.shape[1]):
            if abs(hints[b, q]) < 1e300 and found < MAX_ROOTS:
                ok, s = _newton(hints[b, q], roots, found, loop)
                if ok:
                    found = _add(s, roots, found)
        count = _scan(0.0, starts, loop)
        count = _more(complex(1.0, 2.0), starts, count)
        for attempt in range(1, ROUNDS + 1):
            for i in range(count):
                ok, s = _newton(starts[i], roots, found, loop)
                if ok:
                    found = _add(s, roots, found)
            best = complex(-math.inf, 0.0)
            for j in range(found):
                if roots[j].real > best.real:
                    best = roots[j]
            line = best.real + LINE_OFFSET * (1.0 + abs(best)) if found else 0.0
            line = max(line, chain + CHAIN_MARGIN)
            right, count = _count_right(line, roots, found, starts, loop)
            rounds[b] = attempt
            if right != 0 or not found:
                # The march tells how many are missing; a fan right of the line catches the fast and the slow ones.
                for j in range(attempt + 1):
                    count = _more(complex(line + 2.0 * j + 1.0, 1.0 + 0.5 * j), starts, count)
                    count = _more(complex(line + 5.0 * j + 2.0, 0.0), starts, count)
            if found:
                root[b] = best
            if right == 0 and (found or chain > -math.inf):
                outcome[b] = CERTIFIED
                if not best.real > chain + CHAIN_MARGIN and chain > -math.inf:
                    outcome[b] = CHAIN
                    if not best.real > chain:
                        root[b] = complex(chain, math.nan)
                break
