"""Measured sway in time, and the predictions of both models of a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from mcstudy.errors import InputError
from mcstudy.recordings.recording import LEAST_CYCLES, Recording
from mcstudy.report.diagnosis.data import GapData
from mcstudy.spectra.leakage import difference_coefficients
from mcstudy.spectra.periodic import polarity

WINDOW_S = 60.0
"""Length of the part shown of a recording without a period, s, taken from its middle."""


@dataclass(frozen=True)
class SwayTraces:
    """Sway of one amplitude, limited to the diagnosed frequencies; (n, Y) in ``units``, ° for angles in rad.

    Attributes
    ----------
    t: (n,) s. measured: mean cycle over all trials of this amplitude, or a stretch of the first trial when the
    stimulus has no period. error: (Y,) standard error of ``measured`` at a point, nan where there is no mean.
    before, after: predicted by the models (after is None when no cause was added). what: description as text.
    amplitude: peak of the stimulus. added_name: what the model with the cause is called. names, units: of the columns.
    """

    t: np.ndarray
    measured: np.ndarray
    error: np.ndarray
    before: np.ndarray
    after: np.ndarray | None
    what: str
    amplitude: float
    added_name: str
    names: list[str]
    units: list[str]

    @classmethod
    def of(cls, data: GapData) -> SwayTraces:
        """Traces of the trials with the largest amplitude. Raises `InputError` when there are no time series."""
        recording = data.diagnosis.recording
        if not isinstance(recording, Recording):
            kind = "lines alone" if recording is None else "a published FRF"
            raise InputError(f"{data.diagnosis.name}: expected a diagnosis of time series, got one of {kind}")
        return _of_cycles(data, recording) if recording.period_s is not None else _of_stretch(data, recording)


def _of_cycles(data: GapData, recording: Recording) -> SwayTraces:
    period, discard = recording.period, data.diagnosis.method.discard
    assert period is not None
    assert isinstance(discard, int)  # a joint recording is drawn by its parts
    peak = float(recording.amplitudes.max())
    trials = [
        (t, cycles)
        for t, cycles in zip(recording.trials, recording.analysed(discard), strict=True)
        if t.peak > 0.98 * peak and len(cycles) >= LEAST_CYCLES
    ]
    f = fft.rfftfreq(period, 1 / recording.rate_hz)
    keep = (f >= data.lines.f[0] * 0.999) & (f <= data.lines.f[-1] * 1.001)
    # increments instead of samples, because the step between the ends of a cycle would leak into all lines
    spectra = np.array(
        [
            difference_coefficients(t.theta, c * period, period, f.size)[1] * keep[:, None]
            for t, cycles in trials
            for c in cycles
        ]
    )
    drives = np.array([t.stimulus[c * period : (c + 1) * period] for t, cycles in trials for c in cycles])
    sign = polarity(fft.rfft(drives, axis=1))[:, None]
    drive = (sign * drives).mean(axis=0)
    cycles = sign[..., None] * fft.irfft(spectra, period, axis=1, norm="forward")
    error = (
        cycles.std(axis=0, ddof=1).mean(axis=0) / np.sqrt(len(cycles))
        if len(cycles) > 1
        else np.full(cycles.shape[2], np.nan)
    )
    before, after = _predicted(data, fft.rfft(drive), f, keep, period)
    what = f"mean of {len(cycles)} cycles"
    return SwayTraces(
        np.arange(period) / recording.rate_hz,
        data.drawn(cycles.mean(axis=0)),
        data.drawn(error),
        before,
        after,
        what,
        peak,
        data.added_name,
        data.angles,
        data.units,
    )


def _of_stretch(data: GapData, recording: Recording) -> SwayTraces:
    trial = recording.trials[int(recording.amplitudes.argmax())]
    n = trial.samples
    # padding for the response of the body after the end, which would otherwise wrap around to the beginning
    f = fft.rfftfreq(2 * n, 1 / recording.rate_hz)
    keep = (f >= data.lines.f[0] * 0.999) & (f <= data.lines.f[-1] * 1.001)
    drive = fft.rfft(trial.stimulus - trial.stimulus.mean(), 2 * n)
    theta = fft.rfft(trial.theta - trial.theta.mean(axis=0), 2 * n, axis=0) * keep[:, None]
    measured = data.drawn(fft.irfft(theta, 2 * n, axis=0))
    before, after = _predicted(data, drive, f, keep, 2 * n)
    half = min(n, round(WINDOW_S * recording.rate_hz)) // 2
    window = slice(n // 2 - half, n // 2 + half)
    return SwayTraces(
        np.arange(window.start, window.stop) / recording.rate_hz,
        measured[window],
        np.full(measured.shape[1], np.nan),
        before[window],
        None if after is None else after[window],
        f"{2 * half / recording.rate_hz:.0f} s from the middle of a trial",
        trial.peak,
        data.added_name,
        data.angles,
        data.units,
    )


def _predicted(
    data: GapData, drive: np.ndarray, f: np.ndarray, keep: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray | None]:
    """Sway (n, Y) as drawn, predicted by both models for a stimulus with spectrum (K,)."""

    def answer(response: np.ndarray) -> np.ndarray:
        spectrum = np.zeros((f.size, response.shape[1]), dtype=complex)
        spectrum[keep] = response * drive[keep, None]
        return data.drawn(fft.irfft(spectrum, n, axis=0))

    after = data.after(f[keep])
    return answer(data.before(f[keep])), None if after is None else answer(after)
