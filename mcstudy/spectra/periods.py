"""From a record of whole periods to Fourier coefficients, and the one place that fixes their convention.

Fourier coefficient k of a period of P samples is (1/P) * sum x[n] exp(-2 pi i k n / P), in units of the signal.

Sway is not periodic: the noise-evoked part of it starts and ends a cycle at different values, and the rectangular DFT
of that step leaks ~ 1/k into every line. At 4 to 8 Hz, where true sway is tiny, the leak is most of the spectrum, and
the same number at all neighbouring lines. Subtracting the single straight ramp that joins the two ends removes it
(derived): it turns the DFT into that of the *increments* of the signal, whose spectrum is flat enough not to leak.

- `raw`: the plain DFT of the mean cycle; what the paper did.
- `ramp_removed`: the better estimator, used in every statistical test.
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
    """Fourier coefficients of the mean period, the DFT as it comes; see `Spectrum`."""
    return coefficients(mean_period(x, period, discard))


def ramp_removed(x: np.ndarray, period: int, discard: int) -> np.ndarray:
    """Fourier coefficients of the mean period after removing the ramp that joins its two ends; see `Spectrum`.

    The mean of the ramps of consecutive cycles is the ramp over all of them, divided by their number. The ramp needs
    one sample more than the cycles hold: the sample before them when a cycle was discarded, else the one after.
    Raises `RecordingError` when the record has neither.
    """
    x = np.asarray(x)
    cycles = cut(x, period, discard).shape[0]
    start, stop = discard * period, (discard + cycles) * period
    if start > 0:
        start, stop = start - 1, stop - 1
    elif stop >= x.shape[0]:
        raise RecordingError(
            "recording: removing the ramp needs one sample before or after the analysed periods; discard one period"
        )
    change = (x[stop] - x[start]) / cycles
    return raw(x, period, discard) - change * _ramp_coefficients(period, discard > 0, x.ndim - 1)


def _ramp_coefficients(period: int, ahead: bool, n_trailing: int) -> np.ndarray:
    """Coefficients of the ramp n / period, one sample further along (``ahead``) when measured from the sample before.

    Closed form of the geometric sum: 1 / (period * (w - 1)) with w = exp(-2 pi i k / period); the mean is left in x.
    """
    k = np.arange(1, period // 2 + 1)
    w = np.exp(-2j * np.pi * k / period)
    out = np.zeros(period // 2 + 1, dtype=complex)
    out[1:] = (w if ahead else 1.0) / (period * (w - 1.0))
    return out.reshape(-1, *(1,) * n_trailing)
