"""`pipelines/validation/equal_studies.py`: the verdicts on studies that are equal."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from examples import module
from mcstudy_goodworth2018.paper.statements import RESULTS

from mcstudy.analysis.publications.sampling import Value


@pytest.fixture(scope="module", name="example")
def _example() -> ModuleType:
    return module("equal_studies")


def test_a_study_quotes_its_numbers_as_the_paper_does(example: ModuleType) -> None:
    assert example.quoted(RESULTS["bias_12_0.41"], 12.3456).value == pytest.approx(12.3)
    assert example.quoted(RESULTS["spread_amplitude_1.2"], 18.7).value == 19.0
    # a ranking that fails in that study would have been published the other way round
    assert example.quoted(RESULTS["lowest_cv"], 5.0).criterion == "at least"
    assert example.quoted(RESULTS["lowest_cv"], -5.0).criterion == "at most"


def test_shares_are_of_normal_numbers_what_theory_says(example: ModuleType) -> None:
    rng = np.random.default_rng(4)
    key = "spread_amplitude_1.2"
    equal = [{key: Value(20 + x, 3.0, 3.0, 50)} for x in 3 * rng.standard_normal(60)]
    far = [{key: Value(v[key].value + 20, 3.0, 3.0, 50)} for v in equal]
    differs, agrees, n = example.shares(key, equal, equal, 1, same=True)
    assert n == 60 * 59
    assert differs < 1
    # difference of SD sqrt(2) x 3, agreement within 10 - 1.645 sqrt(2) x 3 = 3.0: 52 %
    assert agrees == pytest.approx(52, abs=8)
    assert example.shares(key, equal, equal, 59, same=True)[1] > 85  # within 10 - 1.645 x 3 = 5.1 of 3: 91 %
    assert example.shares(key, equal, far, 60, same=False)[0] > 98
