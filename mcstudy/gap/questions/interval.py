"""A number with its interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Interval:
    """Median and 95 % limits of one number.

    Attributes
    ----------
    estimate, low, high
        Median, 2.5 % and 97.5 % quantile.
    """

    estimate: float
    low: float
    high: float

    @classmethod
    def of(cls, samples: np.ndarray) -> Interval:
        """Of samples (n,)."""
        low, middle, high = (float(x) for x in np.quantile(samples, (0.025, 0.5, 0.975)))
        return cls(middle, low, high)
