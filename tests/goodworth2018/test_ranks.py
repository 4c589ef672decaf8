"""Ranks, compared with SciPy's."""

from __future__ import annotations

import numpy as np
from mcstudy_goodworth2018.paper.ranks import ranks
from scipy.stats import rankdata


def test_ranks_are_those_of_scipy_with_ties_and_missing_numbers() -> None:
    rng = np.random.default_rng(1)
    x = rng.integers(0, 6, (5, 4, 12)).astype(float)
    x[1, 2, 3] = np.nan
    x[2, 0, 5] = np.inf
    np.testing.assert_array_equal(ranks(x), rankdata(x, axis=-1))
    np.testing.assert_array_equal(ranks(x[0, 0]), rankdata(x[0, 0]))
