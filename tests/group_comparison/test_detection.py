"""Tests between two groups: their false positives, what they find, and which name they give it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import xarray as xr
from examples import module
from many_people import comtest, needs_comtest
from scipy.stats import binomtest
from simulated_groups import people

from mcstudy.errors import InputError
from mcstudy.group_comparison.closed_tests import closed, ranks
from mcstudy.group_comparison.detection import Detection, detect, name
from mcstudy.group_comparison.sample import sample_of


def outcome_of(a: xr.Dataset, b: xr.Dataset, seed: int = 0, paired: bool | None = None) -> Detection:
    return detect(sample_of(a, b, paired), a["f"].values, np.random.default_rng(seed), 199)


@pytest.mark.parametrize("paired", [True, False])
def test_groups_without_a_difference_are_told_apart_no_more_often_than_the_level(paired: bool) -> None:
    n, found = 60, Counter()
    for k in range(n):
        outcome = outcome_of(people(10, 2 * k), people(10, 2 * k if paired else 2 * k + 1, again=1), k)
        found.update(p for p in ("p_mean", "p_scatter", "p_ratio") if getattr(outcome, p) <= 0.05)
        found["region"] += min(r.p for r in outcome.regions) <= 0.05
    for which, hits in found.items():
        assert binomtest(hits, n, 0.05, alternative="greater").pvalue > 1e-3, which


def test_a_change_of_the_weight_is_found_and_changes_both_segments_alike() -> None:
    names = Counter(name(outcome_of(people(10, k), people(10, 100 + k, {"Wprop": 0.7}), k)) for k in range(30))
    assert names["same"] <= 2
    assert names["alike"] >= 15
    assert names["upper body"] < names["alike"]


def test_a_change_of_hip_control_is_found_in_the_upper_body() -> None:
    for change in ({"K12": 1.3, "B12": 1.3}, {"K22": 1.4, "B22": 1.4}):
        names = Counter(name(outcome_of(people(10, k), people(10, 100 + k, change), k)) for k in range(15))
        assert names["upper body"] >= 14


def test_a_change_of_noise_alone_is_found_in_the_scatter() -> None:
    outcome = outcome_of(people(20, 1), people(20, 1, noise=0.15, again=1))
    assert outcome.p_scatter <= 0.01
    assert outcome.scatter_ratio < 0.8
    assert outcome.p_mean > 0.05
    assert name(outcome) == "same"


def test_pairs_show_a_difference_that_scatter_between_people_hides() -> None:
    a, b = people(8, 3, noise=0.05), people(8, 3, {"Wprop": 0.93}, noise=0.05, again=1)
    assert outcome_of(a, b).p_mean <= 0.02
    assert outcome_of(a, b, paired=False).p_mean > 0.05


def test_p_values_are_shares_of_relabellings_at_least_as_extreme() -> None:
    np.testing.assert_allclose(ranks(np.array([3.0, 1.0, 3.0, 5.0])), [0.75, 1.0, 0.75, 0.25])


def test_relabellings_exchange_within_pairs_or_between_people() -> None:
    sample = sample_of(people(5, 1), people(5, 1, again=1))
    labels = sample.relabelled(np.random.default_rng(0), 50)
    assert not labels[0, :5].any()
    assert (labels[:, :5] != labels[:, 5:]).all()
    other = sample_of(people(5, 1), people(6, 2)).relabelled(np.random.default_rng(0), 50)
    assert (other.sum(axis=1) == 6).all()


@pytest.mark.parametrize(("paired", "number", "least"), [(True, 2**5, 2 / 2**5), (False, 252, 2 / 252)])
def test_all_relabellings_of_few_people_are_made_once(paired: bool, number: int, least: float) -> None:
    sample = sample_of(people(5, 1), people(5, 1, again=1), paired)
    labels = sample.relabelled(np.random.default_rng(0), 999)
    assert len(np.unique(labels, axis=0)) == len(labels) == number
    assert not labels[0, :5].any()
    assert labels[0, 5:].all()
    outcome = detect(sample, people(4, 1)["f"].values, np.random.default_rng(0))
    assert (outcome.relabellings, outcome.least_p) == (number, least)
    assert outcome.p_mean * number == pytest.approx(round(outcome.p_mean * number))
    assert outcome.p_mean >= least


def test_five_pairs_that_differ_as_much_as_can_be_reach_the_least_p() -> None:
    a, b = people(5, 1), people(5, 1, {"K11": 1.6, "K12": 1.6}, again=1)
    outcome = outcome_of(a, b)
    assert outcome.p_mean == outcome.least_p == 2 / 32


def test_equal_means_of_unequal_noise_and_number_are_not_told_apart() -> None:
    """6 people with 5/3 of the noise of 12, and the reverse: without Welch's variance 17 and 0 % of 300."""
    n, settings = 100, {"law": "normal", "scatter": 0.05, "uneven": 0.3}
    for sizes in ((6, 12), (12, 6)):
        found: Counter[str] = Counter()
        for k in range(n):
            a = people(sizes[0], 2 * k, noise=0.5, **settings)
            b = people(sizes[1], 2 * k + 1, noise=0.3, **settings)
            outcome = outcome_of(a, b, k)
            found["means"] += outcome.p_mean <= 0.05
            found["ratio"] += outcome.p_ratio <= 0.05
            found["region"] += min(r.p for r in outcome.regions) <= 0.05
        assert max(found.values()) <= 12, (sizes, found)


