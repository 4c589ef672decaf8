"""Compiled search for the rightmost root of a delay system, with a certificate (all compiled code of stability).

The characteristic function of `mcstudy.stance.rational.RationalRows`, the determinant of R rows, is a quasi-polynomial

    f(s) = sum_k q_k(s) exp(-T_k s),   q_k real,  T_0 = 0,

with q_0 of the highest degree n, whatever the orders of the single rows. Search: a coarse scan of the imaginary axis
picks starts where Newton's correction is locally smallest, Newton's iteration with the roots already found divided out
follows them. Certificate: the argument principle on the vertical line just right of the best root. Going up from the
real axis,

    change of arg f = n pi/2 - pi N,   N = number of roots right of the line,

and beyond the frequency where f is dominated by its leading term the rest of the change is known in closed form.
The march along the line divides out the roots found, so that the phase is smooth, and halves its step wherever the
phase change disagrees with the one predicted from f'/f. If N is not zero the march's own minima of Newton's
correction are the next starts.

Time is counted in seconds, unless all roots are much faster or slower than those of a body: then in a unit, a power of
two, in which they are not.

Derived; the argument principle for quasi-polynomials is classical (Stepan 1989, Retarded Dynamical Systems).
"""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np

from mcstudy.compiling.decorators import compiled, inner

CERTIFIED, CHAIN, FAILED, STATIC, ADVANCED, SINGULAR = 0, 1, 2, 3, 4, 5
"""Outcome per vector: certified; neutral and bounded by the abscissa of its root chain; not certified; a constant,
which has no root; with roots arbitrarily far right; zero or not finite, which tells nothing."""

MAX_ROOTS = 24
MAX_STARTS = 16
ROUNDS = 4
SCAN_STEP, SCAN_END = 4.0, 52.0  # rad/s
LINE_OFFSET = 1e-8  # the certificate's line lies this far (relative to 1 + |s|) right of the best root
CHAIN_MARGIN = 0.1  # 1/s, how far right of a neutral system's root chain the line is put
FLOOR = -60.0  # 1/s, roots left of this are not followed
MAX_MARCH = 20000
FAST, SLOW = 32.0, 1 / 256  # 1/s, of roots that are all faster, or all slower: another unit of time is used


class Room(NamedTuple):
    """Arrays that `rightmost` works in; made here, since to compile what makes arrays takes a second.

    R rows, G delays, K sums of R delays, C products of one entry per row that have one of these sums.

    chosen: (C, R), the delay that each row contributes to a product. place: (C,), its sum, in ascending order.
    part: (K, 2), the two parts of each sum, each a delay g < G, or G + p for the pair p. pair: (P, 2), pairs of delays.
    coefficient: (K, L); delayed: (K, 2), parts; exponent, degree: (K,), of the sums that are kept.
    delay, factor: (G + P,). minor: (2, L). roots: (`MAX_ROOTS`,). starts: (`MAX_STARTS`,).
    """

    chosen: np.ndarray
    place: np.ndarray
    part: np.ndarray
    pair: np.ndarray
    coefficient: np.ndarray
    delayed: np.ndarray
    exponent: np.ndarray
    degree: np.ndarray
    delay: np.ndarray
    factor: np.ndarray
    minor: np.ndarray
    roots: np.ndarray
    starts: np.ndarray

    @classmethod
    def of(cls, numerator: np.ndarray) -> Room:
        """For the angles' part of `RationalRows.folded`, (B, G, R, R, L)."""
        groups, rows, _, length = numerator.shape[1:]
        present = np.asarray(numerator.any(axis=(0, 3, 4)))
        present[0] = True
        every = (c for c in product(range(groups), repeat=rows) if all(present[g, r] for r, g in enumerate(c)))
        chosen = sorted(every, key=lambda c: (sorted(c), c))
        sums = list(dict.fromkeys(tuple(sorted(c)) for c in chosen))
        split = rows - (1 if rows < 3 else 2)
        parts = [[tuple(g for g in part if g > 0) for part in (c[:split], c[split:])] for c in sums]
        pairs = list(dict.fromkeys(part for both in parts for part in both if len(part) == 2))
        place: dict[tuple[int, ...], int] = {
            (): 0,
            **{(g,): g for g in range(groups)},
            **{pair: groups + p for p, pair in enumerate(pairs)},
        }
        longest, values = rows * (length - 1) + 1, groups + len(pairs)
        return cls(
            np.array(chosen, dtype=np.int64),
            np.array([sums.index(tuple(sorted(c))) for c in chosen], dtype=np.int64),
            np.array([[place[part] for part in both] for both in parts], dtype=np.int64),
            np.array(pairs, dtype=np.int64).reshape(-1, 2),
            np.zeros((len(sums), longest)),
            np.zeros((len(sums), 2), dtype=np.int64),
            np.zeros(len(sums)),
            np.zeros(len(sums), dtype=np.int64),
            np.zeros(values),
            np.zeros(values, dtype=np.complex128),
            np.zeros((2, longest)),
            np.zeros(MAX_ROOTS, dtype=np.complex128),
            np.zeros(MAX_STARTS, dtype=np.complex128),
        )


