"""Faults of a signal: values that are held, clipped or zero, spikes, steps, and cycles of a stimulus unlike its others.

An angle is judged by itself. A value is held where it repeats for longer than the rest of the angle ever stays within
a few of its own smallest steps; so coarse resolution, slow sampling and quiet stance are no faults. A jump is a change
from one sample to the next that is many times the usual one, there and in the whole trial, and a notable part of
the sway. A stimulus may be constant by design, so it is only compared with its own other cycles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEAST_HELD = 4
"""Fewest equal samples that may be a held value."""

EQUAL = 1e-6
"""Difference of values that count as equal, relative to the spread of the signal; less than single precision keeps."""

STEPS = 5.0
"""Range, in smallest steps of the signal, that its other stretches of the length of a held value must exceed."""

CHANGES, CHANGES_SHARE = 30, 0.4
"""Changes of value next to a held one, as many samples before and after it as it has: their least number, and share of
what is usual. An angle that is held by its resolution moves slowly there, and changes at most about 16 times."""

NOTABLE = 0.1
"""Change of value, relative to a typical one, from which it counts; angles of markers also have far smaller ones."""

FREE = 0.1
"""Least share of a trial with which a held value is compared."""

MATTERS = 0.01
"""Movement that a held value hides, relative to the standard deviation of the angle, below which it is no fault."""

BEGINNING_S = 0.25
"""What ends before this is the start from rest, s."""

JUMP = 8.0
"""Change between two samples, in typical ones of the trial and of its neighbourhood, from which it is a jump."""

JUMP_MATTERS = 0.5
"""Least size of a jump relative to the standard deviation of the angle."""

NEAR_S, NEAR = 0.08, 4
"""Neighbourhood of a jump on either side, s, and its fewest samples."""

RETURN_S = 1.0
"""Longest excursion, s; a jump that is not undone within it is a step."""

CLIPPED = 3
"""Fewest stretches at the same end of the range of a clipped channel."""

ALIKE = 0.05
"""Root-mean-square difference of two cycles of a stimulus that are the same, relative to its size."""

DIFFERS = 0.1
"""Least difference of a stimulus from its other cycles, relative to its peak."""

CYCLE_DIFFERS = 0.02
"""Least root-mean-square of these differences over a cycle, relative to that of the stimulus."""

CONSTANT = 0.02
"""Range of a stimulus that counts as constant, relative to its peak."""

TRAILING_S, TRAILING = 10.0, 3.0
"""Least duration, s, of a constant end of a stimulus that never repeats, and relative to its longest other one."""


@dataclass(frozen=True, order=True)
class Fault:
    """A fault of one channel: samples ``start`` to ``stop`` - 1.

    ``kind``: "held", "clipped", "spike" or "step" of an angle; "constant" or "different" of a stimulus. ``size``: the
    held value or the height of the jump, in the unit of the channel.
    """

    start: int
    stop: int
    kind: str
    size: float


def angle_faults(x: np.ndarray, rate_hz: float) -> tuple[Fault, ...]:
    """Faults of an angle (n,), in order of time."""
    n = x.size
    low, middle, high = np.quantile(x, (0.05, 0.5, 0.95))
    spread = float(high - low) or float(np.ptp(x))
    if n < 10 * LEAST_HELD or spread == 0:
        return ()
    equal = max(EQUAL * spread, 4 * float(np.finfo(np.float32).eps) * float(np.quantile(np.abs(x), 0.95)))
    step = np.diff(x)
    size = np.abs(step)
    moves = size > equal
    if not moves.any():
        return ()
    sd = 1.4826 * float(np.median(np.abs(x - middle)))
    typical = 1.4826 * float(np.median(size[moves]))
    jumps = _jumps(step, moves, max(JUMP * typical, MATTERS * sd), rate_hz)
    held = _held(x, moves, jumps, equal, float(np.quantile(size[moves], 0.01)), sd, typical)
    faults = [*held, *_excursions(x, jumps[size[jumps] > JUMP_MATTERS * sd], held, rate_hz)]
    return tuple(sorted(f for f in faults if f.stop > BEGINNING_S * rate_hz))


def _held(
    x: np.ndarray, moves: np.ndarray, jumps: np.ndarray, equal: float, smallest: float, sd: float, typical: float
) -> list[Fault]:
    """Values that repeat; ``moves`` (n - 1,): where the next sample differs by more than ``equal``.

    Those that begin or end with one of the ``jumps`` need no further evidence.
    """
    n = x.size
    edges = np.concatenate([[0], np.flatnonzero(moves) + 1, [n]])
    starts, lengths = edges[:-1], np.diff(edges)
    longest = int(lengths.max())
    jumping = (np.isin(starts - 1, jumps) | np.isin(starts + lengths - 1, jumps)) & (lengths >= LEAST_HELD)
    stretches: list[tuple[int, int]] = []
    width, high, low = 1, x, x
    while 2 * width <= longest:
        high, low = np.maximum(high[:-width], high[width:]), np.minimum(low[:-width], low[width:])
        width *= 2
        stretch_numbers = np.flatnonzero((lengths >= width) & (lengths < 2 * width))
        if width < LEAST_HELD or stretch_numbers.size == 0:
            continue
        # Windows of this width that meet no value held as long: what the angle does otherwise.
        meets = np.zeros(high.size + 1, dtype=int)
        for_long = np.flatnonzero(lengths >= width)
        np.add.at(meets, np.maximum(starts[for_long] - width + 1, 0), 1)
        np.add.at(meets, np.minimum(starts[for_long] + lengths[for_long], high.size), -1)
        free = np.cumsum(meets[:-1]) == 0
        if free.sum() < FREE * n:
            continue
        ranges = (high - low)[free]
        least, usual = float(ranges.min()), float(np.median(ranges))
        if least <= STEPS * max(smallest, equal):
            continue
        for k in stretch_numbers:
            a, b = int(starts[k]), int(starts[k] + lengths[k])
            if np.ptp(x[a:b]) > 2 * equal:  # moves slowly, in steps too small to count
                continue
            if least > STEPS * _resolution(x, float(x[a]), equal) and max(usual, _abrupt(x, a, b)) >= MATTERS * sd:
                stretches.append((a, b))
    changes = np.abs(np.diff(x)) > max(NOTABLE * typical, equal)
    stretches = [(a, b) for a, b in stretches if a > 0 and _lively(changes, a, b)]
    stretches = sorted({*stretches, *((int(starts[k]), int(starts[k] + lengths[k])) for k in np.flatnonzero(jumping))})
    ends = {e: sum(abs(x[a] - e) <= equal for a, _ in stretches) for e in (float(x.max()), float(x.min()))}

    def kind(a: int, b: int) -> str:
        at_end = any(many >= CLIPPED and abs(x[a] - e) <= equal for e, many in ends.items())
        return "clipped" if at_end and _abrupt(x, a, b) <= JUMP * typical else "held"

    return [Fault(a, b, kind(a, b), float(x[a])) for a, b in stretches]


def _abrupt(x: np.ndarray, start: int, stop: int) -> float:
    """The larger change with which a held value begins or ends."""
    return max(abs(float(x[start] - x[max(start - 1, 0)])), abs(float(x[min(stop, x.size - 1)] - x[stop - 1])))


def _lively(changes: np.ndarray, start: int, stop: int) -> bool:
    """Whether the samples next to a held value change as often as is usual."""
    n = stop - start
    before, after = changes[max(start - n, 0) : start], changes[stop - 1 : stop - 1 + n]
    usual = CHANGES_SHARE * (before.size + after.size) * float(changes.mean())
    return int(before.sum() + after.sum()) >= max(CHANGES, usual)


def _resolution(x: np.ndarray, value: float, equal: float) -> float:
    """Smallest distance of two values of a signal that are at least as large as ``value``.

    Numbers of few digits are coarser the larger they are.
    """
    above = np.abs(x)
    gaps = np.diff(np.unique(above[above >= abs(value) - equal]))
    gaps = gaps[gaps > equal]
    return float(gaps.min()) if gaps.size >= 10 else 0.0


def _jumps(step: np.ndarray, moves: np.ndarray, least: float, rate_hz: float) -> np.ndarray:
    """Indices of steps (n - 1,) above ``least`` that are jumps."""
    size = np.abs(step)
    large = np.flatnonzero(size > least)
    reach = max(NEAR, round(NEAR_S * rate_hz))
    near = []
    for k in large:
        around = np.r_[max(k - reach, 0) : max(k - 1, 0), k + 2 : k + reach + 1]
        around = around[around < size.size]
        around = around[moves[around]]
        near.append(float(np.median(size[around])) if around.size else 0.0)
    return large[size[large] > JUMP * np.array(near)] if large.size else large


def _excursions(x: np.ndarray, jumps: np.ndarray, held: Sequence[Fault], rate_hz: float) -> list[Fault]:
    """Spikes and steps: jumps that no held value begins or ends with."""
    edges = {e for f in held for e in (f.start - 1, f.stop - 1)}
    left = [int(k) for k in jumps if k not in edges]
    excursions, k = [], 0
    while k < len(left):
        a = left[k]
        height = float(x[a + 1] - x[a])
        back = next(
            (
                m
                for m in range(k + 1, len(left))
                if left[m] - a <= RETURN_S * rate_hz and abs(x[left[m] + 1] - x[a]) < 0.5 * abs(height)
            ),
            None,
        )
        if back is None:
            excursions.append(Fault(a, a + 2, "step", height))
            k += 1
        else:
            excursions.append(Fault(a + 1, left[back] + 1, "spike", height))
            k = back + 1
    return excursions


def stimulus_faults(u: np.ndarray, period: int, rate_hz: float) -> tuple[Fault, ...]:
    """Parts of whole cycles of a stimulus (n,) that are unlike its other cycles; ``period`` in samples.

    None where most cycles differ from each other: then the period is another one.
    """
    n = u.size // period
    if n < 3:
        return ()
    cycles = u[: n * period].reshape(n, period)
    same = _same(cycles)
    if same.sum() < 2:
        return ()
    template = np.median(cycles[same], axis=0)
    size, peak = float(np.std(template)), float(np.ptp(template)) / 2
    error = cycles - template
    error -= np.median(error, axis=1, keepdims=True)
    noise = 1.4826 * float(np.median(np.abs(error[same])))
    off = np.abs(error) > max(DIFFERS * peak, JUMP * noise)
    off &= (np.sqrt((np.where(off, error, 0.0) ** 2).mean(axis=1)) > CYCLE_DIFFERS * size)[:, None]
    out: list[Fault] = []
    for a, b in _stretches(off.ravel(), max(1, round(0.1 * rate_hz))):
        if out and b <= out[-1].stop:
            continue
        kind = "different"
        if np.ptp(u[a:b]) <= CONSTANT * peak:  # as long as it lasts, for it may meet its other cycles meanwhile
            kind, others = "constant", np.flatnonzero(np.abs(u[: n * period] - u[a]) > CONSTANT * peak)
            a, b = int(others[others < a].max(initial=-1)) + 1, int(others[others >= b].min(initial=n * period))
        out.append(Fault(a, b, kind, float(u[a])))
    bad = {c for f in out for c in range(f.start // period, (f.stop - 1) // period + 1)}
    constant = all(f.kind == "constant" for f in out)
    return tuple(out) if n - len(bad) >= 2 and (constant or len(bad) <= n / 3) else ()


def _same(cycles: np.ndarray) -> np.ndarray:
    """Which cycles (C, P) belong to the largest set that is alike; of two of one size, that of the larger stimulus."""
    centred = cycles - cycles.mean(axis=1, keepdims=True)
    gram = centred @ centred.T / cycles.shape[1]
    power = np.diag(gram)
    apart = np.sqrt(np.maximum(power[:, None] + power - 2 * gram, 0.0) / 2)
    alike = apart <= ALIKE * np.sqrt(np.maximum(power[:, None], power))
    alike &= power > 1e-4 * power.max()
    members = alike.sum(axis=1)
    return np.asarray(alike[int(np.lexsort((power, members))[-1])])


def constant_end(u: np.ndarray, rate_hz: float) -> Fault | None:
    """The end of a stimulus (n,) without a period, where it is constant for far longer than ever before, or None."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(u) != 0) + 1, [u.size]])
    lengths = np.diff(edges)
    longest = int(lengths[:-1].max()) if lengths.size > 1 else 0
    if lengths[-1] < max(TRAILING_S * rate_hz, TRAILING * longest):
        return None
    return Fault(int(edges[-2]), u.size, "constant", float(u[-1]))


def _stretches(mask: np.ndarray, closed: int) -> list[tuple[int, int]]:
    """Begin and end of stretches of a mask (n,); those at most ``closed`` samples apart are one."""
    at = np.flatnonzero(mask)
    if at.size == 0:
        return []
    cut = np.flatnonzero(np.diff(at) > closed + 1)
    return [(int(a), int(b) + 1) for a, b in zip(at[np.r_[0, cut + 1]], at[np.r_[cut, at.size - 1]], strict=True)]
