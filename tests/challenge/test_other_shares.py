"""The calibration of a challenge where another share of the cases lacks nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcstudy_challenge.scores.other_shares import other_shares


def cases(nulls: int, n: int, prior: float, rng: np.random.Generator) -> list[Any]:
    """A method that knows the law of its data, and takes nulls to have a share ``prior``."""
    out = []
    for k in range(n):
        null = k < nulls
        x = rng.normal(0.0 if null else 1.5)
        odds = prior / (1 - prior) * np.exp(0.5 * ((x - 1.5) ** 2 - x**2))
        p = odds / (1 + odds)
        kind = "none" if null else "known"
        loss = -np.log(p if null else 1 - p)
        out.append(SimpleNamespace(kind=kind, none=p, stated=max(p, 1 - p), top=null == (p > 0.5), log_loss=loss))
    return out


def test_probabilities_are_right_where_nulls_have_the_share_of_their_prior_only() -> None:
    found = other_shares(cases(3000, 10_000, 0.3, np.random.default_rng(1)))
    assert [s["nulls"] for s in found] == [0.1, 0.3, 0.5]
    few, same, many = (s["none"] for s in found)
    assert few["low"] > 0.03  # it expects more nulls than there are
    assert same["low"] < 0 < same["high"]
    assert many["high"] < -0.03
    assert found[1]["first"]["low"] < 0 < found[1]["first"]["high"]


def test_the_prior_of_another_share_mends_it() -> None:
    found = other_shares(cases(3000, 10_000, 0.1, np.random.default_rng(2)))
    assert found[0]["none"]["low"] < 0 < found[0]["none"]["high"]


def test_an_interval_holds_the_expected_difference_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    expected = other_shares(cases(30_000, 100_000, 0.3, rng))[2]["none"]["value"]
    inside = []
    for _ in range(200):
        f = other_shares(cases(60, 200, 0.3, rng))[2]["none"]
        inside.append(f["low"] <= expected <= f["high"])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.06)


def test_the_log_loss_is_the_one_of_both_kinds_in_the_given_shares() -> None:
    main = cases(300, 1000, 0.3, np.random.default_rng(5))
    nulls, others = (float(np.mean([j.log_loss for j in part])) for part in (main[:300], main[300:]))
    losses = [s["log_loss"]["value"] for s in other_shares(main, (0.2, 0.3, 0.9))]
    expected = [0.2 * nulls + 0.8 * others, np.mean([j.log_loss for j in main]), 0.9 * nulls + 0.1 * others]
    assert losses == pytest.approx(expected, abs=1e-5)


def test_cases_of_one_kind_say_nothing_of_other_shares() -> None:
    assert other_shares(cases(20, 20, 0.3, np.random.default_rng(4))) == []
    assert other_shares([]) == []
