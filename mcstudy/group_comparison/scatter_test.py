"""Whether people scatter more about their mean in one group than in the other.

Scatter is the mean squared deviation of people from the mean of their group, each number in units of its SD. Two
relabellings are made, of the responses themselves, which is exact if the groups do not differ at all, and of deviations
from the means of the groups, because a difference of means would add to the scatter of relabelled groups. The larger
p-value counts.
"""

from __future__ import annotations

import numpy as np

from mcstudy.group_comparison.closed_tests import ranks
from mcstudy.group_comparison.sample import Sample


def scatter_test(sample: Sample, labels: np.ndarray) -> tuple[float, float]:
    """p-value of equal scatter, and the variance of b over that of a; ``labels``: memberships (n, rows)."""
    variance = np.diag(sample.person.covariance)
    scaled = [x / np.sqrt(variance) for x in (sample.a, sample.b)]
    about = [(x - x.mean(axis=0)) / np.sqrt(1 - 1 / len(x)) for x in scaled]
    as_they_are, without_means = (_log_ratio(np.concatenate(rows), labels) for rows in (scaled, about))
    p = max(float(ranks(np.abs(x))[0]) for x in (as_they_are, without_means))
    return p, float(np.exp(as_they_are[0]))


def _log_ratio(y: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Logarithms (n,) of the scatter of b over that of a, of rows ``y`` (rows, D)."""
    y = y - y.mean(axis=0)
    squares = (y * y).sum(axis=1)
    within = []
    for members in (~labels, labels):
        n = members.sum(axis=1)
        mean = members @ y / n[:, None]
        within.append((members @ squares - n * (mean**2).sum(axis=1)) / (n - 1))
    return np.asarray(np.log(within[1] / within[0]))
