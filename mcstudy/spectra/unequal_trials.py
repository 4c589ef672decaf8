"""Trials whose noise differs in power.

The covariance of a periodic recording is pooled over trials: it is the mean of theirs. The mean response weights a
trial by the square of its amplitude, so with trials of unequal noise and unequal weights the pooled covariance is not
that of the mean. `with_unequal_trials` measures the power of every trial by the differences between its cycles and
corrects the covariance and its degrees of freedom. Noise that changes within a trial needs no correction, because
the even lines are those of the mean over all its cycles. Derived.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mcstudy.spectra.around import around
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.scatter import deviations

UNEQUAL = 1.5
"""Ratio of the largest to the smallest power of a trial from which the covariance is corrected."""

AROUND = 51
"""Number of lines over which the power of a trial is averaged; resonances of the body are common to all trials."""


def trial_power(lines: Lines) -> np.ndarray | None:
    """Power (T, N) of the noise of every trial relative to the pooled covariance.

    None where a trial has one repeat, and where there is no noise.
    """
    trials, count = np.unique(lines.trial, return_counts=True)
    if trials.size < 2 or count.min() < 2 or not lines.noise.definite:
        return None
    square = (np.abs(deviations(lines)) ** 2).sum(axis=2)
    power = [square[lines.trial == t].sum(axis=0) / (4 * (n - 1)) for t, n in zip(trials, count, strict=True)]
    return np.asarray(around(np.array(power), AROUND).mean(axis=-1))


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
    return replace(lines, noise=noise, notes=(*lines.notes, _note(whole)))


def _note(power: np.ndarray) -> str:
    return (
        f"the noise of trial {int(power.argmax()) + 1} has {power.max() / power.min():.2g} times the power of that of "
        f"trial {int(power.argmin()) + 1}; the covariance of the mean takes this into account"
    )