class Loop(NamedTuple):
    """One quasi-polynomial of K sums of delays, and room for its factors, as in `Room`."""

    coefficient: np.ndarray
    exponent: np.ndarray
    delayed: np.ndarray
    degree: np.ndarray
    pair: np.ndarray
    delay: np.ndarray
    factor: np.ndarray


# The determinant


@inner
def _add_minor(upper: np.ndarray, lower: np.ndarray, first: int, second: int, out: np.ndarray) -> None:
    """Add the determinant of two columns of two rows of polynomials, (R, L) each, to ``out``."""
    length = upper.shape[1]
    for i in range(length):
        p, q = upper[first, i], upper[second, i]
        if p != 0.0 or q != 0.0:
            for j in range(length):
                out[i + j] += p * lower[second, j] - q * lower[first, j]


@inner
def _complement(numerator: np.ndarray, chosen: np.ndarray, i: int, j: int, out: np.ndarray) -> None:
    """Determinant of the rows above the last two, one or two, without the columns i < j."""
    for k in range(out.size):
        out[k] = 0.0
    if chosen.size == 3:
        entry = numerator[chosen[0], 0, 3 - i - j]
        for k in range(entry.size):
            out[k] = entry[k]
    else:
        first = 0 if i > 0 else (1 if j > 1 else 2)
        _add_minor(numerator[chosen[0], 0], numerator[chosen[1], 1], first, 6 - i - j - first, out)


@inner
def _add_determinant(numerator: np.ndarray, chosen: np.ndarray, minor: np.ndarray, out: np.ndarray) -> None:
    """Add the determinant of R rows, each with one delay of its own, to ``out``: Laplace's expansion by two rows."""
    rows = chosen.size
    if rows == 1:
        entry = numerator[chosen[0], 0, 0]
        for k in range(entry.size):
            out[k] += entry[k]
        return
    upper, lower = numerator[chosen[rows - 2], rows - 2], numerator[chosen[rows - 1], rows - 1]
    if rows == 2:
        _add_minor(upper, lower, 0, 1, out)
        return
    for i in range(rows):
        for j in range(i + 1, rows):
            for k in range(out.size):
                minor[0, k] = 0.0
            _add_minor(upper, lower, i, j, minor[0])
            _complement(numerator, chosen, i, j, minor[1])
            sign = 1.0 if (i + j) % 2 == 1 else -1.0
            for k in range(out.size):
                if minor[0, k] != 0.0:
                    for m in range(out.size - k):
                        out[k + m] += sign * minor[0, k] * minor[1, m]


@inner
def _degree(polynomial: np.ndarray) -> int:
    """Degree, -1 of zero."""
    top = -1
    for j in range(polynomial.size):
        if polynomial[j] != 0.0:
            top = j
    return top


@inner
def _characteristic(numerator: np.ndarray, delay: np.ndarray, room: Room) -> int:
    """Expand det A over sums of delays; returns the number of sums kept. The first is the undelayed one."""
    chosen, place, part, pair, coefficient, delayed, exponent, degree, times, _, _, _, _ = room
    groups = delay.size
    for g in range(groups):
        times[g] = delay[g]
    for p in range(pair.shape[0]):
        times[groups + p] = delay[pair[p, 0]] + delay[pair[p, 1]]
    count, kept, at = chosen.shape[0], 0, 0
    while at < count:
        for j in range(coefficient.shape[1]):
            coefficient[kept, j] = 0.0
        k = place[at]
        while at < count and place[at] == k:
            _add_determinant(numerator, chosen[at], room.minor, coefficient[kept])
            at += 1
        top = _degree(coefficient[kept])
        if top >= 0 or kept == 0:
            delayed[kept, 0], delayed[kept, 1], degree[kept] = part[k, 0], part[k, 1], top
            exponent[kept] = times[part[k, 0]] + times[part[k, 1]]
            kept += 1
    return kept


