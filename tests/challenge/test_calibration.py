"""Calibration of stated probabilities, against scikit-learn, exact binomial sums, and simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mcstudy_challenge.scores.calibration import calibration, spiegelhalter
from mcstudy_challenge.scores.reliability import reliability_picture
from scipy import stats

K = np.arange(300)
STATED = np.round(K * 0.6180339887498949 % 1, 2)
RIGHT = (K * 0.7548776662466927 % 1) < STATED**1.3

SKLEARN_RIGHT = (0.0, 0.0666666667, 0.2, 0.2068965517, 0.3333333333, 0.4666666667, 0.6333333333, 0.7741935484, 0.8,
                 0.9642857143)  # fmt: skip
SKLEARN_STATED = (0.051875, 0.1553333333, 0.2546666667, 0.3537931034, 0.4543333333, 0.5543333333, 0.6533333333,
                  0.7551612903, 0.8556666667, 0.9525)  # fmt: skip
"""``sklearn.calibration.calibration_curve(RIGHT, STATED, n_bins=10, strategy="uniform")`` of scikit-learn 1.9.1."""


def test_bins_are_those_of_scikit_learn_also_at_their_ends() -> None:
    found = calibration(STATED, RIGHT)
    assert np.isclose(STATED * 10 % 1, 0).sum() > 20  # many statements lie on an edge
    assert [b.right.value for b in found.bins] == pytest.approx(SKLEARN_RIGHT, abs=1e-9)
    assert [b.stated for b in found.bins] == pytest.approx(SKLEARN_STATED, abs=1e-9)
    share = np.array([b.right.n for b in found.bins]) / 300
    by_bin = np.abs(np.subtract(SKLEARN_RIGHT, SKLEARN_STATED))
    assert found.error == pytest.approx(float((share * by_bin).sum()), abs=1e-9)


def test_interval_of_a_bin_is_wilson_s() -> None:
    (only,) = calibration([0.55] * 20, [True] * 13 + [False] * 7).bins
    wilson = stats.binomtest(13, 20).proportion_ci(method="wilson")
    assert (only.right.low, only.right.high) == pytest.approx((wilson.low, wilson.high), abs=1e-4)


def test_error_by_chance_is_the_exact_mean_over_outcomes() -> None:
    """Two bins: 9 statements of 0.5 and 4 of 0.88; sums over all outcomes."""
    found = calibration([0.5] * 9 + [0.88] * 4, [True] * 13)
    exact = sum(
        abs(k - n * p) * stats.binom.pmf(k, n, p) for n, p in ((9, 0.5), (4, 0.88)) for k in range(n + 1)
    ) / 13  # fmt: skip
    assert found.by_chance == pytest.approx(float(exact), rel=0.03)


def test_spiegelhalter_s_z_is_the_brier_score_less_its_expectation() -> None:
    brier = np.mean((RIGHT - STATED) ** 2)
    expected = np.mean(STATED * (1 - STATED))
    variance = np.sum((1 - 2 * STATED) ** 2 * STATED * (1 - STATED)) / 300**2
    assert spiegelhalter(STATED, RIGHT) == pytest.approx((brier - expected) / math.sqrt(variance))


def test_calibrated_answers_are_rarely_called_miscalibrated_and_overconfident_ones_are() -> None:
    rng = np.random.default_rng(3)
    stated = rng.beta(2.0, 0.7, (200, 60))
    sound = [calibration(p, rng.random(60) < p) for p in stated]
    over = [calibration(p, rng.random(60) < 0.5 + 0.4 * (p - 0.5)) for p in stated[:40]]
    for pick in (lambda c: c.p_value, lambda c: c.z_p_value):
        assert np.mean([pick(c) < 0.05 for c in sound]) < 0.105  # 5 % of 200, and 3.5 standard errors
        assert np.mean([pick(c) < 0.05 for c in over]) > 0.8
    assert np.mean([c.error > c.by_chance for c in sound]) == pytest.approx(0.5, abs=0.15)
    assert all(c.z > 0 for c in over)


def test_what_is_nearly_certain_has_no_z_and_no_cases_have_no_figures() -> None:
    assert math.isnan(calibration([0.99] * 10, [True] * 10).z)
    assert math.isnan(calibration([0.5] * 10, [True] * 10).z)  # z does not depend on outcomes stated with 0.5
    nothing = calibration([], [])
    assert nothing.right.n == 0
    assert nothing.to_dict()["error"] is None


@pytest.mark.parametrize(("stated", "right"), [([0.5], [True, False]), ([1.5], [True]), ([math.nan], [True])])
def test_statements_that_are_no_probabilities_are_refused(stated: list[float], right: list[bool]) -> None:
    with pytest.raises(ValueError, match="expected"):
        calibration(stated, right)


def test_the_figure_has_a_dot_an_interval_and_a_bar_for_every_bin() -> None:
    found = calibration(STATED, RIGHT)
    one, wilson = {"statement": "a < b", **found.to_dict()}, [(b.right.low, b.right.high) for b in found.bins]
    shown = reliability_picture({"challenge": "tiny & small", "cases": 300, "calibration": [one, one, one, one]})
    assert len(shown.axes) == 3  # of the statements about all cases
    for ax in shown.axes:
        bars, intervals = ax.containers
        dots, _, (lines,) = intervals.lines
        np.testing.assert_allclose(dots.get_xydata(), 100 * np.transpose([SKLEARN_STATED, SKLEARN_RIGHT]), atol=0.006)
        np.testing.assert_allclose([s[:, 1] for s in lines.get_segments()], 100 * np.array(wilson), atol=0.006)
        heights = np.array([bar.get_height() for bar in bars])
        np.testing.assert_allclose(heights / heights.sum(), np.array([b.right.n for b in found.bins]) / 300)
