"""Profile intervals are what an independent optimiser finds."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

import mcstudy as mc
from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.identification.bounds import bounded
from mcstudy.identification.estimate import Estimate
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.minimum import search, without_prior
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream
from pipelines.validation.coverage import Condition, Source

STARTS = 2
VALIDATION = Path(__file__).parents[2] / "pipelines" / "validation"


@pytest.fixture(scope="module")
def fitted() -> FitRecord:
    return mc.fit(mc.simulate(seed=3, cycles=3), fmax=2.0, quantities=["sqrt(B11 * B22)", "log(K21)"])


def constrained(fitted: FitRecord, e: Estimate, side: int) -> float:
    """The largest (``side`` 1) or smallest value of a quantity with at most the deviance at the end of its interval.

    By SLSQP, with its own cost and derivatives, from the end and from a point near it.
    """
    model, data = fitted.model, Data.of(fitted.lines)
    scale = np.where(fitted.theta > 0, fitted.theta, model.truth)
    end = e.profile.low_theta if side < 0 else e.profile.high_theta
    names = model.names

    def value(x: np.ndarray) -> float:
        return float(eval(e.name, {"sqrt": np.sqrt}, dict(zip(names, x * scale, strict=True))))

    def deviance(x: np.ndarray) -> float:
        return float((whiten(data.weight, data.y - frf(model, x * scale, data.f)) ** 2).sum())

    def slope(x: np.ndarray) -> np.ndarray:
        H, dH = frf_jacobian(model, x * scale, data.f)
        return -2 * whiten(data.weight, data.y - H) @ whiten(data.weight, dH) * scale

    allowed = fitted.chi2 + e.profile.rise[0 if side < 0 else -1]
    rng, found = np.random.default_rng(0), []
    for start in range(STARTS):
        outcome = minimize(
            lambda x: -side * value(x) / abs(e.estimate),
            np.clip(end / scale * (1 + 0.02 * bool(start) * rng.standard_normal(end.size)), 0, None),
            constraints={"type": "ineq", "fun": lambda x: allowed - deviance(x), "jac": lambda x: -slope(x)},
            bounds=[(p.lower / s, p.upper / s) for p, s in zip(model.parameters, scale, strict=True)],
            method="SLSQP",
            options={"ftol": 1e-13, "maxiter": 400},
        )
        if outcome.success and deviance(outcome.x) <= allowed + 1e-6:
            found.append(value(outcome.x))
    return max(found, key=lambda v: side * v)


@pytest.mark.parametrize("name", ["K21"])
def test_an_interval_ends_where_another_optimiser_says(fitted: FitRecord, name: str) -> None:
    e = fitted[name]
    assert (e.low_from, e.high_from) == ("data", "data")
    for side, end in ((-1, e.low), (1, e.high)):
        assert constrained(fitted, e, side) == pytest.approx(end, abs=1e-4 * (e.high - e.low))


@pytest.mark.parametrize("name", ["K12", "K11 + Kpas1"])
def test_both_ends_are_those_of_an_independent_profile(fitted: FitRecord, name: str) -> None:
    """Within a millionth of the width: the quantity held fixed, scipy's least squares, Brent's method."""
    example = runpy.run_path(str(VALIDATION / "interval_oracle.py"))
    e, rng = fitted[name], np.random.default_rng(0)
    assert (e.low_from, e.high_from) == ("data", "data")
    for side in (-1, 1):
        end = example["difference"](fitted, e, side, STARTS, rng)
        assert end.verdict == "same"
        assert end.below > -1e-5
        assert abs(end.own) < 1e-6


def test_an_end_behind_a_local_one_is_found() -> None:
    """From the minimum the search stops at a local end of this interval, 23 % of its width before the true one."""
    example = runpy.run_path(str(VALIDATION / "interval_oracle.py"))
    fitted = fit_lines(Source(Condition(0, 6, 3.1))(stream(13, "oracle")), two_segment(), curve=())
    end = example["difference"](fitted, fitted["Td1"], -1, STARTS, stream(13, "oracle starts"))
    assert end.verdict == "same"
    assert fitted["Td1"].low == pytest.approx(0.078294, abs=2e-6)


def test_the_interval_of_a_logarithm_is_the_logarithm_of_the_interval(fitted: FitRecord) -> None:
    plain, logarithm = fitted["K21"], fitted["log(K21)"]
    assert np.log([plain.low, plain.high]) == pytest.approx([logarithm.low, logarithm.high], abs=1e-6)


def test_the_deviance_at_both_ends_is_the_threshold_and_lower_between(fitted: FitRecord) -> None:
    for e in fitted.estimates:
        if (e.low_from, e.high_from) == ("data", "data"):
            assert e.profile.rise[0] == pytest.approx(e.profile.rise[-1], rel=1e-4)
            assert e.profile.rise.max() <= e.profile.rise[0] * (1 + 1e-4)
            assert e.profile.rise[0] >= 3.841  # chi-squared with one degree of freedom, or more


def test_the_parameters_at_an_end_have_the_value_and_the_deviance_of_the_end(fitted: FitRecord) -> None:
    data, model = Data.of(fitted.lines), fitted.model
    for e in fitted.estimates[: len(model.names)]:
        k = model.names.index(e.name)
        for theta, end, rise in (
            (e.profile.low_theta, e.low, e.profile.rise[0]),
            (e.profile.high_theta, e.high, e.profile.rise[-1]),
        ):
            assert theta[k] == end
            r = whiten(data.weight, data.y - frf(model, theta, data.f))
            assert r @ r - fitted.chi2 == pytest.approx(rise, abs=1e-6)


def test_bounds_end_an_interval_that_the_data_leave_open(fitted: FitRecord) -> None:
    e = fitted["Kpas1"]
    assert e.low == fitted.model.lower[fitted.model.names.index("Kpas1")] == 0
    assert (e.low_from, e.verdict) == ("bound", "not identifiable" if e.high_from == "bound" else "upper limit only")


def test_the_lowest_minimum_of_a_recording_is_not_missed() -> None:
    example = runpy.run_path(str(VALIDATION / "missed_minima.py"))
    found = example["missed"](3.1, recordings=1, more=3)
    assert (found.lower, found.other) == (0, 0)
    assert 0 < found.stated < 0.01
    assert found.starts >= 16


def test_the_lowest_minimum_is_found_where_few_random_starts_end_in_it() -> None:
    """Of 1,600 random starts 26 end in the lowest minimum of this recording; 32 starts found the next one only."""
    nominal = two_segment()
    model = bounded(nominal, nominal, {})
    lines = Source(Condition(0, 6, 3.1))(stream(10, "oracle"))
    fitter, data = Fitter(model, without_prior(model, nominal), lines.f), Data.of(lines)
    other = fitter.fits(fitter.packed(data), drawn_starts(model, 77, 300), tolerance=1e-7, max_iterations=300)
    standing = other.chi2[growth_rate(model, other.estimate) < 0]
    found = search(fitter, data, 0)
    assert found.starts < 100
    assert found.chi2[0] == pytest.approx(standing.min(), abs=1e-3)
    assert found.chi2[1] - found.chi2[0] == pytest.approx(1.397, abs=2e-3)


def test_a_stable_minimum_far_above_the_lowest_is_not_the_estimate() -> None:
    """The lowest minimum of this recording is unstable; the only stable one of few starts is ten times higher."""
    nominal = two_segment()
    model = bounded(nominal, nominal, {})
    lines = Source(Condition(0, 3, 1.2))(stream(2, "coverage 2 3"))
    fitter, data = Fitter(model, without_prior(model, nominal), lines.f), Data.of(lines)
    truth = nominal.truth
    from_truth = fitter.fits(fitter.packed(data), truth, tolerance=1e-7, max_iterations=300).chi2[0]
    assert search(fitter, data, 2).chi2[0] < from_truth + 0.1
