"""Measured sway in time, and what both models of a diagnosis predict of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from mcstudy.errors import InputError
from mcstudy.gap.frf_only import FrfRecording
from mcstudy.gap.leakage import difference_coefficients
from mcstudy.gap.recording import Recording
from mcstudy.report.gap_data import GapData
from mcstudy.spectra.periods import cut

WINDOW_S = 60.0
"""How much of a recording without a period is shown, from its middle, s."""


@dataclass(frozen=True)
class SwayTraces:
    """Sway of one amplitude, held to the frequencies that were diagnosed; angles (n, 2) in degrees.

    Attributes
    ----------
    t: (n,) s. measured: mean cycle over all trials of this amplitude, or a stretch of the first trial when the
    stimulus has no period. error: (2,) standard error of ``measured`` at a point, nan where there is no mean.
    before, after: predicted by the models (after None where nothing was added). what: in words. amplitude: peak.
    """

    t: np.ndarray
    measured: np.ndarray
    error: np.ndarray
    before: np.ndarray
    after: np.ndarray | None
    what: str
    amplitude: float

    @classmethod
    def of(cls, data: GapData) -> SwayTraces:
        """Traces of the trials with the largest amplitude. Raises `InputError` for a published FRF: it has none."""
        recording = data.recording
        if isinstance(recording, FrfRecording):
            raise InputError(f"{recording.name}: expected time series, got a published FRF")
        return _of_cycles(data, recording) if recording.period_s is not None else _of_stretch(data, recording)


def _of_cycles(data: GapData, recording: Recording) -> SwayTraces:
    period, discard = recording.period, int(data.diagnosis.method.get("discard", 1))
    assert period is not None
    peak = float(recording.amplitudes.max())
    trials = [t for t in recording.trials if t.peak > 0.98 * peak]
    f = fft.rfftfreq(period, 1 / recording.rate_hz)
    keep = (f >= data.lines.f[0] * 0.999) & (f <= data.lines.f[-1] * 1.001)
    # increments instead of samples: the step from a cycle's end to its beginning is noise that would spread over it
    spectra = np.array(
        [
            difference_coefficients(t.theta, c * period, period, f.size)[1] * keep[:, None]
            for t in trials
            for c in range(discard, t.samples // period)
        ]
    )
    drive = np.concatenate([cut(t.stimulus, period, discard) for t in trials]).mean(axis=0)
    cycles = fft.irfft(spectra, period, axis=1, norm="forward")
    error = cycles.std(axis=0, ddof=1).mean(axis=0) / np.sqrt(len(cycles)) if len(cycles) > 1 else np.full(2, np.nan)
    before, after = _predicted(data, fft.rfft(drive), f, keep, period)
    what = f"mean of {len(cycles)} cycles"
    return SwayTraces(
        np.arange(period) / recording.rate_hz, _degrees(cycles.mean(axis=0)), _degrees(error), before, after, what, peak
    )


def _of_stretch(data: GapData, recording: Recording) -> SwayTraces:
    trial = recording.trials[int(recording.amplitudes.argmax())]
    n = trial.samples
    # the padding holds what the body still answers after the end, which would else wrap to the beginning
    f = fft.rfftfreq(2 * n, 1 / recording.rate_hz)
    keep = (f >= data.lines.f[0] * 0.999) & (f <= data.lines.f[-1] * 1.001)
    drive = fft.rfft(trial.stimulus - trial.stimulus.mean(), 2 * n)
    theta = fft.rfft(trial.theta - trial.theta.mean(axis=0), 2 * n, axis=0) * keep[:, None]
    measured = _degrees(fft.irfft(theta, 2 * n, axis=0))
    before, after = _predicted(data, drive, f, keep, 2 * n)
    half = min(n, round(WINDOW_S * recording.rate_hz)) // 2
    window = slice(n // 2 - half, n // 2 + half)
    return SwayTraces(
        np.arange(window.start, window.stop) / recording.rate_hz,
        measured[window],
        np.full(2, np.nan),
        before[window],
        None if after is None else after[window],
        f"{2 * half / recording.rate_hz:.0f} s from the middle of a trial",
        trial.peak,
    )


def _predicted(
    data: GapData, drive: np.ndarray, f: np.ndarray, keep: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray | None]:
    """Sway (n, 2) in degrees that both models answer to a drive with spectrum (K,)."""

    def answer(response: np.ndarray) -> np.ndarray:
        spectrum = np.zeros((f.size, 2), dtype=complex)
        spectrum[keep] = response * drive[keep, None]
        return _degrees(fft.irfft(spectrum, n, axis=0))

    after = data.after(f[keep])
    return answer(data.before(f[keep])), None if after is None else answer(after)


def _degrees(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.rad2deg(x))
