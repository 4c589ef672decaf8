"""Deviations that are smooth in nothing: energy that a nonlinearity scatters from line to line.

Nobody can draw such a deviation, but it makes the whole residual larger than noise. It is judged by the sum of squares
alone: under the null that sum is about ``scale`` times a chi-squared of ``dof`` degrees of freedom (fitted to draws of
the null, whose covariance is an estimate, so the tails are heavier than the number of lines says); under a rough
deviation the sum is larger by delta^2 on average, spread evenly. Derived.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

TYPICAL_DELTA = 10.0
"""Scale of the prior on delta, half normal."""

PRIOR = 0.1
"""Prior probability that a body whose smooth gap has been explained also leaves a rough one."""

GRID = np.linspace(0.5, 4.0 * TYPICAL_DELTA, 60)


@dataclass(frozen=True)
class Rough:
    """The sum of squares under the null: ``scale`` times chi-squared with ``dof`` degrees of freedom."""

    scale: float
    dof: float

    @classmethod
    def of(cls, null_chi2: np.ndarray, taken: int = 0) -> Rough:
        """From draws (n,) of the sum under the null; ``taken``: dimensions that are judged otherwise, left out here."""
        mean, variance = float(null_chi2.mean()) - taken, float(null_chi2.var()) - 2 * taken
        scale = max(variance / (2 * mean), 1.0)
        return cls(scale, mean / scale)

    def log_factor(self, chi2: np.ndarray) -> np.ndarray:
        """ln Bayes factor of a rough deviation against none, for sums of squares of any shape."""
        return np.asarray(logsumexp(self._by_delta(chi2), axis=-1))

    def draws(self, chi2: float, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draws (n,) of delta^2 given the sum of squares: zero where the deviation is not there."""
        log = self._by_delta(np.asarray(chi2))
        odds = np.exp(min(float(logsumexp(log)), 600.0)) * PRIOR / (1 - PRIOR)
        there = rng.random(n) < odds / (1 + odds)
        return np.where(there, rng.choice(GRID, n, p=np.exp(log - logsumexp(log))) ** 2, 0.0)

    def _by_delta(self, chi2: np.ndarray) -> np.ndarray:
        """ln of prior times likelihood ratio on the grid of delta, (..., `GRID`)."""
        x = np.asarray(chi2, dtype=float)[..., None] / self.scale
        v = GRID**2 / (self.scale * self.dof)
        log_prior = -0.5 * (GRID / TYPICAL_DELTA) ** 2
        log_ratio = 0.5 * x * v / (1 + v) - 0.5 * self.dof * np.log1p(v)
        return np.asarray(log_ratio + log_prior - logsumexp(log_prior))
