"""Lines of a recording with a periodic stimulus: one FRF per cycle, their mean, and the covariance of that mean.

Leakage is removed from every cycle (`mcstudy.spectra.leakage`, and `mcstudy.spectra.transient` if only odd lines are
excited). The FRF of a line is sum U* Theta / sum |U|^2 over all cycles of all trials. The noise covariance comes from
even lines when only odd lines are excited, otherwise from the differences between cycles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mcstudy.errors import InputError, RecordingError
from mcstudy.recordings.recording import LEAST_CYCLES, LEAST_LINES, MINIMUM_CYCLES, Recording
from mcstudy.spectra.even_lines import EvenLineCovariance, half_width
from mcstudy.spectra.intersample import drive
from mcstudy.spectra.leakage import best_orders, difference_coefficients
from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.lines import EvenLines, Lines
from mcstudy.spectra.null_draws import Pooling, pooled
from mcstudy.spectra.periods import coefficients
from mcstudy.spectra.transient import TransientMean

NEIGHBOURS = 3
"""Number of lines on either side with whose strongest one the excitation of a line is compared."""

EXCITED = 0.05
"""Share of the strongest neighbour above which a line counts as excited; stimuli may decrease as 1/k^2."""

SINGULAR = -1e3
"""Smallest log determinant of a covariance; that of rounding errors is -150."""

SILENT = 0.02
"""Root-mean-square excitation of the even lines, relative to the odd ones, below which they count as silent."""


@dataclass(frozen=True)
class Cycles:
    """Fourier coefficients of every analysed cycle, R of them, at harmonics 0 ... K - 1.

    Attributes: stimulus (R, K); theta (R, K, 2), or (orders, R, K, 2) until an order of `leakage` is chosen;
    trial, cycle, amplitude: (R,).
    """

    stimulus: np.ndarray
    theta: np.ndarray
    trial: np.ndarray
    cycle: np.ndarray
    amplitude: np.ndarray


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
    noise = (_EvenLineNoise if odd else _DifferenceNoise)(recording.name, cycles, at)
    cycles, single, dof = _without_leakage(cycles, at, noise)
    own = np.isin(at, wanted)
    u = cycles.stimulus[:, wanted]
    power = np.abs(u) ** 2
    total = power.sum(axis=0)
    repeats = cycles.theta[:, wanted] / u[..., None]
    weight = power / total
    return Lines(
        f=wanted / period_s,
        y=np.einsum("rn,rnj->nj", weight, repeats),
        noise=LineNoise(single[own] / total[:, None, None], dof[own], noise.pooling.at_lines(own)),
        repeats=repeats,
        weight=weight,
        trial=cycles.trial,
        cycle=cycles.cycle,
        amplitude=cycles.amplitude,
        power=power.mean(axis=0),
        even=_even_lines(cycles, period_s, wanted, single[own]) if odd else None,
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


def understatement(harmonics: np.ndarray, trials: int) -> np.ndarray:
    """Mean ratio of true to estimated covariance from even lines, at odd ``harmonics`` (N,).

    Measured in several hundred simulated recordings of 3, 6 and 20 cycles and three colours of noise. The prewhitening
    is fitted to the lines that it whitens, which removes 4 % of the noise of one trial. At the lowest lines all
    neighbours are on one side, which removes up to another 25 %.
    """
    return np.asarray((1 + 0.04 / trials) * (1 + 0.25 * np.exp(-(((harmonics - 1) / 5.0) ** 2))))


class _EvenLineNoise:
    """Noise of the coefficients of one cycle at the odd lines ``at``, for a stimulus that does not excite even ones."""

    def __init__(self, name: str, cycles: Cycles, at: np.ndarray) -> None:
        trials = np.unique(cycles.trial).size
        colour = (trials, cycles.trial.size - trials)
        self._estimator = _estimator(name, at, cycles.stimulus.shape[1] - 1, colour)
        self._transient = TransientMean(self._estimator)
        understated = self._transient.understatement(at) * understatement(at, trials)
        self._understated = understated[:, None, None]
        self.pooling = Pooling(at.astype(float), half_width(at) + 1.0, colour_records=colour[1])

    def freed(self, cycles: Cycles) -> Cycles:
        """The cycles without the transient that taking differences leaves."""
        return replace(cycles, theta=self._transient.removed_from(cycles.theta, _scaled_means(cycles)))

    def __call__(self, cycles: Cycles) -> tuple[np.ndarray, np.ndarray]:
        """Unbiased covariance (N, 2, 2) of one cycle, and its degrees of freedom."""
        means = _scaled_means(cycles)
        covariance = self._understated * self._estimator(means, _differences(cycles))
        return covariance * len(means), self._estimator.dof * len(means)


class _DifferenceNoise:
    """The same at any lines ``at`` from differences between cycles, for a stimulus that excites even lines, too.

    Line k of the differences serves as even harmonic 2k of the estimators, which estimate at 2k - 1 and 2k + 1.
    """

    def __init__(self, name: str, cycles: Cycles, at: np.ndarray) -> None:
        highest = 2 * cycles.stimulus.shape[1] - 1
        self._below, self._above = (_estimator(name, line, highest) for line in (2 * at - 1, 2 * at + 1))
        trials = np.unique(cycles.trial).size
        self.pooling = pooled(self._below.dof * (cycles.trial.size - trials), trials)

    def freed(self, cycles: Cycles) -> Cycles:
        """The cycles unchanged, because the transient cannot be estimated without unexcited lines."""
        return cycles

    def __call__(self, cycles: Cycles) -> tuple[np.ndarray, np.ndarray]:
        """Unbiased covariance (N, 2, 2) of one cycle, and its degrees of freedom."""
        noise = _differences(cycles)
        stretched = np.zeros((len(noise), 2 * noise.shape[1], 2), dtype=complex)
        stretched[:, ::2] = noise
        covariance = (self._below(stretched) + self._above(stretched)) / 2
        return covariance * len(noise), self._below.dof * len(noise)


def _without_leakage(
    cycles: Cycles, at: np.ndarray, noise: _EvenLineNoise | _DifferenceNoise
) -> tuple[Cycles, np.ndarray, np.ndarray]:
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


def _scaled_means(cycles: Cycles) -> np.ndarray:
    """Mean cycle of every trial, (T, K, 2), scaled to the variance of one cycle.

    Its noise then includes the correlation between consecutive cycles, and trials of unequal length can be pooled.
    """
    scaled = []
    for t in np.unique(cycles.trial):
        own = cycles.theta[cycles.trial == t]
        scaled.append(own.mean(axis=0) * np.sqrt(own.shape[0]))
    return np.array(scaled)


def _differences(cycles: Cycles) -> np.ndarray:
    """Orthonormal differences between the cycles of each trial, (D, K, 2), of the variance of one cycle."""
    out: list[np.ndarray] = []
    for t in np.unique(cycles.trial):
        own = cycles.theta[cycles.trial == t]
        n = own.shape[0]
        basis = np.linalg.qr(np.eye(n) - np.full((n, n), 1.0 / n))[0][:, : n - 1]
        out.extend(np.einsum("rd,rkj->dkj", basis, own))
    return np.array(out)


def _estimator(
    name: str, wanted: np.ndarray, highest: int, any_colour: tuple[int, int] | None = None
) -> EvenLineCovariance:
    try:
        return EvenLineCovariance(wanted, highest, any_colour)
    except InputError as error:
        raise RecordingError(f"{name}: {error}") from error


def _even_lines(cycles: Cycles, period_s: float, wanted: np.ndarray, single: np.ndarray) -> EvenLines:
    even = np.arange(2, wanted[-1], 2)
    theta = cycles.theta[:, even]
    n = theta.shape[0]
    mean = theta.mean(axis=0)
    variance = (np.abs(theta - mean) ** 2).sum(axis=0) / (n * (n - 1))
    level = np.einsum("nii->ni", single).real / n
    level = np.stack([np.interp(np.log(even), np.log(wanted), np.log(c)) for c in level.T], axis=1)
    return EvenLines(even / period_s, mean, variance, np.exp(level), n)
