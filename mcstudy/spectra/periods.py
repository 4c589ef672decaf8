"""Fourier coefficients of a record of whole periods; this module defines their convention.

Fourier coefficient k of a period of P samples is (1/P) * sum x[n] exp(-2 pi i k n / P), in units of the signal.

Sway is not periodic: its noise-evoked part has different values at the start and the end of a cycle. In the DFT this
step leaks into every line as 1/k. At 4 to 8 Hz, where true sway is tiny, leakage dominates the spectrum and has the
same value at all neighbouring lines. Subtracting the straight ramp that joins the two ends removes it (derived): the
DFT becomes that of the *increments* of the signal, whose spectrum is flat enough to have little leakage. With the
stand-in truth, noise variance over its true density in the mean of five cycles is, for the lower body, 2.8 at 4 Hz and
47 at 8 Hz raw (five times that in a single cycle), and 1.0 without the ramp.

- `raw`: the plain DFT of the mean cycle, as in the paper.
- `ramp_removed`: the better estimator, used in all statistical tests.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import fft

from mcstudy.errors import RecordingError

Spectrum = Callable[[np.ndarray, int, int], np.ndarray]
"""A function (record (n, ...), samples in a period, periods to discard) -> coefficients (period // 2 + 1, ...)."""


def cut(x: np.ndarray, period: int, discard: int) -> np.ndarray:
    """Whole periods of a record (n, ...) without the first ``discard``, (cycles, period, ...), as a view.

    Samples after the last whole period are not used. Raises `RecordingError` when no period is left.
    """
    x = np.asarray(x)
    cycles = x.shape[0] // period - discard
    if period < 2 or discard < 0 or cycles < 1:
        raise RecordingError(
            f"recording: expected more than {discard} periods of {period} samples, got {x.shape[0]} samples"
        )
    return x[discard * period : (discard + cycles) * period].reshape(cycles, period, *x.shape[1:])


def mean_period(x: np.ndarray, period: int, discard: int) -> np.ndarray:
    """Mean of the periods of a record (n, ...) after the first ``discard``, (period, ...)."""
    return cut(x, period, discard).mean(axis=0)


def coefficients(cycle: np.ndarray) -> np.ndarray:
    """Fourier coefficients of one period (period, ...) at harmonics 0 ... period // 2."""
    return fft.rfft(cycle, axis=0, norm="forward")


def raw(x: np.ndarray, period: int, discard: int) -> np.ndarray:
    """Fourier coefficients of the mean period, plain DFT; see `Spectrum`."""
    return coefficients(mean_period(x, period, discard))


def ramp_removed(x: np.ndarray, period: int, discard: int) -> np.ndarray:
    """Fourier coefficients of the mean period without the ramp that joins its two ends; see `Spectrum`.

    Equal to subtracting d * n / (cycles * period) from the mean period, with d = x[end + 1] - x[start] over the
    analysed cycles (x[end] - x[start - 1] when the sample before is used), but computed from increments: the difference
    of a periodic signal has coefficients (1 - w) times its own, w = exp(-2 pi i k / period), so the DFT of the
    increments is divided by that. The mean (k = 0) is the raw one.

    Needs one sample more than the analysed cycles: the one before them if a cycle was discarded, otherwise the one
    after. Raises `RecordingError` when the record has neither.
    """
    x = np.asarray(x)
    cycles = cut(x, period, discard).shape[0]
    start, stop = discard * period, (discard + cycles) * period
    w = np.exp(-2j * np.pi * np.arange(1, period // 2 + 1) / period)
    if start > 0:
        start, step = start - 1, 1.0 - w
    elif stop < x.shape[0]:
        stop, step = stop + 1, 1.0 / w - 1.0
    else:
        raise RecordingError(
            "recording: removing the ramp needs one sample before or after the analysed periods; discard one period"
        )
    increments = np.diff(x[start:stop], axis=0).reshape(cycles, period, *x.shape[1:])
    out = coefficients(increments.mean(axis=0))
    out[0] = mean_period(x, period, discard).mean(axis=0)
    out[1:] /= step.reshape(-1, *(1,) * (x.ndim - 1))
    return out
