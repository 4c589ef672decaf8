"""What a periodic stimulus is, from one of its cycles: a pseudorandom sequence and its states, or a sum of sines.

A pseudorandom sequence of base q and order n (an m-sequence, q = 2, 3 or 5) has q^n - 1 states of one duration; its
velocity, or the stimulus itself, takes q equally spaced values in them (Peterka 2002 for q = 3, the PRTS). Where its
half cycles differ in sign only, it has odd harmonics only.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

BASES = {2: "pseudorandom binary sequence", 3: "PRTS", 5: "pseudorandom five-state sequence"}

MOST_STATES = 20_000

LEAST_SAMPLES = 2
"""Samples of a state, at least, by which it is recognised."""

SHIFTS = 16
"""Beginnings of a cycle within a state that are tried."""

ALIKE = 0.03
"""Largest RMS difference from the sequence of states, relative to the RMS of the stimulus."""

LEVEL = 0.2
"""Largest distance of a value from its level, relative to the distance of levels."""

MOST_SINES = 40

POWER = 0.999
"""Share of the power that is all of it; a sum of few sines has it in few lines."""


def family(cycle: np.ndarray, rate_hz: float) -> str:
    """The family of a stimulus, in words, from one cycle (n,)."""
    u = cycle - cycle.mean()
    power = np.abs(np.fft.rfft(u)) ** 2
    harmonics = _harmonics(power)
    for base, what in BASES.items():
        for order in _orders(base, u.size):
            states = base**order - 1
            if _has_states(u, states, base):
                lasts = u.size / states / rate_hz
                return f"{what} of {states} states of {lasts:.4g} s (base {base}, order {order}){harmonics}"
    strongest = np.sort(power)[::-1].cumsum() / power.sum()
    count = int(np.searchsorted(strongest, POWER)) + 1
    if count <= MOST_SINES and strongest[count - 1] > 1 - (1 - POWER) / 10:
        at = np.sort(np.argsort(power)[::-1][:count]) * rate_hz / u.size
        shown = ", ".join(f"{f:.4g}" for f in at[:8]) + (", ..." if count > 8 else "")
        return f"{'sine' if count == 1 else f'sum of {count} sines'} ({shown} Hz)"
    return f"no sequence that is known here{harmonics}"


def _harmonics(power: np.ndarray) -> str:
    total = power[1:].sum()
    if power[1::2].sum() > POWER * total:
        return ", odd harmonics only"
    return ", harmonics 2, 6, 10, ... only" if power[2::4].sum() > POWER * total else ""


def _orders(base: int, samples: int) -> Iterator[int]:
    order = 2
    while (states := base**order - 1) <= min(MOST_STATES, samples // LEAST_SAMPLES):
        if states > 2 * base:
            yield order
        order += 1


def _has_states(u: np.ndarray, states: int, base: int) -> bool:
    """Whether the velocity of a stimulus, or itself, is constant in each of so many states, at so many levels."""
    per, size = u.size / states, np.sqrt(np.mean(u**2))
    at, twice = np.arange(2 * u.size), np.concatenate([u, u])
    for shift in np.arange(SHIFTS) * per / SHIFTS:
        edges = shift + per * np.arange(states + 1)
        knots = np.interp(edges, at, twice)
        line = np.interp(at[: u.size] + shift, edges, knots)
        if np.sqrt(np.mean((np.interp(at[: u.size] + shift, at, twice) - line) ** 2)) <= ALIKE * size:
            if _at_levels(np.diff(knots), base):
                return True
            continue
        middles = (edges[:-1, None] + per * np.array([0.25, 0.5, 0.75])).ravel()
        held = np.interp(middles, at, twice).reshape(states, 3)
        if np.ptp(held, axis=1).max() <= 2 * ALIKE * size and _at_levels(held[:, 1], base):
            return True
    return False


def _at_levels(values: np.ndarray, base: int) -> bool:
    """Whether values are at ``base`` equally spaced levels, each as often as in an m-sequence (one fewer of one)."""
    low, high = float(values.min()), float(values.max())
    step = (high - low) / (base - 1)
    if step <= 0:
        return False
    nearest = np.rint((values - low) / step)
    if np.abs((values - low) / step - nearest).max() > LEVEL:
        return False
    counts = np.bincount(nearest.astype(int), minlength=base)
    return bool(counts.max() - counts.min() <= 1)
