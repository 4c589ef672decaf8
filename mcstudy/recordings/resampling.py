"""Channels of different rates brought to a common one, and short gaps filled.

A rate is changed by a finite impulse response filter without phase shift (`scipy.signal.resample_poly`, Kaiser window),
which passes frequencies up to 0.8 of half the lower rate unchanged (to 1e-4) and suppresses those that would fold.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from mcstudy.errors import RecordingError

HALF_LENGTH = 30
"""Half the length of the filter in samples of the lower rate."""

KAISER = 9.0
"""Shape of its window: 90 dB in the stop band."""

MOST_PARTS = 10_000
"""Largest numerator and denominator of a ratio of rates."""

LATE = 0.01
"""Largest lag, in samples, at the end of values whose ratio of rates was rounded: time stamps give 59.9400003 Hz."""

METHOD = f"zero-phase FIR filter (Kaiser {KAISER:g}, {2 * HALF_LENGTH} samples)"


def resampled(values: np.ndarray, rate_hz: float, to_hz: float, where: str) -> np.ndarray:
    """Values (n,) at another rate, from the same first instant; raises `RecordingError` for an odd ratio of rates."""
    from scipy.signal import firwin, resample_poly

    ratio = Fraction(to_hz / rate_hz).limit_denominator(MOST_PARTS)
    up, down = ratio.numerator, ratio.denominator
    if not (0 < up <= MOST_PARTS and abs(float(ratio) * rate_hz / to_hz - 1) * values.size < LATE):
        raise RecordingError(f"{where}: {rate_hz:g} and {to_hz:g} Hz have no simple ratio; resample before the import")
    if up == down:
        return values
    wide = max(up, down)
    taps = firwin(2 * HALF_LENGTH * wide + 1, 1 / wide, window=("kaiser", KAISER))
    return np.asarray(resample_poly(values, up, down, window=taps, padtype="line"))


def at_regular_times(values: np.ndarray, stamps: np.ndarray, rate_hz: float) -> np.ndarray:
    """Values (n,) sampled at ``stamps`` (n,), s, from the first on, at regular times: a cubic spline through them.

    It passes what is well below half the mean rate. Around missing values (nan), they are missing.
    """
    from scipy.interpolate import CubicSpline

    known = np.isfinite(values)
    times = np.arange(int(stamps[-1] * rate_hz * (1 + 1e-12)) + 1) / rate_hz
    if known.sum() < 2:
        return np.full(times.size, np.nan)
    lost = np.interp(times, stamps, (~known).astype(float)) > 0
    return np.where(lost, np.nan, CubicSpline(stamps[known], values[known])(times))


def filled(values: np.ndarray, longest: int, where: str, rate_hz: float) -> tuple[np.ndarray, int]:
    """Values (n,) with gaps of at most ``longest`` samples interpolated (monotone cubic), and how many were filled.

    Longer gaps, and gaps at the ends, raise `RecordingError` with their place.
    """
    bad = ~np.isfinite(values)
    if not bad.any():
        return values, 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    wide = np.flatnonzero((ends - starts > longest) | (starts == 0) | (ends == values.size))
    if wide.size:
        k = int(wide[0])
        place = "at the start" if starts[k] == 0 else "at the end" if ends[k] == values.size else ""
        place = place or f"at t = {starts[k] / rate_hz:g} s"
        raise RecordingError(
            f"{where}: {int(bad.sum())} of {values.size} values are missing; a gap of "
            f"{(ends[k] - starts[k]) / rate_hz:g} s {place} is not filled"
            + ("" if longest else "; to interpolate short gaps, state fill_gaps_s")
        )
    return interpolated(values, bad), int(bad.sum())


def interpolated(values: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Values (n,) with those in ``gap`` (n,), bool, replaced by a monotone cubic through the others (pchip)."""
    from scipy.interpolate import PchipInterpolator

    at = np.arange(values.size)
    return np.where(gap, PchipInterpolator(at[~gap], values[~gap])(at), values)


def whole_samples(seconds: float, rate_hz: float) -> int:
    """How many samples fit in a duration; 0.29 s at 100 Hz are 29."""
    return int(seconds * rate_hz * (1 + 1e-9))
