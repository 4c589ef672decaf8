"""Time stamps: the sampling rate they state, and what is done where they are not regular.

Stamps that scatter about a regular clock come from samples that were taken regularly and stamped late (by a computer),
or from samples that were taken when they say. Nobody but the user knows which: a stated rate means the first, a rate
to resample to the second. Rows that were lost leave steps of two or more periods, and are missing values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats.text import LARGEST_NUMBER
from mcstudy.recordings.recording import RATE_HZ, sentences
from mcstudy.recordings.refusals import require_within
from mcstudy.recordings.resampling import at_regular_times

UNIFORM = 1.5
"""Largest step, and largest distance from a regular clock, in periods, of stamps that count as regular."""

SAME_RATE = 1e-3
"""Largest relative difference of two rates that count as the same."""

LONGEST_STEP = 3.0
"""Longest step in periods that is bridged when values are resampled by their stamps; longer ones are gaps."""

SCATTER = 0.05
"""Standard deviation of stamps about a regular clock, in periods, from which on they are told, or followed."""

FINEST = 6
"""Decimals of rounded stamps that are recognised."""

MOST_LOST = 2
"""Most rows per row that is there, of a file that lost rows; fewer would be stamps that come in bursts."""

MOST_REPEATED = 0.1
"""Largest share of rows with the stamp of the row before, whose values are averaged; more are rounded stamps."""

REMEDIES = (
    "if the samples are regular and only their stamps are not, state the rate (rate_hz, --rate); if they were taken "
    "when stamped, resample them (resample_hz, --resample)"
)


@dataclass(frozen=True)
class Clock:
    """When the rows of a file were sampled.

    Attributes
    ----------
    rate_hz
        Of what `regular` returns.
    rows
        (n,), number of each row on a clock that lost none; None where none was lost.
    stamps
        (n,), s from the first; only where values are interpolated at regular times.
    remark
        What was done, in words; empty when the stamps are regular.
    same
        Number of the stamp of each row, where rows share one: their mean counts; None where none does.
    """

    rate_hz: float
    rows: np.ndarray | None = None
    stamps: np.ndarray | None = None
    remark: str = ""
    same: np.ndarray | None = None

    def regular(self, values: np.ndarray) -> np.ndarray:
        """Values (n,) at regular times: as they are, with nan for lost rows, or interpolated by their stamps."""
        if self.same is not None:
            values = np.bincount(self.same, values) / np.bincount(self.same)
        if self.rows is not None:
            out = np.full(int(self.rows[-1]) + 1, np.nan)
            out[self.rows] = values
            return out
        if self.stamps is None:
            return values
        return at_regular_times(values, self.stamps, self.rate_hz)


def rate_of(time: np.ndarray, stated: float | None, where: str) -> float:
    """Sampling rate (Hz) of regular time stamps (n,), s, which must agree with the stated rate.

    Raises `RecordingError` for a value that is not a number, time that does not increase, lost rows, stamps that are
    not regular, or another rate.
    """
    span, steps = _checked(time, stated, where)
    if (steps <= 0).any():
        raise RecordingError(f"{where}: time: {_backwards(time, steps)}")
    if fault := _irregular(time, steps):
        raise RecordingError(f"{where}: time: {fault}")
    return _rate(time.size, span, stated, where)


def clock_of(
    time: np.ndarray, stated: float | None, resample_hz: float | None, fill_gaps_s: float, where: str
) -> Clock:
    """The clock of time stamps (n,), s, of the rows of a file.

    Parameters
    ----------
    stated
        Rate in Hz that the user states: stamps that are not regular, but have this rate on average, are not used.
    resample_hz
        Rate in Hz to which the recording is brought: stamps that are not regular are used to interpolate.
    fill_gaps_s
        Longest duration of lost rows, s, that may be interpolated; here they become missing values.

    Raises
    ------
    RecordingError
        One line that says how irregular the stamps are and what can be done, or that they are no time.
    """
    span, steps = _checked(time, stated, where)
    repeated = int(np.count_nonzero(steps == 0))
    if (steps < 0).any() or (stated is None and repeated > (0 if resample_hz is None else MOST_REPEATED * time.size)):
        raise RecordingError(f"{where}: time: {_backwards(time, steps)}")
    if stated is None and repeated:
        once, same = np.unique(time, return_inverse=True)
        clock = clock_of(once, stated, resample_hz, fill_gaps_s, where)
        remark = f"{repeated} rows repeat the time stamp of the row before, and are averaged with it"
        return replace(clock, same=same, remark=sentences(remark, clock.remark))
    fault = _irregular(time, steps)
    if fault is None:
        rate, fault = _rate(time.size, span, stated, where), _scatter(time)
        if fault is None or stated is not None:
            return Clock(rate)
        if resample_hz is None:
            return Clock(rate, remark=f"{fault}; taken as regular; to follow them, state resample_hz (--resample)")
    rows = _rows(time, steps)
    if rows is not None:
        lost = int(rows[-1]) + 1 - time.size
        longest = float(steps.max())
        place = float(time[int(steps.argmax())])
        period = span / int(rows[-1])
        if longest - period > fill_gaps_s * (1 + 1e-9):
            many = f"{lost} rows are lost" if lost > 1 else "1 row is lost"
            raise RecordingError(
                f"{where}: time: {many}: gap of {longest:g} s after t = {place:g} s; expected steps of {period:g} s; "
                f"to interpolate, state a longest gap (fill_gaps_s, --fill-gaps) of at least {longest - period:.3g} s"
            )
        remark = f"{lost} lost rows (longest gap {longest:.3g} s) are missing values"
        return Clock(_rate(int(rows[-1]) + 1, span, stated, where), rows=rows, remark=remark)
    if stated is not None:
        _rate(time.size, (time.size - 1) * _line(time, np.arange(time.size))[0], stated, where)
        return Clock(stated, remark=f"time stamps are not used, because a rate of {stated:g} Hz is stated: {fault}")
    if resample_hz is None:
        raise RecordingError(f"{where}: time: {fault}; {REMEDIES}")
    require_within(RATE_HZ, resample_hz, f"{where}: resample_hz")
    step = float(np.median(steps))
    if steps.max() > LONGEST_STEP * step and steps.max() > fill_gaps_s:
        k = int(steps.argmax())
        raise RecordingError(
            f"{where}: time: gap of {steps[k]:g} s after t = {time[k]:g} s in stamps that are not regular ({fault}); "
            f"to interpolate, state a longest gap (fill_gaps_s, --fill-gaps) of at least {steps[k]:.3g} s"
        )
    mean = _rate(time.size, span, None, where)
    rate = resample_hz * max(1, math.ceil(mean / resample_hz * (1 - SAME_RATE)))
    remark = f"values interpolated by their time stamps at {rate:g} Hz (cubic spline): {fault}"
    return Clock(rate, stamps=time - time[0], remark=remark)


def _checked(time: np.ndarray, stated: float | None, where: str) -> tuple[float, np.ndarray]:
    """Duration (s) and steps (n - 1,) of stamps that are numbers."""
    if not np.isfinite(time).all():
        row = int(np.flatnonzero(~np.isfinite(time))[0])
        raise RecordingError(f"{where}: time: not a number in row {row + 1}")
    if time.size < 10:
        raise RecordingError(f"{where}: time: expected at least 10 samples, got {time.size}")
    if np.abs(time).max() > LARGEST_NUMBER:
        raise RecordingError(f"{where}: time: expected at most {LARGEST_NUMBER:g} s, got {np.abs(time).max():g} s")
    require_within(RATE_HZ, stated, f"{where}: rate_hz")
    return float(time[-1] - time[0]), np.diff(time)


def _backwards(time: np.ndarray, steps: np.ndarray) -> str:
    row = int(np.flatnonzero(steps <= 0)[0])
    many = int(np.count_nonzero(steps == 0))
    remedy = (
        f"; {many} of {time.size} rows repeat the stamp before them: if stamps are rounded, state the rate (rate_hz, "
        "--rate); if a few rows were written twice, resample (resample_hz, --resample)"
        if steps[row] == 0
        else ""
    )
    return f"does not increase after t = {time[row]:g} s (row {row + 1}){remedy}"


def _irregular(time: np.ndarray, steps: np.ndarray) -> str | None:
    """How irregular the stamps are, in words; None where they are regular."""
    step = float(np.median(steps))
    drift = float(np.abs(time - np.linspace(time[0], time[-1], time.size)).max())
    if steps.max() <= UNIFORM * step and drift <= UNIFORM * step:
        return None
    k = int(steps.argmax())
    return (
        f"not uniform: gap of {steps[k]:g} s after t = {time[k]:g} s; expected steps of {step:g} s, their SD is "
        f"{steps.std():.2g} s, and stamps deviate by up to {drift:.2g} s from a constant rate"
    )


def _scatter(time: np.ndarray) -> str | None:
    """How much stamps that count as regular scatter, in words; None for little, and for what rounding explains."""
    period, away = _line(time, np.arange(time.size))
    sd = float(away.std())
    if sd <= SCATTER * period:
        return None
    digits = next((k for k in range(FINEST + 1) if np.abs(time - np.round(time, k)).max() < 1e-9), None)
    if digits is not None and np.abs(away).max() <= 10.0**-digits < period / 2:
        return None
    return f"time stamps scatter by {sd:.2g} s (SD) about a regular clock, {100 * sd / period:.0f} % of a period"


def _rows(time: np.ndarray, steps: np.ndarray) -> np.ndarray | None:
    """Numbers of the rows (n,) on a regular clock that lost some; None where that does not explain the steps.

    Stamps that only scatter stay within half a period of a regular clock without any loss.
    """
    count, step = np.arange(time.size), float(np.median(steps))
    if step <= 0 or time[-1] - time[0] > MOST_LOST * time.size * step or _within(time, count):
        return None
    rows = np.concatenate([[0], np.cumsum(np.rint(steps / step))]).astype(int)
    if (np.diff(rows) < 1).any():
        return None
    return rows if rows[-1] > count[-1] and _within(time, rows) else None


def _within(time: np.ndarray, rows: np.ndarray) -> bool:
    """Whether stamps are within half a period of a regular clock on which the rows have these numbers."""
    period, away = _line(time, rows)
    return bool(np.abs(away).max() <= period / 2)


def _line(time: np.ndarray, rows: np.ndarray) -> tuple[float, np.ndarray]:
    """Period (s) of the regular clock that is nearest to the stamps of rows with these numbers, and how far each is."""
    period, start = np.polyfit(rows, time - time[0], 1)
    return float(period), time - time[0] - start - period * rows


def _rate(samples: int, span: float, stated: float | None, where: str) -> float:
    if not RATE_HZ.low * span <= samples - 1 <= RATE_HZ.high * span:
        raise RecordingError(
            f"{where}: time: expected a rate from {RATE_HZ.low:g} to {RATE_HZ.high:g} Hz, "
            f"got {samples} samples in {span:g} s"
        )
    rate = (samples - 1) / span
    if stated is not None and abs(rate / stated - 1) > SAME_RATE:
        raise RecordingError(f"{where}: rate_hz: stated {stated:g} Hz, but the time column has {rate:.6g} Hz")
    return stated or (round(rate) if abs(rate / round(rate) - 1) < 1e-4 else rate)
