"""Unstructured residual: energy that a nonlinearity scatters from line to line, smooth over no variable.

The shape of such a deviation is unpredictable, but it makes the whole residual larger than noise. The test uses the
sum of squares alone. Under the null that sum is about ``scale`` times a chi-squared variable with ``dof`` degrees of
freedom. Both are fitted to null samples: the noise covariance is an estimate, so the tails are heavier than the number
of lines predicts. An unstructured deviation of size delta increases the sum by delta^2 on average, spread evenly over
the lines. Derived.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TYPICAL_DELTA = 10.0
"""Scale of the half-normal prior on delta."""

PRIOR = 0.1
"""Prior probability that an unstructured gap remains after the smooth gap has been explained."""

GRID = np.linspace(0.5, 4.0 * TYPICAL_DELTA, 60)


@dataclass(frozen=True)
class UnstructuredResidual:
    """The sum of squares under the null: ``scale`` times chi-squared with ``dof`` degrees of freedom."""

    scale: float
    dof: float

    @classmethod
    def of(cls, null_chi2: np.ndarray, taken: int = 0) -> UnstructuredResidual:
        """From null samples (n,) of the sum. ``taken``: dimensions that another test covers, left out here.

        Few lines may leave none; one is kept, so that the distribution exists.
        """
        mean, variance = max(float(null_chi2.mean()) - taken, 1.0), float(null_chi2.var()) - 2 * taken
        scale = max(variance / (2 * mean), 1.0)
        return cls(scale, mean / scale)

    def log_factor(self, chi2: np.ndarray) -> np.ndarray:
        """ln Bayes factor of an unstructured deviation against no deviation, for sums of squares of any shape."""
        return np.asarray(np.logaddexp.reduce(self._by_delta(chi2), axis=-1))

    def samples(self, chi2: float, rng: np.random.Generator, n: int) -> np.ndarray:
        """Posterior samples (n,) of delta^2 given the sum of squares; zero where there is no deviation."""
        log = self._by_delta(np.asarray(chi2))
        odds = np.exp(min(float(np.logaddexp.reduce(log)), 600.0)) * PRIOR / (1 - PRIOR)
        there = rng.random(n) < odds / (1 + odds)
        return np.where(there, rng.choice(GRID, n, p=np.exp(log - np.logaddexp.reduce(log))) ** 2, 0.0)

    def _by_delta(self, chi2: np.ndarray) -> np.ndarray:
        """ln(prior times likelihood ratio) on the grid of delta, (..., `GRID`)."""
        x = np.asarray(chi2, dtype=float)[..., None] / self.scale
        v = GRID**2 / (self.scale * self.dof)
        log_prior = -0.5 * (GRID / TYPICAL_DELTA) ** 2
        log_ratio = 0.5 * x * v / (1 + v) - 0.5 * self.dof * np.log1p(v)
        return np.asarray(log_ratio + log_prior - np.logaddexp.reduce(log_prior))
