"""Several hypotheses about one difference, decided by one test: closed testing.

Every set of hypotheses has its test, here of the sum over the set. A hypothesis is rejected if the test of every set
that holds it rejects, so its p-value is the largest of theirs (Marcus, Peritz & Gabriel 1976, Biometrika 63:655). False
rejections among all of them are then no more frequent than the level, whichever hypotheses are true, and no p-value is
below that of the test of all hypotheses together, which is the decision.
"""

from __future__ import annotations

import itertools

import numpy as np


def ranks(statistic: np.ndarray) -> np.ndarray:
    """p-values (n,) of all relabellings: the share with a statistic at least as large as theirs."""
    rounded = np.round(statistic / (np.abs(statistic).max() or 1.0), 12)
    return np.asarray((len(rounded) - np.searchsorted(np.sort(rounded), rounded)) / len(rounded))


def closed(parts: np.ndarray) -> tuple[float, np.ndarray]:
    """p-value of no difference anywhere, and of none in each of K parts, (K,).

    ``parts``: (K, n), what each part adds to the statistic of a set, for n relabellings, the first the observed one.
    """
    K = len(parts)
    single = np.zeros(K)
    for size in range(1, K + 1):
        for some in itertools.combinations(range(K), size):
            p = float(ranks(parts[list(some)].sum(axis=0))[0])
            single[list(some)] = np.maximum(single[list(some)], p)
    return p, single
