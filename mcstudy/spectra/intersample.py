"""Shape of the stimulus between its samples.

A PRTS torque is linear between samples. Its continuous spectrum is therefore that of its samples times
sinc^2(f / rate), not that of a band-limited signal. The difference is small, 0.52 % at 8 Hz for a rate of 200 Hz, but
it is the same in every cycle. In a recording with little noise at high lines it would appear as a gap that resembles a
lag or an inertia. The factor is known exactly, so it is corrected (`pipelines/fig2d.md` measures it).

The samples of a recorded stimulus contain noise or are filtered, so they do not lie on straight lines. Such a stimulus
is treated as band-limited. So is a stimulus that is constant between rare jumps, because the samples do not tell
whether a jump took place at, before or after its sample.
"""

from __future__ import annotations

import numpy as np

from mcstudy.recordings.recording import Recording

BENT = 0.05
"""Second difference, relative to the largest, above which three samples are not on a straight line."""

MOVING = 0.05
"""First difference, relative to the largest, above which the stimulus changes."""

SHARE = 0.75
"""Smallest share of changing samples on straight lines for a stimulus to count as piecewise linear."""

LEVELS = 9
"""Most different slopes of a stimulus that is recognised by taking the same few slopes again and again."""


def is_straight(stimulus: np.ndarray) -> bool:
    """Whether the stimulus (n,) is piecewise linear, with bends at samples.

    It is if bends are few, or if it takes the same few slopes again and again, as a PRTS does whose slope may change at
    every sample or every second one.
    """
    slope = np.diff(stimulus)
    bend = np.abs(np.diff(slope))
    if bend.size == 0 or not bend.any():
        return False
    moves = np.abs(slope) > MOVING * np.abs(slope).max()
    moving = moves[1:] | moves[:-1]
    if (bend[moving] <= BENT * bend.max()).mean() >= SHARE:
        return True
    jumps = not (moves[1:] & moves[:-1]).any()  # constant between them
    return not jumps and _levels(slope) <= LEVELS < _levels(stimulus)


def _levels(values: np.ndarray) -> float:
    """Number of narrow groups that the values (n,) form; infinite if one of them is wide."""
    ordered, narrow = np.sort(values), BENT * np.abs(values).max()
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > narrow) + 1)
    return len(groups) if all(g[-1] - g[0] <= narrow for g in groups) else np.inf


def drive(recording: Recording, f: np.ndarray) -> np.ndarray:
    """Spectrum of the continuous stimulus over that of its samples at frequencies ``f`` (Hz), shape of ``f``."""
    if not all(is_straight(trial.stimulus) for trial in recording.trials):
        return np.ones_like(f, dtype=float)
    return straight_lines(np.asarray(f), recording.rate_hz)


def straight_lines(f: np.ndarray, rate_hz: float) -> np.ndarray:
    """Spectrum of straight lines between samples over that of the samples, at frequencies ``f`` (Hz), shape of ``f``.

    Derived: (sin x / x)^2 with x = pi f / rate, up to aliases.
    """
    return np.sinc(f / rate_hz) ** 2
