"""What the body felt between the samples of the stimulus.

A PRTS torque runs in straight lines from sample to sample. Its continuous spectrum is then that of its samples times
sinc^2(f / rate), not that of a band-limited signal: 0.52 % less at 8 Hz and 200 Hz. Little, but it is the same for
every line and every cycle, so a recording with little noise at high lines shows it as a gap, and as one that looks
like a lag or an inertia. It is known exactly, so it is divided out (`pipelines/fig2d.md` measures it).

A recorded stimulus has noise or filters of its own, so its samples are on no straight lines, and is taken as
band-limited, as is one that is held between rare jumps: whether a jump took place at, before or after its sample is
not in the samples.
"""

from __future__ import annotations

import numpy as np

from mcstudy.gap.recording import Recording

BENT = 0.05
"""Second difference, relative to the largest, from which three samples are not on a straight line."""

MOVING = 0.05
"""First difference, relative to the largest, from which the stimulus moves."""

SHARE = 0.75
"""Share of the moving samples on straight lines from which a stimulus is made of them."""


def is_straight(stimulus: np.ndarray) -> bool:
    """Whether samples (n,) are on straight lines that bend at few of them, and at samples only."""
    slope = np.diff(stimulus)
    bend = np.abs(np.diff(slope))
    if bend.size == 0 or not bend.any():
        return False
    moves = np.abs(slope) > MOVING * np.abs(slope).max()
    moving = moves[1:] | moves[:-1]
    return bool((bend[moving] <= BENT * bend.max()).mean() >= SHARE)


def drive(recording: Recording, f: np.ndarray) -> np.ndarray:
    """Spectrum of the continuous stimulus over that of its samples at frequencies ``f`` (Hz), shape of ``f``."""
    if not all(is_straight(trial.stimulus) for trial in recording.trials):
        return np.ones_like(f, dtype=float)
    return np.sinc(np.asarray(f) / recording.rate_hz) ** 2
