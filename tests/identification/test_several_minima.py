"""Where two minima fit almost equally well, intervals are raised by what the law of their ratio says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from mcstudy.identification.fit import fit_lines
from mcstudy.identification.settings import FitSettings
from mcstudy.identification.threshold import factor, missed, separated
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream
from pipelines.validation.coverage import Condition, Source

PLAIN = float(chi2.ppf(0.95, 1))


@pytest.mark.parametrize("distance", [1.0, 3.4, 9.0])
def test_the_law_is_that_of_fits_to_two_lines_in_space(distance: float) -> None:
    """Truth on one of two parallel lines, data with unit noise: the ratio at the truth, from the nearest points."""
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((40_000, 2))  # along the lines, and across
    own, other = noise[:, 1] ** 2, (noise[:, 1] - np.sqrt(distance)) ** 2
    ratio = noise[:, 0] ** 2 + own - np.minimum(own, other)
    for raised in (PLAIN, factor(0.95) * PLAIN):
        upto = np.where(np.abs(own - other) < 10, raised, PLAIN)
        found = float(np.mean(ratio > upto))
        assert found == pytest.approx(missed(raised, PLAIN, distance), abs=4 * np.sqrt(0.1 * 0.9 / 40_000))


def test_the_usual_threshold_misses_too_often_and_the_raised_one_never_does() -> None:
    distances = np.geomspace(0.1, 60, 40)
    assert max(missed(PLAIN, PLAIN, d) for d in distances) > 0.09
    assert max(missed(factor(0.95) * PLAIN, PLAIN, d) for d in distances) == pytest.approx(0.05, abs=1e-3)


def test_only_quantities_that_differ_between_minima_that_compete_are_raised() -> None:
    values = np.array([[1.0, 10.0, 5.0], [1.1, 30.0, 5.0], [9.0, 10.0, 5.0]])
    rise, reach = np.array([0.0, 2.0, 15.0]), np.array([0.5, 3.0, np.nan])
    np.testing.assert_array_equal(separated(values, rise, reach), [0, 1, 0])
    np.testing.assert_array_equal(separated(values[:1], np.zeros(1), np.ones(3)), [0, 0, 0])


def test_a_fit_with_two_minima_raises_its_thresholds_and_says_so() -> None:
    """A recording of which both 6 and 34 N m s/rad of B22 are a minimum; the truth is 31."""
    fitted = fit_lines(
        Source(Condition(1, 6, 3.1))(stream(5, "coverage 1 6")), two_segment(), FitSettings(seed=5), curve=()
    )
    (said,) = [w for w in fitted.warnings if w.startswith("another minimum fits almost as well")]
    named = said.split("intervals of ")[1].split(" are")[0].split(", ")
    assert "B22" in named
    assert "K11 + Kpas1" not in named
    rise = {e.name: e.profile.rise[0] for e in fitted.estimates if e.low_from == "data"}
    assert rise["B22"] > 1.25 * rise["K11 + Kpas1"]
    assert fitted["B22"].low < 31 < fitted["B22"].high
