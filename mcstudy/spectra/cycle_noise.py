"""The noise of one cycle of a periodic recording: one estimator for each kind of stimulus.

A new estimator is a class that does what `CycleNoise` says, listed in `mcstudy.spectra.periodic.NOISE_ESTIMATORS`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from mcstudy.errors import InputError, RecordingError
from mcstudy.spectra.even_lines import EvenLineCovariance, half_width
from mcstudy.spectra.null_draws import Pooling, pooled
from mcstudy.spectra.transient import TransientMean


@dataclass(frozen=True)
class Cycles:
    """Fourier coefficients of every analysed cycle, R of them, at harmonics 0 ... K - 1.

    Attributes: stimulus (R, K); theta (R, K, Y), or (orders, R, K, Y) until an order of `leakage` is chosen;
    trial, cycle, amplitude: (R,).
    """

    stimulus: np.ndarray
    theta: np.ndarray
    trial: np.ndarray
    cycle: np.ndarray
    amplitude: np.ndarray


class CycleNoise(Protocol):
    """Estimator of the noise of one cycle at the harmonics ``at`` (N,), with what depends on their numbers done once.

    It is made from the ``name`` of the recording, its cycles and ``at``, and raises `RecordingError` where it cannot
    estimate.
    """

    pooling: Pooling
    """How the estimates at neighbouring lines share data."""

    def __init__(self, name: str, cycles: Cycles, at: np.ndarray) -> None: ...

    @staticmethod
    def suits(odd: bool) -> bool:
        """Whether it is meant for a recording whose stimulus excites ``odd`` lines only, or others too."""

    def freed(self, cycles: Cycles) -> Cycles:
        """The cycles, of one order of `mcstudy.spectra.leakage`, without the transient that it can estimate."""

    def __call__(self, cycles: Cycles) -> tuple[np.ndarray, np.ndarray]:
        """Unbiased covariance (N, Y, Y) of one cycle, and its degrees of freedom (N,)."""


def understatement(harmonics: np.ndarray, trials: int) -> np.ndarray:
    """Mean ratio of true to estimated covariance from even lines, at odd ``harmonics`` (N,).

    Measured in several hundred simulated recordings of 3, 6 and 20 cycles and three colours of noise. The prewhitening
    is fitted to the lines that it whitens, which removes 4 % of the noise of one trial. At the lowest lines all
    neighbours are on one side, which removes up to another 25 %.
    """
    return np.asarray((1 + 0.04 / trials) * (1 + 0.25 * np.exp(-(((harmonics - 1) / 5.0) ** 2))))


class EvenLineNoise:
    """Noise of the coefficients of one cycle at the odd lines ``at``, for a stimulus that does not excite even ones."""

    @staticmethod
    def suits(odd: bool) -> bool:
        """Whether the even lines hold noise alone."""
        return odd

    def __init__(self, name: str, cycles: Cycles, at: np.ndarray) -> None:
        trials = np.unique(cycles.trial).size
        colour = (trials, cycles.trial.size - trials)
        self._estimator = _estimator(name, at, cycles.stimulus.shape[1] - 1, colour)
        self._transient = TransientMean(self._estimator)
        understated = self._transient.understatement(at) * understatement(at, trials)
        self._understated = understated[:, None, None]
        self.pooling = Pooling(at.astype(float), half_width(at) + 1.0, colour_records=colour[1])

    def freed(self, cycles: Cycles) -> Cycles:
        """The cycles without the transient that taking differences leaves."""
        return replace(cycles, theta=self._transient.removed_from(cycles.theta, _scaled_means(cycles)))

    def __call__(self, cycles: Cycles) -> tuple[np.ndarray, np.ndarray]:
        """Unbiased covariance (N, Y, Y) of one cycle, and its degrees of freedom."""
        means = _scaled_means(cycles)
        covariance = self._understated * self._estimator(means, _differences(cycles))
        return covariance * len(means), self._estimator.dof * len(means)


class DifferenceNoise:
    """Noise of the coefficients of one cycle at any lines ``at``, for a stimulus that excites even lines, too.

    It comes from differences between cycles. Line k of the differences serves as even harmonic 2k of the estimators,
    which estimate at 2k - 1 and 2k + 1.
    """

    @staticmethod
    def suits(odd: bool) -> bool:
        """Whether even lines are excited."""
        return not odd

    def __init__(self, name: str, cycles: Cycles, at: np.ndarray) -> None:
        highest = 2 * cycles.stimulus.shape[1] - 1
        self._below, self._above = (_estimator(name, line, highest) for line in (2 * at - 1, 2 * at + 1))
        trials = np.unique(cycles.trial).size
        self.pooling = pooled(self._below.dof * (cycles.trial.size - trials), trials)

    def freed(self, cycles: Cycles) -> Cycles:
        """The cycles unchanged, because the transient cannot be estimated without unexcited lines."""
        return cycles

    def __call__(self, cycles: Cycles) -> tuple[np.ndarray, np.ndarray]:
        """Unbiased covariance (N, Y, Y) of one cycle, and its degrees of freedom."""
        noise = _differences(cycles)
        stretched = np.zeros((len(noise), 2 * noise.shape[1], noise.shape[2]), dtype=complex)
        stretched[:, ::2] = noise
        covariance = (self._below(stretched) + self._above(stretched)) / 2
        return covariance * len(noise), self._below.dof * len(noise)


def _scaled_means(cycles: Cycles) -> np.ndarray:
    """Mean cycle of every trial, (T, K, Y), scaled to the variance of one cycle.

    Its noise then includes the correlation between consecutive cycles, and trials of unequal length can be pooled.
    """
    scaled = []
    for t in np.unique(cycles.trial):
        theta = cycles.theta[cycles.trial == t]
        scaled.append(theta.mean(axis=0) * np.sqrt(theta.shape[0]))
    return np.array(scaled)


def _differences(cycles: Cycles) -> np.ndarray:
    """Orthonormal differences between the cycles of each trial, (D, K, Y), of the variance of one cycle."""
    out: list[np.ndarray] = []
    for t in np.unique(cycles.trial):
        theta = cycles.theta[cycles.trial == t]
        n = theta.shape[0]
        basis = np.linalg.qr(np.eye(n) - np.full((n, n), 1.0 / n))[0][:, : n - 1]
        out.extend(np.einsum("rd,rkj->dkj", basis, theta))
    return np.array(out)


def _estimator(
    name: str, wanted: np.ndarray, highest: int, any_colour: tuple[int, int] | None = None
) -> EvenLineCovariance:
    try:
        return EvenLineCovariance(wanted, highest, any_colour)
    except InputError as error:
        raise RecordingError(f"{name}: {error}") from error
