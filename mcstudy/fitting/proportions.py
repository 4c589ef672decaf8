"""The score interval of a mean of values between 0 and 1, such as a fraction (Wilson 1927, J Am Stat Assoc 22:209)."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import ndtri


def normal_quantile(confidence: float) -> float:
    """Two-sided standard normal quantile, e.g. 1.96 for 0.95."""
    return float(ndtri(0.5 + confidence / 2))


def score_interval(m: Any, n: Any, phi: float = 1.0, confidence: float = 0.95) -> tuple[Any, Any]:
    """Centre and half width of the score interval of a mean ``m`` of ``n`` values from 0 to 1 (numbers or arrays).

    It ends at the roots mu of n (m - mu)^2 = z^2 phi mu (1 - mu), with z `normal_quantile`: Wilson's interval of a
    fraction when ``phi`` is 1, a narrower one when the values vary less than those of 0 and 1 only.
    """
    a = normal_quantile(confidence) ** 2 * phi / n
    return (m + a / 2) / (1 + a), np.sqrt(a * (m * (1 - m) + a / 4)) / (1 + a)
