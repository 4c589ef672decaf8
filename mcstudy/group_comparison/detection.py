"""Whether two groups differ, where, and whether both segments change alike: tests by relabelling (`Sample.relabelled`).

- Any difference: differences of the means, and of the scatter between people, combined by Fisher's product of their
  p-values, which is itself compared with that of all relabellings. Scatter tells something of its own: the noise of an
  FRF is inversely proportional to the amplitude of the stimulus.
- Where: the same test of the means for every segment and band, and the smallest p-value of all (Westfall & Young 1993).
- Whether the segments change alike. In the model, a tilt or a torque at the ankle reaches the upper body through the
  hip: its balance alone sets the response of the upper body relative to that of the lower. Whatever changes at the
  ankle, its gains and delays and the weight of what is sensed of the stimulus, then changes both responses by the same
  factor, to the extent that the stimulus has little effect on hip torque by itself. A change in how the upper body is
  controlled changes their ratio. The test is that of upper - r lower, with the ratio r of both groups together.

Means are compared point by point in units of their errors; nothing is inverted, so few people are enough. For the
ratio, points are smoothed over frequency first: it changes in wide bands, and errors of points do not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mcstudy.group_comparison.sample import Sample
from mcstudy.spectra.frf_groups import as_complex

OCTAVES = 1.5
"""SD of the Gaussian weights over which points are smoothed."""

LOW_HZ = 0.75
"""Upper end of the low frequencies, at which vision contributes most to balance."""

BANDS = (("low", 0.0, 0.25), ("middle", 0.25, LOW_HZ), ("high", LOW_HZ, np.inf))
"""Bands and their ends, Hz."""


@dataclass(frozen=True)
class Region:
    """One segment in one band: difference of b from a.

    Attributes
    ----------
    segment, band: names. low, high: its first and last point, Hz. gain: ratio of the mean responses, b over a.
    phase_deg: b minus a. p: of no difference, corrected for all regions.
    """

    segment: str
    band: str
    low: float
    high: float
    gain: float
    phase_deg: float
    p: float


@dataclass(frozen=True)
class Detection:
    """Outcome of the tests.

    Attributes
    ----------
    p: any difference. p_mean: difference of mean responses. p_scatter: of scatter. scatter_ratio: variance between
    people of b over that of a. p_ratio: upper body relative to lower body, at low frequencies. regions: where.
    """

    p: float
    p_mean: float
    p_scatter: float
    scatter_ratio: float
    p_ratio: float
    regions: tuple[Region, ...]


def detect(sample: Sample, f: np.ndarray, rng: np.random.Generator, permutations: int = 999) -> Detection:
    """Test two groups at points of mean frequencies ``f`` (N,), Hz."""
    labels = sample.relabelled(rng, permutations)
    difference, log_ratio = sample.statistics(labels)
    size = _standardised(sample, difference)
    of_mean = ranks(size.sum(axis=1))
    of_scatter = ranks(np.abs(log_ratio))
    together = ranks(-np.log(of_mean) - np.log(of_scatter))
    regions = _regions(sample, f, size)
    return Detection(
        float(together[0]),
        float(of_mean[0]),
        float(of_scatter[0]),
        float(np.exp(log_ratio[0])),
        ratio_test(sample, f, labels),
        regions,
    )


def ratio_test(
    sample: Sample, f: np.ndarray, labels: np.ndarray, octaves: float = OCTAVES, below: float = LOW_HZ
) -> float:
    """p-value of equal responses of the upper body relative to the lower body at frequencies below ``below``, Hz.

    ``octaves``: over which points are smoothed.
    """
    own = smoothed(relative(sample), f, octaves)
    low = np.tile(f < below, 2)
    return float(ranks(_standardised(own, own.statistics(labels)[0])[:, low].sum(axis=1))[0])


def ranks(statistic: np.ndarray) -> np.ndarray:
    """p-values (n,) of all relabellings: the share with a statistic at least as large as theirs."""
    rounded = np.round(statistic / (np.abs(statistic).max() or 1.0), 12)
    return np.asarray((len(rounded) - np.searchsorted(np.sort(rounded), rounded)) / len(rounded))


def relative(sample: Sample) -> Sample:
    """Response of the upper body minus that of the lower times their ratio in both groups together, (people, 2 N)."""
    ratio = sample.mean[1] / sample.mean[0]

    def of(numbers: np.ndarray) -> np.ndarray:
        lower, upper = np.moveaxis(as_complex(numbers), -2, 0)
        away = upper - ratio * lower
        return np.concatenate([away.real, away.imag], axis=-1)

    return replace(sample, a=of(sample.a), b=of(sample.b))


def smoothed(sample: Sample, f: np.ndarray, octaves: float = OCTAVES) -> Sample:
    """Numbers of every response averaged over neighbouring points."""
    weight = np.exp(-0.5 * (np.subtract.outer(np.log2(f), np.log2(f)) / octaves) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)

    def of(numbers: np.ndarray) -> np.ndarray:
        return np.asarray(numbers.reshape(len(numbers), -1, f.size) @ weight.T).reshape(numbers.shape)

    return replace(sample, a=of(sample.a), b=of(sample.b))


def _standardised(sample: Sample, difference: np.ndarray) -> np.ndarray:
    """Squared differences (n, D) in units of their variance without a difference."""
    values = np.concatenate([sample.b - sample.a] if sample.paired else [sample.a, sample.b])
    variance = (values**2).mean(axis=0) if sample.paired else values.var(axis=0)
    return np.asarray(difference**2 / variance)


def _regions(sample: Sample, f: np.ndarray, size: np.ndarray) -> tuple[Region, ...]:
    """All segments and bands; ``size``: `_standardised` of all relabellings, (n, 4 N)."""
    of_point = size.reshape(len(size), 2, 2, f.size).sum(axis=1)  # real and imaginary parts together
    a, b = (as_complex(x.mean(axis=0)) for x in (sample.a, sample.b))
    found, p = [], []
    for k, segment in enumerate(("lower", "upper")):
        for band, low, high in BANDS:
            at = (f >= low) & (f < high)
            if not at.any():
                continue
            cross = np.sum(b[k, at] * a[k, at].conj())
            gain = float(np.exp(np.mean(np.log(np.abs(b[k, at] / a[k, at])))))
            ends = float(f[at].min()), float(f[at].max())
            found.append(Region(segment, band, *ends, gain, float(np.rad2deg(np.angle(cross))), 1.0))
            p.append(ranks(of_point[:, k, at].sum(axis=1)))
    least = np.min(p, axis=0)
    return tuple(
        replace(region, p=float(np.mean(least <= own[0] * (1 + 1e-12)))) for region, own in zip(found, p, strict=True)
    )


def name(found: Detection, level: float = 0.05) -> str:
    """``"same"``, ``"alike"`` (both segments change by one factor) or ``"upper body"`` (their ratio changes)."""
    if found.p > level:
        return "same"
    return "upper body" if found.p_ratio <= level else "alike"