@pytest.mark.parametrize("paired", [True, False])
def test_no_p_value_of_the_means_is_below_the_one_that_decides(paired: bool) -> None:
    for k in range(20):
        outcome = outcome_of(people(6, k), people(6, k if paired else 50 + k, {"K22": 1.1}, again=1), k, paired)
        assert min(outcome.p_ratio, *(r.p for r in outcome.regions)) >= outcome.p_mean >= outcome.least_p


def test_a_closed_test_is_the_largest_of_the_tests_of_all_sets_that_hold_it() -> None:
    parts = np.array([[9.0, 1.0, 2.0, 3.0], [0.0, 4.0, 1.0, 8.5]])
    every, single = closed(parts)
    assert every == 0.5  # 9 of 9, 5, 3, 11.5
    np.testing.assert_array_equal(single, [0.5, 1.0])


def test_a_difference_of_means_is_none_of_scatter() -> None:
    found = 0
    for k in range(40):
        found += outcome_of(people(6, k), people(6, 100 + k, {"K11": 2.0, "K12": 2.0}), k).p_scatter <= 0.05
    assert found <= 6


def test_people_are_paired_by_name() -> None:
    a, b = people(6, 1), people(6, 1, {"Wprop": 0.5}, again=1)
    straight, turned = sample_of(a, b), sample_of(a, b.isel(person=slice(None, None, -1)))
    np.testing.assert_array_equal(straight.b, turned.b)
    assert straight.paired


def test_groups_that_cannot_be_compared_are_refused_in_one_line() -> None:
    a = people(6, 1)
    some = xr.concat([people(3, 1), people(3, 2)], "person", data_vars="minimal", coords="minimal", compat="override")
    other = a.copy()
    other.attrs = {**a.attrs, "stimulus": "visual_tilt"}
    for b, paired, line in (
        (some, None, "3 people are in both and others in one; expected paired"),
        (some, True, "a: expected at least 4 people with all responses that are in both groups, got 3"),
        (other, None, "expected one stimulus, got surface_tilt and visual_tilt"),
        (a.isel(point=slice(0, 5)), None, "expected the same points and harmonics"),
    ):
        with pytest.raises(InputError, match=line):
            sample_of(a, b, paired)


@needs_comtest
def test_published_people_are_named_as_the_experimenter_changed_them() -> None:
    """Few draws of what `pipelines/validation/relabel_people.py` does a thousand times."""
    script = module("relabel_people")
    found = script.answers(script.people_of(comtest(), "eyes", "tilt_pp_deg"), True, 100, 10, 7)
    assert sum(n for (truth, given), n in found.items() if truth == given) >= 85
