"""Checks of a recording: complete, uniform in time, in the stated units, periodic as stated.

Every check raises `RecordingError` naming the trial and the field. `mcstudy.lines.labels` in
addition compares the responses with those that a standing body can have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.faults import stimulus_faults
from mcstudy.recordings.formats.text import LARGEST_NUMBER
from mcstudy.recordings.recording import (
    MINIMUM_CYCLES,
    MOST_CYCLES,
    MOST_CYCLES_IN_ALL,
    Recording,
    Suspicion,
    Trial,
)
from mcstudy.recordings.soundness import faults_in_words
from mcstudy.stance.ranges import LARGEST_TILT

SMALLEST_SWAY = 1e-9
"""Smallest half range of an angle, rad; less means that it was not measured."""

SMALLEST_STIMULUS = {"N m": 1e-6, "m": 1e-9, "rad": 1e-9}
"""Smallest half range of a stimulus, per unit; less means that there was no stimulus."""

SMALLEST_OF_PERSON = float(np.deg2rad(0.05))
"""The same where a person is known to have stood: nobody is so quiet for whole cycles."""

SLOW_HZ = 0.3
"""Up to here sway follows the tilt, rather than answering late."""

COHERENT = 0.5
"""Share of slow sway that the stimulus explains, from which on its size and direction are judged."""

LARGEST_ANSWER = 15.0
"""Largest sway relative to the tilt."""

LARGEST_SWAY = 1.0
"""Largest half range of an angle, rad (57 deg)."""

LARGEST_STIMULUS = {"N m": 300.0, "m": 1.0, "rad": LARGEST_TILT}
"""Largest half range of a stimulus, per unit; more means that the stated unit is wrong."""

PERIODIC = 0.05
"""Largest RMS difference between periods, relative to the RMS stimulus, of a periodic stimulus."""

AMPLITUDE = 0.10
"""Largest accepted relative difference between stated and measured amplitude; nominal values are rounded."""

CLOCK_SHARE = 0.05
"""Largest relative difference of two clocks that is looked for."""

CLOCK_S = 0.1
"""Least delay that a wrong clock adds in every cycle, s. In sound recordings it is below 0.03 s, and at most 0.04 s in
each of 280 trials tested alone."""

CLOCK_ALIKE = 0.4
"""Least mean correlation of the cycles, the delays removed, that tells of a clock."""

CLOCK_GAIN = 0.015
"""Least increase of that correlation by removing the delays."""

CLOCK_NARROW = 5
"""Half-width, in harmonics, of the narrow band that must not be the only evidence of a wrong clock."""

CLOCK_HARMONIC = 3
"""Lowest harmonic of the period that is compared; slow drift dominates those below."""


def check(recording: Recording) -> tuple[Suspicion, ...]:
    """Raise `RecordingError` for a recording that cannot be analysed; return data quality warnings."""
    suspicions: list[Suspicion] = []
    if (cycles := sum(recording.cycles)) > MOST_CYCLES_IN_ALL:
        raise RecordingError(f"{recording.name}: trials: expected at most {MOST_CYCLES_IN_ALL} cycles, got {cycles}")
    for k, trial in enumerate(recording.trials, start=1):
        where = f"{recording.name}: trial {k}"
        for name, values in _channels(recording, trial):
            _numbers(values, recording.rate_hz, f"{where}: {name}")
        for name, values in _channels(recording, trial):
            if np.ptp(values) == 0:
                raise RecordingError(f"{where}: {name}: constant ({values[0] + 0.0:g}) over the whole trial")
        for (first, x), (second, y) in combinations(_channels(recording, trial)[1:], 2):
            if np.array_equal(x, y):
                raise RecordingError(f"{where}: {second}: identical to {first}")
        person = "mgh" in recording.constants
        if recording.model is None or person:  # what another declared model may do is not known
            _ranges(recording, trial, SMALLEST_OF_PERSON if person else SMALLEST_SWAY, where)
        if person:
            suspicions += _answer(recording, trial, where)
        suspicions += faults_in_words(recording, trial, where)
        _periodic(recording, trial, where)
        suspicions += _amplitude(recording, trial, where)
    _clock(recording)
    return tuple(suspicions)


def _channels(recording: Recording, trial: Trial) -> tuple[tuple[str, np.ndarray], ...]:
    return ("stimulus", trial.stimulus), *zip(recording.columns.outputs, trial.theta.T, strict=True)


def _numbers(values: np.ndarray, rate: float, where: str) -> None:
    if values.size < 10:
        raise RecordingError(f"{where}: expected at least 10 samples, got {values.size}")
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise RecordingError(
            f"{where}: {bad.size} of {values.size} values are not numbers, the first at t = {bad[0] / rate:g} s; short "
            "gaps are interpolated where that is stated (fill_gaps_s, --fill-gaps)"
        )
    largest = float(np.abs(values).max())
    if largest > LARGEST_NUMBER:
        raise RecordingError(f"{where}: expected numbers up to {LARGEST_NUMBER:g}, got {largest:g}")


def _ranges(recording: Recording, trial: Trial, smallest: float, where: str) -> None:
    for (name, values), sway_unit in zip(_channels(recording, trial)[1:], recording.columns.units, strict=True):
        if sway_unit != "rad":
            continue
        half = np.ptp(values) / 2
        if half > LARGEST_SWAY:
            raise RecordingError(
                f"{where}: {name}: sways ±{half:.3g} rad (±{np.rad2deg(half):.3g} deg), which no standing person does; "
                "are the values in deg or mrad but declared rad?"
            )
        if half < smallest:
            raise RecordingError(
                f"{where}: {name}: sways ±{half:.3g} rad; expected at least {smallest:.2g} rad; is the unit right?"
            )
    unit, peak = recording.stimulus_unit, trial.peak
    if unit in LARGEST_STIMULUS and not SMALLEST_STIMULUS[unit] <= peak <= LARGEST_STIMULUS[unit]:
        large = peak > LARGEST_STIMULUS[unit]
        limit = f"less than {LARGEST_STIMULUS[unit]:g}" if large else f"at least {SMALLEST_STIMULUS[unit]:g}"
        raise RecordingError(
            f"{where}: stimulus: reaches ±{peak:.3g} {unit}; expected {limit} for {recording.stimulus}; "
            "is the unit right?"
        )


def _answer(recording: Recording, trial: Trial, where: str) -> list[Suspicion]:
    """Compare the sway of a person with the tilt that evokes it: how many times as large, and in which direction.

    Refuses an answer that is larger than any, and one that is the stimulus itself; tells of one against it.
    """
    period, units = recording.period, (recording.stimulus_unit, recording.columns.units[0])
    if period is None or units != ("rad", "rad") or trial.samples < 2 * period:
        return []
    signals = [
        x[period : trial.samples // period * period].reshape(-1, period) for x in (trial.stimulus, trial.theta[:, 0])
    ]
    lines = slice(1, max(3, round(SLOW_HZ * (recording.period_s or 0)) + 1))
    u, y = (np.fft.rfft(x - x.mean(axis=1, keepdims=True), axis=1)[:, lines] for x in signals)
    cross, power = (y * u.conj()).sum(), (np.abs(u) ** 2).sum()
    gain, name = abs(cross) / max(float(power), 1e-300), recording.columns.outputs[0]
    if np.abs(signals[1] - gain * signals[0]).std() < 1e-6 * signals[1].std():
        raise RecordingError(f"{where}: {name}: is the stimulus itself, times {gain:.4g}; is it the right column?")
    coherent = abs(cross) ** 2 / max(float(power * (np.abs(y) ** 2).sum()), 1e-300)
    if coherent > COHERENT and gain > LARGEST_ANSWER:
        raise RecordingError(
            f"{where}: {name}: answers the tilt {gain:.3g} times as large; expected less than {LARGEST_ANSWER:g}; are "
            "both in the unit that is stated (deg, rad)?"
        )
    if coherent > COHERENT and cross.real < -0.5 * abs(cross):
        against = f"{where}: {name}: moves against the tilt below {SLOW_HZ:g} Hz; if its sign is wrong: scale = -1"
        return [Suspicion("sign", name, against)]
    return []


def _periodic(recording: Recording, trial: Trial, where: str) -> None:
    period = recording.period
    if period is None or recording.period_s is None:
        return
    cycles = trial.samples / period
    if cycles < MINIMUM_CYCLES:
        raise RecordingError(
            f"{where}: period_s: expected at least {MINIMUM_CYCLES} cycles of {recording.period_s:g} s, "
            f"got {cycles:.2f}"
        )
    if cycles > MOST_CYCLES:
        raise RecordingError(
            f"{where}: period_s: expected at most {MOST_CYCLES} cycles of {recording.period_s:g} s, got {cycles:.0f}; "
            "leave period_s out, or cut the trial"
        )
    u = _sound(trial.stimulus, period, recording.rate_hz)
    u = u - u.mean()
    difference = change(u, period)
    if difference > PERIODIC:
        repeats = _true_period(trial.stimulus - trial.stimulus.mean())
        hint = (
            f"it repeats every {repeats / recording.rate_hz:g} s" if repeats else "no period found; leave period_s out"
        )
        raise RecordingError(
            f"{where}: period_s: the stimulus does not repeat every {recording.period_s:g} s "
            f"(periods differ by {100 * difference:.0f} %); {hint}"
        )
    for divisor in range(2, 9):
        part = period // divisor
        if part * divisor == period and change(u, part) < 0.01:
            raise RecordingError(
                f"{where}: period_s: {recording.period_s:g} s contains {divisor} periods of the stimulus; "
                f"expected {recording.period_s / divisor:g} s"
            )


def change(u: np.ndarray, lag: int) -> float:
    """RMS difference of a stimulus (n,), zero in the mean, and itself so many samples later, relative to its RMS.

    Divided by the root of two: of noise that differs each time, the RMS of the noise.
    """
    return float(np.sqrt(np.mean((u[lag:] - u[:-lag]) ** 2) / 2) / np.sqrt(np.mean(u**2)))


def _sound(u: np.ndarray, period: int, rate_hz: float) -> np.ndarray:
    """The whole cycles of a stimulus (n,), without those that hold a fault."""
    bad = {c for f in stimulus_faults(u, period, rate_hz) for c in range(f.start // period, (f.stop - 1) // period + 1)}
    n = u.size // period
    return u[: n * period].reshape(n, period)[[c for c in range(n) if c not in bad]].ravel()


def _clock(recording: Recording) -> None:
    """Refuse angles that answer later, or earlier, in every further cycle: their clock is not that of the stimulus.

    One delay per cycle is common to all trials. It maximises the mean correlation between all pairs of cycles of both
    angles, so a single disturbed cycle does not decide. A wrong clock delays all frequencies, an almost undamped mode
    only turns the phase of its own. So the delay must remain without the frequencies that differ most. Every trial is
    also tested alone, because trials with a right clock hide a single one with a wrong clock. Derived.
    """
    period = recording.period
    if period is None or max(recording.cycles) < 3:
        return
    angles = [trial.theta for trial in recording.trials]
    seen = [_alike(theta, period) for theta in angles]
    alone = [k for k in range(len(angles)) if _wrong_delay(angles[k : k + 1], seen[k : k + 1], recording.rate_hz)]
    tested = alone or range(len(angles))
    samples = _wrong_delay([angles[k] for k in tested], [seen[k] for k in tested], recording.rate_hz)
    if samples == 0:
        return
    trials = ", ".join(str(k + 1) for k in alone)
    some = 0 < len(alone) < len(angles)
    names = recording.columns.names
    where = f"trial{'s' * (len(alone) > 1)} {trials}: {names}" if some else names
    shift, clock = ("later", "faster") if samples > 0 else ("earlier", "slower")
    raise RecordingError(
        f"{recording.name}: {where}: answer {abs(samples) / recording.rate_hz:.2g} s {shift} in every cycle than in "
        f"the one before; their clock is {100 * abs(samples) / period:.2g} % {clock} than that of the stimulus"
    )


def _wrong_delay(angles: Sequence[np.ndarray], seen: Sequence[_Alike], rate_hz: float) -> int:
    """Delay per cycle, in samples, that a wrong clock adds to angles (n, 2) per trial; 0 where the clock is right.

    ``seen``: how alike the cycles of every trial are.
    """
    samples, alike, gain = _common_delay(seen)
    if abs(samples) / rate_hz < CLOCK_S or alike < CLOCK_ALIKE or gain < CLOCK_GAIN:
        return 0
    period = seen[0].period
    without = _strongest(angles, period)
    left, _, gain = _common_delay([_alike(theta, period, without) for theta in angles])
    return 0 if abs(left - samples) > abs(samples) / 4 or gain < CLOCK_GAIN else samples


def _strongest(angles: Sequence[np.ndarray], period: int) -> slice:
    """Harmonics of the narrow band around the one at which cycles differ most, as a share of all their differences."""
    power = np.zeros((period // 2 + 1, angles[0].shape[1]))
    for theta in angles:
        cycles = theta[period : theta.shape[0] // period * period].reshape(-1, period, theta.shape[1])
        power += (np.abs(np.fft.rfft(np.diff(cycles, axis=0), axis=1)) ** 2).sum(axis=0)
    power[:CLOCK_HARMONIC] = 0.0
    centre = int((power / np.maximum(power.sum(axis=0), 1e-300)).max(axis=1).argmax())
    return slice(max(centre - CLOCK_NARROW, 0), centre + CLOCK_NARROW + 1)


@dataclass(frozen=True, eq=False)
class _Alike:
    """Correlations of all pairs of cycles of a trial, summed, (2 R + 1,) for delays of -R to R samples per cycle.

    ``pairs``: their number. ``period``: of the stimulus, in samples.
    """

    total: np.ndarray
    pairs: int
    period: int


def _alike(theta: np.ndarray, period: int, without: slice | None = None) -> _Alike:
    """How alike the cycles of angles (n, 2) are.

    The first cycle and the harmonics ``without`` are left out. Then cycles are tapered, because what rings at one
    frequency leaks from the ends of a cycle into all others.
    """
    taper = 1.0 if without is None else np.hanning(period)[:, None]
    reach = max(1, round(CLOCK_SHARE * period))
    lags = np.arange(-reach, reach + 1)
    cycles = theta[: theta.shape[0] // period * period].reshape(-1, period, theta.shape[1])[1:]
    n = len(cycles)
    spectra = np.fft.rfft(cycles * taper, axis=1)
    spectra[:, :CLOCK_HARMONIC] = 0.0
    if without is not None:
        spectra[:, without] = 0.0
    power = 2 * (np.abs(spectra) ** 2).sum(axis=(0, 1)) / max(n, 1)
    spectra = spectra / np.sqrt(np.maximum(power, 1e-300))
    total = np.zeros(lags.size)
    for apart in range(1, n):
        cross = (spectra[apart:] * spectra[: n - apart].conj()).sum(axis=(0, 2))
        total += period / 2 * np.fft.irfft(cross, period)[lags * apart % period]
    return _Alike(total, n * (n - 1) // 2, period)


def _common_delay(trials: Sequence[_Alike]) -> tuple[int, float, float]:
    """Delay per cycle, in samples, that makes the cycles of all trials most alike.

    Also the mean correlation of the cycles when it is removed, and how much that increases it.
    """
    total, pairs = np.sum([t.total for t in trials], axis=0), sum(t.pairs for t in trials)
    reach = total.size // 2
    alike = total / max(pairs, 1)
    best = int(np.argmax(alike)) if pairs else reach
    return best - reach, float(alike[best]), float(alike[best] - alike[reach])


def repeats_every(stimulus: np.ndarray, rate_hz: float) -> float | None:
    """Period of a stimulus (n,), s, which it has at least twice, or None."""
    u = stimulus - stimulus.mean()
    lag = _true_period(u)
    return None if lag is None or 2 * lag > u.size else lag / rate_hz


def _true_period(u: np.ndarray) -> int | None:
    """Lag in samples at which a zero-mean stimulus repeats, or None."""
    n = u.size
    spectrum = np.fft.rfft(u, 2 * n)
    lags = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    energy = np.cumsum(u**2)
    overlap = np.sqrt(np.maximum(energy[::-1] * (energy[-1] - np.concatenate([[0.0], energy[:-1]])), 1e-300))
    agreement = (lags / overlap)[: int(n * 0.75)]
    below = np.flatnonzero(agreement < 0.5)
    if below.size == 0:
        return None
    candidates = np.flatnonzero(agreement[below[0] :] > 0.995) + below[0]
    if candidates.size == 0:
        return None
    first = candidates[0]
    near = candidates[candidates < first + max(2, first // 50)]
    return int(near[np.argmax(agreement[near])])


def _amplitude(recording: Recording, trial: Trial, where: str) -> list[Suspicion]:
    """Compare the stated amplitude with the waveform under both conventions, peak and peak to peak."""
    stated = trial.amplitude
    if stated is None:
        return []
    unit = recording.stimulus_unit
    u = trial.stimulus - np.median(trial.stimulus)
    peaks = {"peak": (float(np.abs(u).max()), trial.peak), "peak_to_peak": (2 * trial.peak,)}

    def fits(convention: str) -> bool:
        return any(abs(p / stated - 1) < AMPLITUDE for p in peaks[convention])

    if fits(recording.convention):
        return []
    other = "peak" if recording.convention == "peak_to_peak" else "peak_to_peak"
    waveform = f"the waveform has a peak of {trial.peak:.4g} {unit} (peak to peak {2 * trial.peak:.4g})"
    if fits(other):
        raise RecordingError(
            f"{where}: amplitude: {stated:g} {unit} is stated as {recording.convention}, but {waveform}; "
            f"the convention is {other}"
        )
    message = f"{where}: amplitude: {stated:g} {unit} is stated as {recording.convention}, but {waveform}"
    return [Suspicion("amplitude", "stimulus", message)]
