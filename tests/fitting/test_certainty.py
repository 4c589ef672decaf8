"""When enough starts have been drawn: the rule beside SciPy's interval, and the numbers of starts it looks at."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from mcstudy.fitting.certainty import COST_FLOOR, FIRST_LOOK, HIT_TOLERANCE, certain, looks
from mcstudy.fitting.status import WANTED


@pytest.mark.parametrize("starts", [FIRST_LOOK, 2 * FIRST_LOOK])
def test_a_pool_is_certain_exactly_where_the_upper_end_of_the_chance_is_below_one_percent(starts: int) -> None:
    for hits in range(1, 40):
        cost = np.full(starts, 2.0)
        cost[:hits] = 1.0
        lower = binomtest(hits, starts).proportion_ci(method="wilson").low
        assert bool(certain(cost)) == ((1 - lower) ** starts < WANTED), hits


def test_hits_are_costs_within_the_tolerance_and_failed_fits_are_starts_without_success() -> None:
    within, above = 1 + 0.9 * HIT_TOLERANCE, 1 + 1.1 * HIT_TOLERANCE
    pool = np.concatenate([[1.0], np.full(10, within), np.full(89, above)])
    failed = np.concatenate([[1.0], np.full(10, within), np.full(89, np.nan)])
    few = np.concatenate([[1.0], np.full(3, within), np.full(96, above)])
    assert certain(np.stack([pool, failed, few])).tolist() == [True, True, False]
    assert not certain(np.full(FIRST_LOOK, np.inf)), "nothing was found"
    assert certain(np.array([0.0, *np.full(99, 0.9 * COST_FLOOR)])), "costs below the floor are rounding"


def test_a_larger_maximum_only_adds_starts() -> None:
    assert looks(1000) == [100, 200, 400, 800, 1000]
    assert looks(60) == [60]
    assert looks(100) == [100]
    for most in (60, 100, 101, 250, 1000, 1601):
        assert looks(most)[-1] == most
        assert looks(most)[:-1] == [n for n in looks(10**6) if n < most]
