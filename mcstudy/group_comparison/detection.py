"""Whether two groups differ, where, and whether both segments change alike: tests by relabelling (`Sample.relabelled`).

One test decides: whether the mean responses differ. What else is said of the means follows from it and is never surer.

- Means: differences of all points, in units of their own errors (`Relabelled`), so that groups of unequal noise and
  equal means are not told apart. Every segment and band adds the square of its statistic: a difference in one of them
  counts for more than the same difference spread over all.
- Where: p-values of segments and bands from closed tests (`mcstudy.group_comparison.closed_tests`), which the test of
  the means begins.
- Whether the segments change alike. In the model, a tilt or a torque at the ankle reaches the upper body through the
  hip: its balance alone sets the response of the upper body relative to that of the lower. Whatever changes at the
  ankle, its gains and delays and the weight of what is sensed of the stimulus, then changes both responses by the same
  factor, to the extent that the stimulus has little effect on hip torque by itself. A change in how the upper body is
  controlled changes their ratio (`mcstudy.group_comparison.ratio_test`). Equal means have equal ratios, so the p-value
  is the larger one of this test and of that of the means.

Scatter between people is another question with a test of its own (`mcstudy.group_comparison.scatter_test`): the noise
of an FRF is inversely proportional to the amplitude of the stimulus.

Means are compared point by point in units of their errors; nothing is inverted, so few people are enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mcstudy.group_comparison.closed_tests import closed
from mcstudy.group_comparison.ratio_test import LOW_HZ, ratio_test
from mcstudy.group_comparison.sample import Sample
from mcstudy.group_comparison.scatter_test import scatter_test
from mcstudy.spectra.frf_groups import as_complex

BANDS = (("low", 0.0, 0.25), ("middle", 0.25, LOW_HZ), ("high", LOW_HZ, np.inf))
"""Bands and their ends, Hz."""

SEGMENTS = ("lower", "upper")


@dataclass(frozen=True)
class Region:
    """One segment in one band: difference of b from a.

    Attributes
    ----------
    segment, band: names. low, high: its first and last point, Hz. gain: ratio of the mean responses, b over a.
    phase_deg: b minus a. p: of equal means in it, corrected for all regions; at least `Detection.p_mean`.
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
    p_mean: of equal mean responses; the decision. p_ratio: of an equal response of the upper body relative to the lower
    body, at low frequencies; at least ``p_mean``. p_scatter: of equal scatter between people, a question of its own.
    scatter_ratio: variance between people of b over that of a. regions: where the means differ.
    relabellings: number of groups compared, the observed pair among them. least_p: smallest p-value they allow.
    """

    p_mean: float
    p_ratio: float
    p_scatter: float
    scatter_ratio: float
    regions: tuple[Region, ...]
    relabellings: int
    least_p: float


def detect(sample: Sample, f: np.ndarray, rng: np.random.Generator, permutations: int = 999) -> Detection:
    """Test two groups at points of mean frequencies ``f`` (N,), Hz."""
    labels = sample.relabelled(rng, permutations)
    relabelled = sample.differences(labels)
    regions, numbers = _regions(sample, f)
    p_mean, p = closed(np.stack([relabelled.of(members) ** 2 for members in numbers]))
    p_scatter, scatter_ratio = scatter_test(sample, labels)
    return Detection(
        p_mean=p_mean,
        p_ratio=max(p_mean, ratio_test(sample, f, labels)),
        p_scatter=p_scatter,
        scatter_ratio=scatter_ratio,
        regions=tuple(replace(region, p=float(corrected)) for region, corrected in zip(regions, p, strict=True)),
        relabellings=len(labels),
        least_p=sample.least_p(labels),
    )


def _regions(sample: Sample, f: np.ndarray) -> tuple[list[Region], list[np.ndarray]]:
    """All segments and bands that have points, not tested, and which numbers (4 N,) bool they hold."""
    a, b = (as_complex(x.mean(axis=0)) for x in (sample.a, sample.b))
    regions, numbers = [], []
    for k, segment in enumerate(SEGMENTS):
        for band, low, high in BANDS:
            at = (f >= low) & (f < high)
            if not at.any():
                continue
            cross = np.sum(b[k, at] * a[k, at].conj())
            gain = float(np.exp(np.mean(np.log(np.abs(b[k, at] / a[k, at])))))
            ends = float(f[at].min()), float(f[at].max())
            regions.append(Region(segment, band, *ends, gain, float(np.rad2deg(np.angle(cross))), 1.0))
            members = np.zeros((2, 2, f.size), dtype=bool)  # real and imaginary parts together
            members[:, k] = at
            numbers.append(members.ravel())
    return regions, numbers


def name(detection: Detection, level: float = 0.05) -> str:
    """``"same"``, ``"alike"`` (both segments change by one factor) or ``"upper body"`` (their ratio changes)."""
    if detection.p_mean > level:
        return "same"
    return "upper body" if detection.p_ratio <= level else "alike"
