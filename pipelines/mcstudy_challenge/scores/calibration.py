"""Calibration of stated probabilities: are answers that state 80 % right in 80 % of cases?

Sources: Murphy & Winkler 1977, Appl Stat 26:41 (reliability diagram); Naeini et al. 2015, AAAI 29:2901 (expected
calibration error); Bröcker & Smith 2007, Weather Forecast 22:651 (the error under perfect calibration is not zero);
Spiegelhalter 1986, Stat Med 5:421 (z).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr

from mcstudy.streams import stream
from mcstudy_challenge.scores.rates import Estimate, rate

BINS = 10
"""Bins of equal width between 0 and 1. A bin contains its upper end, not its lower one; the first contains 0 too."""

DRAWS = 1000
"""Draws of outcomes by which the calibration error of calibrated probabilities is simulated."""

FEWEST = 0.5
"""Least sum of p (1 - p) for which Spiegelhalter's z is nearly normal: fewer expected surprises tell nothing."""


@dataclass(frozen=True)
class Bin:
    """Statements of one bin: their mean probability, and the fraction that came true with Wilson's 95 % interval."""

    low: float
    high: float
    stated: float
    right: Estimate


@dataclass(frozen=True)
class Calibration:
    """How well probabilities agree with what came true.

    Attributes
    ----------
    stated: mean probability. right: fraction that came true. bins: those of `BINS` that contain statements.
    error: expected calibration error, the mean over statements of |fraction that came true - mean probability| of
    their bin. by_chance: its mean if the probabilities are calibrated; chance_high: its 95 % quantile then; p_value:
    fraction of such draws with an error at least as large.
    z, z_p_value: Spiegelhalter's statistic and its two-sided p-value; nan where probabilities near 0 and 1 leave too
    little to test (`FEWEST`). It is positive when what came true is less certain than stated.
    """

    stated: float
    right: Estimate
    bins: tuple[Bin, ...]
    error: float
    by_chance: float
    chance_high: float
    p_value: float
    z: float
    z_p_value: float

    def to_dict(self) -> dict[str, Any]:
        """For JSON: nan becomes null."""
        numbers = {
            k: getattr(self, k) for k in ("stated", "error", "by_chance", "chance_high", "p_value", "z", "z_p_value")
        }
        return {
            **{k: None if math.isnan(v) else round(v, 5) for k, v in numbers.items()},
            "right": self.right.to_dict(),
            "bins": [
                {"low": b.low, "high": b.high, "stated": round(b.stated, 5), "right": b.right.to_dict()}
                for b in self.bins
            ],
        }


def calibration(stated: Iterable[float], right: Iterable[bool]) -> Calibration:
    """Calibration of probabilities ``stated`` (each in [0, 1]) of what came true or did not, ``right``.

    Raises `ValueError` for different lengths and for probabilities outside [0, 1].
    """
    p = np.fromiter(stated, dtype=float)
    y = np.fromiter(right, dtype=bool)
    if p.shape != y.shape:
        raise ValueError(f"expected as many probabilities as outcomes, found {p.size} and {y.size}")
    if not ((p >= 0) & (p <= 1)).all():
        raise ValueError("expected probabilities from 0 to 1")
    if not p.size:
        return Calibration(math.nan, rate(()), (), *(math.nan,) * 6)
    edges = np.linspace(0.0, 1.0, BINS + 1)
    place = np.searchsorted(edges[1:-1], p)
    drawn = stream(0, "calibration").random((DRAWS, p.size)) < p
    chance = _error(p, drawn, place)
    error = float(_error(p, y[None], place)[0])
    z = spiegelhalter(p, y)
    return Calibration(
        float(p.mean()),
        rate(y),
        tuple(
            Bin(float(edges[k]), float(edges[k + 1]), float(p[place == k].mean()), rate(y[place == k]))
            for k in np.unique(place)
        ),
        error,
        float(chance.mean()),
        float(np.quantile(chance, 0.95)),
        (1 + int((chance >= error - 1e-12).sum())) / (1 + DRAWS),
        z,
        float(2 * ndtr(-abs(z))),
    )


def spiegelhalter(p: np.ndarray, y: np.ndarray) -> float:
    """Spiegelhalter's z: standard normal for calibrated probabilities; nan where they are too certain to test."""
    variance = p * (1 - p)
    if variance.sum() < FEWEST:
        return math.nan
    spread = float((variance * (1 - 2 * p) ** 2).sum())
    return float(((y - p) * (1 - 2 * p)).sum()) / math.sqrt(spread) if spread > 0 else math.nan


def _error(p: np.ndarray, y: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Expected calibration errors of the outcomes ``y`` (draws, statements) in the bins ``place``."""
    bins = [place == k for k in np.unique(place)]
    return np.asarray(sum(np.abs(y[:, own].sum(axis=1) - p[own].sum()) for own in bins) / p.size)