@inner
def _merge_instant(loop: Loop) -> None:
    """Add what a delay of zero would make neutral or advanced to the undelayed part."""
    coefficient, exponent, _, degree, _, _, _ = loop
    for k in range(1, exponent.size):
        if degree[k] >= degree[0] and exponent[k] == 0.0:
            for j in range(degree[k] + 1):
                coefficient[0, j] += coefficient[k, j]
                coefficient[k, j] = 0.0
            degree[0], degree[k] = _degree(coefficient[0]), -1


@inner
def _kind(loop: Loop) -> int:
    """What is known from the coefficients alone: `STATIC`, `ADVANCED`, `SINGULAR`, else `FAILED` (until searched)."""
    coefficient, exponent, _, degree, _, _, _ = loop
    n, delayed = degree[0], -1
    for k in range(exponent.size):
        if k > 0:
            delayed = max(delayed, degree[k])
        for j in range(degree[k] + 1):
            if not abs(coefficient[k, j]) < 1e300:
                return SINGULAR
    if delayed > n:
        return ADVANCED
    if n < 0:
        return SINGULAR
    return STATIC if n == 0 and delayed < 0 else FAILED


@inner
def _unit(loop: Loop, total: np.ndarray) -> float:
    """Unit in which the roots are of the order of one, 1/s: one, unless all roots are fast, or all are slow.

    From the polynomial sum c_j s^j that f is without its delays: the smallest of its roots is as large as the smallest
    |c_0 / c_j|^(1/j), up to factors 1/2 and n. Long delays make slow roots. ``total``: room for the c_j.
    """
    n = loop.degree[0]
    longest = 0.0
    for j in range(n + 1):
        total[j] = 0.0
    for k in range(loop.exponent.size):
        longest = max(longest, loop.exponent[k])
        for j in range(loop.degree[k] + 1):
            total[j] += loop.coefficient[k, j]
    fast, slow, smallest = longest * FAST < 10.0, True, math.inf
    for j in range(1, n + 1):
        fast = fast and abs(total[j]) * FAST**j < abs(total[0])
        slow = slow and abs(total[n - j]) < abs(total[n]) * SLOW**j
    if not (fast or slow) or total[0] == 0.0:
        return 1.0
    for j in range(1, n + 1):
        if total[j] != 0.0:
            smallest = min(smallest, abs(total[0] / total[j]) ** (1.0 / j))
    if longest > 0.0:
        smallest = min(smallest, 10.0 / longest)
    return 2.0 ** math.floor(math.log2(smallest)) if smallest < math.inf else 1.0


@inner
def _change_unit(unit: float, loop: Loop) -> None:
    """Count time in 1 / ``unit``."""
    coefficient, exponent, _, degree, _, delay, _ = loop
    for k in range(exponent.size):
        exponent[k] *= unit
        for j in range(degree[k] + 1):
            coefficient[k, j] *= unit ** (j - degree[0])
    for g in range(delay.size):
        delay[g] *= unit


# The search


@inner(forceinline=True)
def _evaluate(s: complex, loop: Loop) -> tuple[complex, complex, complex]:
    """f(s), f'(s) and the undelayed part of f(s)."""
    coefficient, exponent, delayed, degree, pair, delay, factor = loop
    groups = delay.size - pair.shape[0]
    for g in range(1, groups):
        size, phase = math.exp(-delay[g] * s.real), -delay[g] * s.imag
        factor[g] = complex(size * math.cos(phase), size * math.sin(phase))
    for i in range(pair.shape[0]):
        factor[groups + i] = factor[pair[i, 0]] * factor[pair[i, 1]]
    f, df, undelayed = 0j, 0j, 0j
    for k in range(exponent.size):
        p, dp = 0j, 0j
        for j in range(degree[k], -1, -1):
            dp = dp * s + p
            p = p * s + coefficient[k, j]
        if k == 0:
            f, df, undelayed = p, dp, p
        else:
            e = factor[delayed[k, 1]]
            if delayed[k, 0] > 0:
                e *= factor[delayed[k, 0]]
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
        if d != 0.0:
            total += 1.0 / d
        product *= d
        if r.imag != 0.0:
            d = s - r.conjugate()
            if d != 0.0:
                total += 1.0 / d
            product *= d
    return total, product


@inner
def _approach(s: complex, roots: np.ndarray, found: int, loop: Loop) -> tuple[bool, complex]:
    """Newton's iteration with the roots found divided out until it has nearly converged."""
    for _ in range(40):
        f, df, _ = _evaluate(s, loop)
        if f == 0.0:
            return True, s
        total, _ = _deflation(s, roots, found)
        slope = df / f - total
        if slope == 0.0:
            return False, s
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
            return True, s
    return False, s


