"""Whether a planned trial will show a response: a diagnosis refuses a recording whose angles hold noise alone.

The test is that of `mcstudy.lines.labels`: the clearest band of an angle, against noise, corrected for their
number. Under a body that responds, the statistic of a band is noncentral F; the chance that the clearest band alone
passes is a lower limit. A fit near instability overestimates responses at some frequencies, so the nominal body has to
pass as well, and so has the fit of every cause, on average over their probabilities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.special import fdtri, ncfdtr

from mcstudy.gap.trial_planning.trials import PlannedTrial, SwayNoise
from mcstudy.lines.labels import EDGES_HZ, NO_RESPONSE

SURE = 0.95
"""Chance of a response beyond noise that a trial must have to be planned."""

SURER = 0.99
"""The same for the smallest amplitude that is chosen, so that rounding does not spoil it."""


PLAIN = 1e3
"""Noncentrality of a line beyond which no noise hides the response; a larger one is no more certain."""

MOST = 1e6
"""Largest amplitude that is tried, in the unit of the stimulus."""


def chances(trial: PlannedTrial, noise: SwayNoise, responses: np.ndarray, dof: float) -> np.ndarray:
    """Chances (B,) that the recording of each body shows a response.

    Parameters
    ----------
    responses: of B bodies at the lines of the trial, (B, N, 2), rad per unit. dof: complex degrees of freedom of the
    noise estimate at a line of one trial.
    """
    variance = np.einsum("nii->ni", trial.covariance(noise)).real
    signal = np.minimum(2 * np.abs(responses) ** 2 / variance, PLAIN)
    tests, nu = 2 * len(EDGES_HZ), 2 * dof * trial.trials
    out = np.zeros(len(responses))
    for low, high in pairwise(EDGES_HZ):
        inside = (trial.f >= low) & (trial.f < high)
        if inside.any():
            m = 2 * int(inside.sum())
            limit = fdtri(m, nu, 1 - NO_RESPONSE / tests)
            out = np.maximum(out, (1 - ncfdtr(m, nu, signal[:, inside].sum(axis=1), limit)).max(axis=1))
    return out


def least_amplitude(trial: PlannedTrial, chance: Callable[[PlannedTrial], float]) -> float:
    """The smallest amplitude with which ``chance`` is `SURER`, in the unit of the stimulus."""
    low, high = 1e-9, 1e-9
    while high < MOST and chance(replace(trial, amplitude=high)) < SURER:
        low, high = high, 4 * high
    while high > 1.01 * low:
        middle = float(np.sqrt(low * high))
        if chance(replace(trial, amplitude=middle)) < SURER:
            low = middle
        else:
            high = middle
    return high
