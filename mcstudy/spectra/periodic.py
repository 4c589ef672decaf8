"""Lines of a recording with a periodic stimulus: one FRF per cycle, their mean, and the covariance of that mean.

Leakage is removed from every cycle (`mcstudy.spectra.leakage`, and `mcstudy.spectra.transient` if only odd lines are
excited). The FRF of a line is sum U* Theta / sum |U|^2 over all cycles of all trials. The noise covariance comes from
even lines when only odd lines are excited, otherwise from the differences between cycles.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.recording import LEAST_CYCLES, LEAST_LINES, MINIMUM_CYCLES, Recording
from mcstudy.spectra.cycle_noise import CycleNoise, Cycles, DifferenceNoise, EvenLineNoise
from mcstudy.spectra.intersample import drive
from mcstudy.spectra.leakage import best_orders, difference_coefficients
from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.lines import EvenLines, Lines
from mcstudy.spectra.periods import coefficients

NOISE_ESTIMATORS: tuple[type[CycleNoise], ...] = (EvenLineNoise, DifferenceNoise)
"""Estimators of the noise of a cycle; the first that suits a recording is used."""

NEIGHBOURS = 3
"""Number of lines on either side with whose strongest one the excitation of a line is compared."""

EXCITED = 0.05
"""Share of the strongest neighbour above which a line counts as excited; stimuli may decrease as 1/k^2."""

SINGULAR = -1e3
"""Smallest log determinant of a covariance; that of rounding errors is -150."""

SILENT = 0.02
"""Root-mean-square excitation of the even lines, relative to the odd ones, below which they count as silent."""


def cycle_coefficients(recording: Recording, fmax: float, discard: int) -> Cycles:
    """Coefficients of the cycles after the first ``discard`` of each trial, up to well above ``fmax`` (Hz), all orders.

    Not those that are left out because a signal is unsound, and no trial of which fewer than two cycles remain.

    Those of the stimulus include its shape between samples (`mcstudy.spectra.intersample`).

    Raises `RecordingError` when a trial has too few cycles or its sampling does not reach ``fmax``.
    """
    period = recording.period
    if period is None or recording.period_s is None:
        raise RecordingError(f"{recording.name}: period_s: expected the period of the stimulus, s")
    if discard < 1:
        raise RecordingError(f"{recording.name}: discard: expected at least one cycle, got {discard}")
    if fmax > recording.rate_hz / 2.2:
        raise RecordingError(
            f"{recording.name}: rate_hz: {recording.rate_hz:g} Hz does not reach lines up to {fmax:g} Hz"
        )
    if fmax * recording.period_s + 0.5 < LEAST_LINES:
        raise _too_few_lines(recording.name, fmax)
    top = min(period // 2, int(fmax * recording.period_s) + 60) + 1
    u, y, where = [], [], []
    analysed = recording.analysed(discard)
    for t, (trial, cycles) in enumerate(zip(recording.trials, recording.cycles, strict=True)):
        least = max(MINIMUM_CYCLES, discard + 2)
        if cycles < least:
            raise RecordingError(
                f"{recording.name}: trial {t + 1}: expected at least {least} cycles of "
                f"{recording.period_s:g} s, got {trial.samples / period:.2f}"
            )
        for c in analysed[t] if len(analysed[t]) >= LEAST_CYCLES else ():
            start = c * period
            u.append(coefficients(trial.stimulus[start : start + period])[:top])
            y.append(difference_coefficients(trial.theta, start, period, top))
            where.append((t, c))
    if not where:
        raise RecordingError(
            f"{recording.name}: trials: no trial has {LEAST_CYCLES} sound cycles after the first {discard}"
        )
    trial_index, cycle_index = np.array(where).T
    felt = drive(recording, np.arange(top) / recording.period_s)
    return Cycles(np.array(u) * felt, np.stack(y, axis=1), trial_index, cycle_index, recording.amplitudes[trial_index])


def polarity(stimulus: np.ndarray) -> np.ndarray:
    """Signs (R,): -1 for a cycle whose stimulus is that of the first one reversed, coefficients (R, K); else 1.

    A protocol may reverse the stimulus between trials, so that nobody can learn it.
    """
    waves = stimulus[:, 1:]
    size = np.linalg.norm(waves, axis=1)
    return np.where((waves @ waves[0].conj()).real < -size * size[0] / 2, -1.0, 1.0)


def excited_lines(stimulus: np.ndarray) -> np.ndarray:
    """Harmonics that a stimulus with coefficients (R, K) excites, ascending; harmonic 0 never is."""
    magnitude = np.sqrt(np.mean(np.abs(stimulus) ** 2, axis=0))
    magnitude[0] = 0.0
    strongest = np.lib.stride_tricks.sliding_window_view(np.pad(magnitude, NEIGHBOURS), 2 * NEIGHBOURS + 1).max(axis=1)
    mean = (polarity(stimulus)[:, None] * stimulus).mean(axis=0)
    repeats = np.abs(mean) > magnitude / 2  # a recorded stimulus contains noise
    return np.flatnonzero((magnitude >= EXCITED * strongest) & (magnitude > 1e-5 * magnitude.max()) & repeats)


def only_odd(stimulus: np.ndarray, lines: np.ndarray) -> bool:
    """Whether all excited ``lines`` are odd and the even lines between them are silent, coefficients (R, K)."""
    if lines.size == 0 or (lines % 2 == 0).any():
        return False
    magnitude = np.sqrt(np.mean(np.abs(stimulus) ** 2, axis=0))
    even = np.arange(2, lines[-1], 2)
    odd = (magnitude[even - 1] + magnitude[even + 1]) / 2
    return bool(np.sqrt(np.mean((magnitude[even] / np.maximum(odd, 1e-300)) ** 2)) < SILENT)


def periodic_lines(recording: Recording, fmax: float = 8.0, discard: int = 1) -> Lines:
    """Lines of a periodic recording.

    Parameters
    ----------
    fmax: highest frequency, Hz.
    discard: cycles with the transient at the start of every trial.

    Raises `RecordingError` for too few cycles or when no line below ``fmax`` is excited.
    """
    cycles = cycle_coefficients(recording, fmax, discard)
    period_s = float(recording.period_s or 0.0)
    excited = excited_lines(cycles.stimulus)
    wanted = excited[excited <= fmax * period_s + 0.5]
    if wanted.size < LEAST_LINES:
        raise _too_few_lines(recording.name, fmax)
    odd = only_odd(cycles.stimulus, excited)
    # The noise has no gaps where the stimulus has them, and does not end with it.
    at = np.arange(1, int(fmax * period_s + 0.5) + 1, 2 if odd else 1)
    estimator = next(kind for kind in NOISE_ESTIMATORS if kind.suits(odd))
    noise = estimator(recording.name, cycles, at)
    cycles, single, dof = _without_leakage(cycles, at, noise)
    chosen = np.isin(at, wanted)
    u = cycles.stimulus[:, wanted]
    power = np.abs(u) ** 2
    total = power.sum(axis=0)
    repeats = cycles.theta[:, wanted] / u[..., None]
    weight = power / total
    return Lines(
        f=wanted / period_s,
        y=np.einsum("rn,rnj->nj", weight, repeats),
        noise=LineNoise(single[chosen] / total[:, None, None], dof[chosen], noise.pooling.at_lines(chosen)),
        repeats=repeats,
        weight=weight,
        trial=cycles.trial,
        cycle=cycles.cycle,
        amplitude=cycles.amplitude,
        power=power.mean(axis=0),
        even=_even_lines(cycles, period_s, wanted, single[chosen]) if odd else None,
        harmonic=wanted,
        notes=_left_out(recording, discard),
    )


def _left_out(recording: Recording, discard: int) -> tuple[str, ...]:
    """Which cycles are left out because a signal is unsound in them, counted from 1."""
    told = []
    for k, (trial, n, rest) in enumerate(
        zip(recording.trials, recording.cycles, recording.analysed(discard), strict=True), start=1
    ):
        bad = [c + 1 for c in trial.left_out if c >= discard]
        if not bad:
            continue
        if len(rest) < LEAST_CYCLES:
            told.append(f"trial {k} as a whole")
        else:
            told.append(f"cycle{'s' * (len(bad) > 1)} {', '.join(map(str, bad))} of {n} of trial {k}")
    return (f"left out because a signal is unsound: {'; '.join(told)}",) if told else ()


def _without_leakage(cycles: Cycles, at: np.ndarray, noise: CycleNoise) -> tuple[Cycles, np.ndarray, np.ndarray]:
    """The cycles with the best order of difference around each of the lines ``at``, their noise and its dof."""
    candidates = [noise.freed(replace(cycles, theta=theta)) for theta in cycles.theta]
    cost = np.array([np.linalg.slogdet(noise(c)[0])[1] for c in candidates])
    # Without noise a covariance is singular and its cost -inf, which would dominate every sum over lines.
    cost = np.maximum(cost, SINGULAR)
    path = best_orders(cost, at)
    order = path[np.abs(np.arange(cycles.stimulus.shape[1])[:, None] - at).argmin(axis=1)]
    theta = np.array([c.theta for c in candidates])
    cycles = replace(cycles, theta=np.take_along_axis(theta, order[None, None, :, None], axis=0)[0])
    return cycles, *noise(cycles)


def _too_few_lines(name: str, fmax: float) -> RecordingError:
    return RecordingError(f"{name}: stimulus: fewer than {LEAST_LINES} lines below {fmax:g} Hz are excited")


def _even_lines(cycles: Cycles, period_s: float, wanted: np.ndarray, single: np.ndarray) -> EvenLines:
    even = np.arange(2, wanted[-1], 2)
    theta = cycles.theta[:, even]
    n = theta.shape[0]
    mean = theta.mean(axis=0)
    variance = (np.abs(theta - mean) ** 2).sum(axis=0) / (n * (n - 1))
    level = np.einsum("nii->ni", single).real / n
    level = np.stack([np.interp(np.log(even), np.log(wanted), np.log(c)) for c in level.T], axis=1)
    return EvenLines(even / period_s, mean, variance, np.exp(level), n)