@inner
def _polish(s: complex, loop: Loop) -> tuple[bool, complex]:
    """Newton's iteration on f itself: quadratic, so that a few steps reach rounding."""
    last = 1e300
    for _ in range(8):
        f, df, _ = _evaluate(s, loop)
        if f == 0.0 or df == 0.0:
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
def _search(s: complex, roots: np.ndarray, found: int, loop: Loop) -> int:
    """Follow one start; store the root that it leads to, unless it is known. Returns how many are."""
    near, s = _approach(s, roots, found, loop)
    if not near or found >= roots.size:
        return found
    if abs(s.imag) < 1e-6 * (1.0 + abs(s)):
        s = complex(s.real, 0.0)
    converged, s = _polish(s, loop)
    if not converged:
        return found
    for j in range(found):
        if abs(s - roots[j]) < 1e-7 * (1.0 + abs(s)):
            return found
    roots[found] = s
    return found + 1


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


# The certificate


@inner
def _neutral_share(sigma: float, loop: Loop) -> float:
    """Delayed leading coefficients with their factors on Re s = ``sigma``, summed, relative to the undelayed one."""
    coefficient, exponent, _, degree, _, _, _ = loop
    n, total = degree[0], 0.0
    for k in range(1, exponent.size):
        if degree[k] == n:
            total += abs(coefficient[k, n]) * math.exp(min(-exponent[k] * sigma, 600.0))
    return total / abs(coefficient[0, n])


@inner
def _dominated(omega: float, sigma: float, share: float, loop: Loop) -> bool:
    """Whether the leading term outweighs all others for every s = sigma + i w with w >= omega."""
    coefficient, exponent, _, degree, _, _, _ = loop
    n = degree[0]
    size = math.hypot(sigma, omega)
    rest = 0.0
    for k in range(exponent.size):
        scale = math.exp(-exponent[k] * sigma)
        for j in range(degree[k] + 1):
            if k > 0 or j < n:
                rest += scale * abs(coefficient[k, j]) * size ** (j - n)
    return rest < (0.95 + 0.05 * share) * abs(coefficient[0, n])


@inner
def _reach(sigma: float, loop: Loop) -> float:
    """Frequency from which on the leading term dominates on the line; infinite if there is none."""
    share = _neutral_share(sigma, loop)
    end = 1.0
    while not _dominated(end, sigma, share, loop):
        end *= 1.25
        if end > 1e12:
            return math.inf
    return end


@inner(forceinline=True)
def _deflated(s: complex, roots: np.ndarray, found: int, loop: Loop) -> tuple[complex, complex, float]:
    """f with the roots found divided out, its logarithmic derivative, and the delayed part relative to the other."""
    f, df, undelayed = _evaluate(s, loop)
    if f == 0.0:
        return f, complex(math.inf, 0.0), 0.0
    total, product = _deflation(s, roots, found)
    return f / product, df / f - total, abs(f - undelayed) / abs(undelayed)


@inner
def _march(
    sigma: float, end: float, roots: np.ndarray, found: int, starts: np.ndarray, loop: Loop
) -> tuple[bool, float, float, int]:
    """Go up the line from the real axis: whether it was resolved, the frequency reached, the change of the phase of f
    with the roots found divided out, and how many starts were stored.
    """
    longest = 0.0
    for k in range(loop.exponent.size):  # numba's own `max` would load its array mathematics, and SciPy's with it
        longest = max(longest, loop.exponent[k])
    widest = 1.0 / max(longest, 0.02)
    omega, phase, stored = 0.0, 0.0, 0
    previous = complex(sigma, 0.0)
    value, slope, _ = _deflated(previous, roots, found, loop)
    if not abs(slope) < 1e300:
        return False, omega, phase, 0
    two, one = 0.0, 0.0
    step, delayed = widest, math.inf
    for _ in range(MAX_MARCH):
        step = min(step, 1.0 / abs(slope), end - omega)
        if delayed > 0.1:
            step = min(step, widest)
        s = complex(sigma, omega + step)
        new_value, new_slope, new_delayed = _deflated(s, roots, found, loop)
        ratio = new_value * value.conjugate()
        change = math.atan2(ratio.imag, ratio.real)
        predicted = 0.5 * step * (slope.real + new_slope.real)
        if not abs(change - predicted) < 0.3:
            step *= 0.5
            if step < 1e-10:
                return False, omega, phase, 0
            continue
        if one >= two and one > abs(slope):
            stored = _more(previous, starts, stored)
        two, one, previous = one, abs(slope), complex(sigma, omega)
        phase += change
        omega += step
        value, slope, delayed = new_value, new_slope, new_delayed
        if omega >= end * (1.0 - 1e-12):
            return True, omega, phase, stored
        step *= 3.0
    return False, omega, phase, 0


