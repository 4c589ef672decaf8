"""A plan counts exactly and predicts precision the way Monte Carlo errors behave."""

from __future__ import annotations

import numpy as np

from mcstudy.study.plan import plan
from mcstudy.study.study_file import parse_study


def test_fits_and_bytes_are_exact_and_precision_is_for_noisy_groups_only(tiny: str) -> None:
    noisy, ideal = plan(parse_study(tiny))
    assert (noisy.fits, ideal.fits) == (120, 8)
    # estimate and initial alone: 12 parameters of 8 bytes, twice, a fit
    assert noisy.bytes > 120 * 2 * 12 * 8
    assert noisy.seconds > 0
    assert [(p.amplitude, p.fmax) for p in noisy.precision] == [(3.0, 0.41), (3.0, 1.2), (5.0, 0.41), (5.0, 1.2)]
    assert ideal.precision == ()


def test_four_times_the_realizations_halve_the_monte_carlo_error(tiny: str) -> None:
    few, _ = plan(parse_study(tiny))
    many, _ = plan(parse_study(tiny.replace("realizations = 5", "realizations = 20")))
    np.testing.assert_allclose([p.mean for p in many.precision], [p.mean / 2 for p in few.precision], rtol=1e-12)


def test_a_larger_stimulus_promises_smaller_errors(tiny: str) -> None:
    noisy, _ = plan(parse_study(tiny.replace("[3.0, 5.0]", "[1.0, 20.0]")))
    mean = {(p.amplitude, p.fmax): p.mean for p in noisy.precision}
    assert mean[20.0, 1.2] < mean[1.0, 1.2]
