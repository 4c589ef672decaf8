"""The part by which curvature raises the mean likelihood ratio is that of simulated fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.identification.curvature import MOST, _excess, curvature
from mcstudy.identification.minimum import without_prior
from mcstudy.identification.profile import Linearised
from mcstudy.models.quantities import Quantity, expression, quantities
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream
from pipelines.validation.at_truth import judged, starts
from pipelines.validation.coverage import Condition, Source, body

MODEL = two_segment()
THETA = np.array(list(body(0).values()))


def fitted(amplitude: float, wanted: list[Quantity] | None = None) -> tuple[Data, np.ndarray, Linearised]:
    """A fit of the nominal body, at a torque with this peak."""
    source = Source(Condition(0, 5, 3.1, amplitude))
    lines: Lines = source(stream(3, "curvature"))
    fitter = Fitter(MODEL, without_prior(MODEL, MODEL), lines.f)
    found = judged(fitter, [lines], quantities(MODEL), THETA, source.draws(), 0.95, starts(fitter, [3], 4))
    minima = found.minima[0]
    near = found.near[0] if wanted is None else Linearised.at(MODEL, minima, wanted)
    return Data.of(lines), minima.theta[0], near


def test_it_falls_with_the_variance_of_the_noise() -> None:
    data, theta, near = fitted(5.0)
    calm = replace(data, weight=3.0 * data.weight)
    calmer = replace(near, covariance=near.covariance / 9)
    one = curvature(MODEL, data, theta, near, quantities(MODEL))
    other = curvature(MODEL, calm, theta, calmer, quantities(MODEL))
    below = (one > 0) & (one < MOST)
    assert below.sum() > 5
    np.testing.assert_allclose(other[below], one[below] / 9, rtol=1e-3)


def test_it_does_not_depend_on_how_a_quantity_is_written() -> None:
    """A value and its logarithm have the same profile likelihood, so the same ratio, and the same part."""
    two = [expression(MODEL, text) for text in ("K21", "log(K21)")]
    data, theta, near = fitted(5.0, two)
    plain, log = curvature(MODEL, data, theta, near, two)
    assert 0 < plain < MOST
    assert log == pytest.approx(plain, rel=1e-4)


def test_it_is_the_excess_of_the_mean_deviance_of_a_circle() -> None:
    """Two data on a circle of radius r: with the angle free, the mean fall of the deviance is 1 + 1 / (4 r^2)."""
    r, rng = 5.0, np.random.default_rng(4)
    z = rng.standard_normal((2, 4_000_000))
    fall = (z**2).sum(axis=0) - (np.hypot(r + z[0], z[1]) - r) ** 2
    a = 1 / r  # second derivative, per unit of arc, towards the centre
    assert _excess(a**2, np.array([a])) == pytest.approx(0.25 / r**2)
    assert (fall - z[1] ** 2).mean() == pytest.approx(0.25 / r**2, rel=0.15)
