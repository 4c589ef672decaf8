"""Whether the upper body responds relative to the lower body as it does in the other group.

With mean responses U of the upper and L of the lower body, the ratios of groups a and b are equal if U_b L_a = U_a L_b.
Both products are means over people of something that each person adds, so their difference has an error from the
scatter of these, also where the means differ: a common factor of both segments then weighs the people of the groups
differently. The difference is divided by its error in every relabelling, as that of the means (`Relabelled`).
Points are smoothed over frequency first: ratios change in wide bands, and errors of points do not.
"""

from __future__ import annotations

import numpy as np

from mcstudy.group_comparison.closed_tests import ranks
from mcstudy.group_comparison.sample import LEAST_VARIANCE, Sample
from mcstudy.spectra.frf_groups import as_complex

OCTAVES = 1.5
"""SD of the Gaussian weights over which points are smoothed."""

LOW_HZ = 0.75
"""Upper end of the low frequencies, at which vision contributes most to balance."""

AT_ONCE = 1000
"""Relabellings of one array."""


def ratio_test(
    sample: Sample, f: np.ndarray, labels: np.ndarray, octaves: float = OCTAVES, below: float = LOW_HZ
) -> float:
    """p-value of equal responses of the upper body relative to the lower body at frequencies below ``below``, Hz.

    ``labels``: memberships (n, rows), the first observed. ``octaves``: over which points are smoothed.
    """
    weight = np.exp(-0.5 * (np.subtract.outer(np.log2(f), np.log2(f)) / octaves) ** 2)
    weight = (weight / weight.sum(axis=1, keepdims=True))[f < below]
    both = as_complex(np.concatenate([sample.a, sample.b]))
    lower, upper = both[:, 0], both[:, 1]
    level = lower.mean(axis=0)
    away = (upper - upper.mean(axis=0) / level * lower) @ weight.T
    scale = (np.abs(away) ** 2).mean(axis=0)
    differences = _paired if sample.paired else _unpaired
    statistic = []
    for k in range(0, len(labels), AT_ONCE):
        size, variance = differences(lower, upper, labels[k : k + AT_ONCE], weight / level)
        statistic.append(
            (size / scale).sum(axis=1) / np.maximum((variance / scale).sum(axis=1), LEAST_VARIANCE / len(both))
        )
    return float(ranks(np.concatenate(statistic))[0])


def _unpaired(
    lower: np.ndarray, upper: np.ndarray, labels: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Squared differences and their variances, (n, points), of responses (rows, N)."""
    variance: np.ndarray | float = 0.0
    for members, others in ((labels, ~labels), (~labels, labels)):
        within, outside = (m / m.sum(axis=1, keepdims=True) for m in (members, others))
        added = (upper * (outside @ lower)[:, None] - (outside @ upper)[:, None] * lower) @ weight.T
        mean = np.einsum("nr,nrp->np", within, added)
        squares = np.einsum("nr,nrp->np", within, np.abs(added - mean[:, None]) ** 2)
        variance = variance + squares / (members.sum(axis=1, keepdims=True) - 1)
    return np.abs(mean) ** 2, np.asarray(variance)


def _paired(
    lower: np.ndarray, upper: np.ndarray, labels: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same of people who are in both groups, rows of a and then of b."""
    people = len(lower) // 2
    swapped = labels[:, :people, None]
    (la, lb), (ua, ub) = (
        (np.where(swapped, x[people:], x[:people]), np.where(swapped, x[:people], x[people:])) for x in (lower, upper)
    )
    mean_la, mean_lb, mean_ua, mean_ub = (x.mean(axis=1, keepdims=True) for x in (la, lb, ua, ub))
    added = (ub * mean_la - mean_ua * lb + mean_ub * la - ua * mean_lb) @ weight.T  # on average twice the difference
    twice = added.mean(axis=1)
    variance = (np.abs(added - twice[:, None]) ** 2).sum(axis=1) / (people * (people - 1))
    return np.abs(twice / 2) ** 2, variance