@inner
def _count_right(sigma: float, roots: np.ndarray, found: int, starts: np.ndarray, loop: Loop) -> tuple[int, int]:
    """Number of roots right of Re s = sigma (-1 if not resolved), and how many starts were stored."""
    end = _reach(sigma, loop)
    if end == math.inf:
        return -1, 0
    resolved, omega, phase, stored = _march(sigma, end, roots, found, starts, loop)
    if not resolved:
        return -1, 0
    n = loop.degree[0]
    s = complex(sigma, omega)
    f, _, _ = _evaluate(s, loop)
    for j in range(found):
        d = s - roots[j]
        phase += math.atan2(d.imag, d.real)
        if roots[j].imag != 0.0:
            d = s - roots[j].conjugate()
            phase += math.atan2(d.imag, d.real)
    angle = math.atan2(omega, sigma)
    lead = f / loop.coefficient[0, n] * complex(math.cos(n * angle), -math.sin(n * angle))
    phase += n * (0.5 * math.pi - angle) - math.atan2(lead.imag, lead.real)
    right = 0.5 * n - phase / math.pi
    nearest = round(right)
    if abs(right - nearest) > 1e-3 or nearest < 0:
        return -1, stored
    return nearest, stored


@inner
def _chain(loop: Loop) -> float:
    """Abscissa that bounds the root chains of a neutral system (-inf if retarded): the neutral share is one there."""
    if _neutral_share(0.0, loop) == 0.0:
        return -math.inf
    low, high = -1e4, 1e4
    for _ in range(80):
        c = 0.5 * (low + high)
        if _neutral_share(c, loop) > 1.0:
            low = c
        else:
            high = c
    return high


@inner
def _fan(attempt: int, line: float, starts: np.ndarray, count: int) -> int:
    """Starts right of the line, for the fast and the slow roots that the march has missed."""
    for j in range(attempt + 1):
        count = _more(complex(line + 2.0 * j + 1.0, 1.0 + 0.5 * j), starts, count)
        count = _more(complex(line + 5.0 * j + 2.0, 0.0), starts, count)
    return count


@inner
def _certified(found: int, room: Room, loop: Loop) -> tuple[complex, int, int]:
    """Rightmost root, outcome and certificates tried; ``found`` roots are known."""
    roots, starts = room.roots, room.starts
    chain = _chain(loop)
    count = _scan(0.0, starts, loop)
    count = _more(complex(1.0, 2.0), starts, count)
    best = complex(math.nan, math.nan)
    for attempt in range(1, ROUNDS + 1):
        for i in range(count):
            found = _search(starts[i], roots, found, loop)
        line = 0.0
        if found:
            best = complex(-math.inf, 0.0)
            for j in range(found):
                if roots[j].real > best.real:
                    best = roots[j]
            line = best.real + LINE_OFFSET * (1.0 + abs(best))
        line = max(line, chain + CHAIN_MARGIN)
        right, count = _count_right(line, roots, found, starts, loop)
        if right == 0 and chain > -math.inf and not best.real > chain + CHAIN_MARGIN:
            return best if best.real > chain else complex(chain, math.nan), CHAIN, attempt
        if right == 0 and found:
            return best, CERTIFIED, attempt
        count = _fan(attempt, line, starts, count)
    return best, FAILED, ROUNDS


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

    numerator (B, G, R, R, L), the angles' part of `RationalRows.folded`; delay (B, G); hints (B, Q) complex, more
    starts (NaN: none); room, to work in. Writes root (B,) complex with Im >= 0, outcome (B,) and rounds (B,), the
    certificates tried.
    """
    for b in range(numerator.shape[0]):
        root[b], rounds[b] = complex(math.nan, math.nan), 0
        kept = _characteristic(numerator[b], delay[b], room)
        parts = room.exponent[:kept], room.delayed[:kept], room.degree[:kept]
        loop = Loop(room.coefficient[:kept], *parts, room.pair, room.delay, room.factor)
        _merge_instant(loop)
        outcome[b] = _kind(loop)
        if outcome[b] != FAILED:
            continue
        unit = _unit(loop, room.minor[0])
        if unit != 1.0:
            _change_unit(unit, loop)
        found = np.int64(0)  # a literal 0 would be a type of its own: its callees would be compiled twice
        for q in range(hints.shape[1]):
            if abs(hints[b, q]) < 1e300:
                found = _search(hints[b, q] / unit, room.roots, found, loop)
        best, outcome[b], rounds[b] = _certified(found, room, loop)
        root[b] = complex(best.real * unit, best.imag * unit)
