"""Cycles that scatter more than the pooled noise covariance allows: at single lines, or in single trials.

The covariance of a line comes from its neighbours (`mcstudy.spectra.even_lines`). An almost undamped mode breaks the
assumption behind this: its noise is confined to one or two lines, and what is left of the start of the recording rings
at its frequency with another phase in every cycle. In both cases the cycles differ at that line by more than its
neighbours say. `with_scatter` finds such lines and enlarges their covariance. Leakage at the ends of cycles also makes
cycles differ, but it cancels in their mean and is equal over many lines, so each line is compared with the median of
those around it. `pipelines/gap_challenge.md` states false alarms near the limit of stability.

The covariance of a periodic recording is the mean of that of its trials, and the mean response weights a trial by the
square of its amplitude; so with trials of unequal noise and unequal weights the pooled covariance is not that of the
mean. `with_unequal_trials` measures the power of every trial by the differences between its cycles and corrects the
covariance and its degrees of freedom. Noise that changes within a trial needs no correction, because the even lines are
those of the mean over all its cycles. Derived.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from mcstudy.spectra.lines import Lines
from mcstudy.spectra.window import neighbourhood

LOWEST = 5
"""Lowest harmonic that is judged; cycles are not quite independent below (`mcstudy.gap.questions.contrasts`)."""

NEIGHBOURS = 51
"""Number of lines whose median scatter a line is compared with, and over which the power of a trial is averaged."""

SHARP = 1e-5
"""p-value of a line from which it is widened. It is approximate, because the covariance is an estimate too."""

UNEQUAL = 1.5
"""Ratio of the largest to the smallest power of a trial from which the covariance is corrected."""

LEAST_RATIO = 2.5
"""Least scatter of such a line, relative to the lines around it."""


@dataclass(frozen=True)
class Scatter:
    """Scatter of the cycles at N lines.

    Attributes
    ----------
    ratio: (N,) mean square of the differences between cycles, relative to the covariance and to the median of the lines
        around; 1 where it is not judged.
    p: (N,) its p-value, 1 where it is not judged.
    """

    ratio: np.ndarray
    p: np.ndarray

    @property
    def sharp(self) -> np.ndarray:
        """(N,) whether the covariance of a line is too small."""
        return (self.p < SHARP) & (self.ratio >= LEAST_RATIO)


def deviations(lines: Lines) -> np.ndarray:
    """Whitened differences (R, N, Y) of the repeats from the mean of their trial.

    Their sum of squares over repeats and outputs is 2 Y times the number of repeats less that of trials, per line.
    """
    out = np.empty_like(lines.repeats)
    for t in np.unique(lines.trial):
        repeats = lines.trial == t
        share = lines.weight[repeats] / lines.weight[repeats].sum(axis=0)
        out[repeats] = lines.repeats[repeats] - np.einsum("rn,rnj->nj", share, lines.repeats[repeats])
    return np.einsum("nij,rnj,rn->rni", lines.noise.whitener, out, np.sqrt(lines.weight), optimize=True)


def scatter(lines: Lines) -> Scatter:
    """Scatter of the repeats at every line; nothing is judged where no trial has two repeats or there is no noise."""
    free = lines.trial.size - np.unique(lines.trial).size
    if free == 0 or lines.harmonic is None or not lines.noise.definite:
        return Scatter(np.ones(len(lines)), np.ones(len(lines)))
    judged = lines.harmonic >= LOWEST
    free *= 2 * lines.y.shape[1]
    power = (np.abs(deviations(lines)) ** 2).sum(axis=(0, 2))[judged] / free
    ratio, p = np.ones(len(lines)), np.ones(len(lines))
    ratio[judged] = power / np.maximum(np.median(neighbourhood(power, NEIGHBOURS), axis=-1), 1.0)
    p[judged] = fdtrc(free, 2 * lines.y.shape[1] * lines.noise.dof[judged], ratio[judged])
    return Scatter(ratio, p)


def with_scatter(lines: Lines) -> Lines:
    """The lines with the covariance of sharp ones enlarged, and a note that says so.

    What rings may have the same phase in all repeats, which then share it instead of averaging it out. A sharp line
    therefore gets the excess variance of a single repeat, R times that of their mean.
    """
    estimate = scatter(lines)
    if not estimate.sharp.any():
        return lines
    factor = np.where(estimate.sharp, 1 + lines.trial.size * (estimate.ratio - 1), 1.0)
    return replace(lines, noise=lines.noise.times(factor), notes=(*lines.notes, _sharp_note(lines, estimate)))


def _sharp_note(lines: Lines, estimate: Scatter) -> str:
    where = np.flatnonzero(estimate.sharp)
    worst = where[int(estimate.ratio[where].argmax())]
    more = f" and {where.size - 1} other lines" if where.size > 2 else " and one other line" if where.size == 2 else ""
    return (
        f"at {lines.f[worst]:.2f} Hz{more} the cycles differ by up to {estimate.ratio[worst]:.2g} times the variance "
        "that neighbouring lines show (an almost undamped mode, or a start that is not over); the noise is taken as "
        "accordingly larger there"
    )


def trial_power(lines: Lines) -> np.ndarray | None:
    """Power (T, N) of the noise of every trial relative to the pooled covariance.

    None where a trial has one repeat, and where there is no noise.
    """
    trials, count = np.unique(lines.trial, return_counts=True)
    if trials.size < 2 or count.min() < 2 or not lines.noise.definite:
        return None
    square = (np.abs(deviations(lines)) ** 2).sum(axis=2)
    each = 2 * lines.y.shape[1]
    power = [square[lines.trial == t].sum(axis=0) / (each * (n - 1)) for t, n in zip(trials, count, strict=True)]
    return np.asarray(neighbourhood(np.array(power), NEIGHBOURS).mean(axis=-1))


def with_unequal_trials(lines: Lines) -> Lines:
    """The lines with the covariance that trials of unequal noise give their mean, and a note that says so."""
    power = trial_power(lines)
    if power is None:
        return lines
    whole = np.median(power, axis=1)
    if whole.max() < UNEQUAL * whole.min():
        return lines
    relative = power / power.mean(axis=0)
    share = np.array([lines.weight[lines.trial == t].sum(axis=0) for t in np.unique(lines.trial)])
    # The pooled covariance is an average of as many equal records as it has trials; unequal ones count as fewer.
    fewer = power.sum(axis=0) ** 2 / (power**2).sum(axis=0) / len(power)
    noise = lines.noise.times((share * relative).sum(axis=0)).with_fewer(fewer)
    return replace(lines, noise=noise, notes=(*lines.notes, _unequal_note(whole)))


def _unequal_note(power: np.ndarray) -> str:
    return (
        f"the noise of trial {int(power.argmax()) + 1} has {power.max() / power.min():.2g} times the power of that of "
        f"trial {int(power.argmin()) + 1}; the covariance of the mean takes this into account"
    )
